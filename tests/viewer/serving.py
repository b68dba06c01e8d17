"""Serving an application in a thread, and asking it exactly what a test says."""

from __future__ import annotations

import http.client
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from pliant.viewer.local_app import LocalServer


@contextmanager
def serving(server: LocalServer) -> Iterator[str]:
    """Run a server; yield its address, which ends with a slash."""
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        yield server.address
    finally:
        server.stop()
        thread.join(timeout=10)


def served(application: Callable[[str], Any]) -> Any:
    """Serve an application below a token; yield its address."""
    return serving(LocalServer(application))


def ask(
    address: str, path: str, method: str = "GET", *, body: bytes | None = None, **headers: Any
) -> tuple[int, bytes]:
    """Send a path exactly as it is given, with `_` for `-` in names; return status and body."""
    answer, data = ask_for(address, path, method, body=body, **headers)
    return answer.status, data


def ask_for(
    address: str, path: str, method: str = "GET", *, body: bytes | None = None, **headers: Any
) -> tuple[http.client.HTTPResponse, bytes]:
    """Return the whole answer; see `ask`."""
    place = urlsplit(address)
    connection = http.client.HTTPConnection(str(place.hostname), place.port, timeout=20)
    try:
        connection.putrequest(method, path, skip_host="Host" in headers)
        if body is not None:
            headers.setdefault("Content_Length", str(len(body)))
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders(body)
        answer = connection.getresponse()
        return answer, answer.read()
    finally:
        connection.close()


def below(address: str, name: str) -> str:
    """Return the path of something below an address."""
    return urlsplit(address).path + name
