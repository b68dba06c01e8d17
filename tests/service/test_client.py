"""What `pliant submit` says when a service refuses a file, or is not one."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pliant.cli.submit import print_submission
from pliant.service.client import Client
from pliant.spec.errors import CallError

REFUSED = b'{"code": "FILE_TOO_LARGE", "message": "the file is too large"}'
STRANGER = b"<html>Not here</html>"


@contextmanager
def answering(status: str, body: bytes) -> Iterator[str]:
    """Run a server that answers each request before it has read it, and closes the connection."""
    head = f"HTTP/1.1 {status}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while True:
                try:
                    connection = server.accept()[0]
                except OSError:
                    return
                with connection:
                    connection.recv(100)
                    connection.sendall(head.encode() + body)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}"
        server.shutdown(socket.SHUT_RDWR)
        thread.join()


@pytest.fixture
def large(tmp_path: Path) -> Path:
    path = tmp_path / "large.parquet"
    path.write_bytes(bytes(20_000_000))
    return path


def test_a_refusal_before_the_end_of_the_file_is_heard(large: Path) -> None:
    with answering("413 Too Large", REFUSED) as address:
        for _ in range(5):
            with pytest.raises(CallError, match="file is too large"):
                Client(address, "pliant_a_b").send(large)


@pytest.mark.parametrize(
    ("status", "message"),
    [("413 Too Large", "too large for the service's proxy"), ("502 Bad Gateway", "not answer")],
)
def test_a_proxy_that_answers_in_place_of_the_service(
    large: Path, status: str, message: str
) -> None:
    with answering(status, STRANGER) as address, pytest.raises(CallError, match=message):
        Client(address, "pliant_a_b").send(large)


def test_an_address_of_something_else(large: Path) -> None:
    message = "not the answer of an evaluation service"
    with answering("404 Not Found", STRANGER) as address, pytest.raises(CallError, match=message):
        Client(address, "pliant_a_b").send(large)


@pytest.mark.parametrize("token", ["a b", "a\nb", "é", ""])
def test_a_token_that_is_none(token: str) -> None:
    with pytest.raises(CallError, match="not a token"):
        Client("http://127.0.0.1:1", token)


@pytest.mark.parametrize("tiers", [["rope"], ["cloth-1", "rope"]])
def test_figures_of_a_single_tier_are_printed_once(
    tiers: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    figures = {group: {"rmse_px": 1.5} for group in ("overall", *tiers)}
    scores = [{"protocol": "paper 1.2", "figures": figures}]
    view = {"id": 1, "state": "scored", "issues": [], "failure": None, "scores": scores}
    print_submission(view, "URL")
    shown = capsys.readouterr().out
    assert shown.count("rmse_px 1.5") == (1 if len(tiers) == 1 else 3)
