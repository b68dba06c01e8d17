"""Sends a file to an evaluation service; needs the standard library alone."""

from __future__ import annotations

import http.client
import json
import re
import ssl
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, Final
from urllib.parse import urlencode, urlsplit

from pliant.spec.errors import CallError
from pliant.spec.progress import Progress

_TIMEOUT_S: Final = 60
_POLL_S: Final = 1.0
_PATIENCE_S: Final = 120
"""So long a service that does not answer is asked again."""

_TRY_AGAIN: Final = "Try again: a file that arrived is not charged twice."
_SILENT: Final = ("the service does not answer", _TRY_AGAIN)
_OF_PROXIES: Final = {
    413: ("the file is too large for the service's proxy", "Tell the host, who sets the limit."),
    **dict.fromkeys((502, 503, 504), _SILENT),
}
"""What a reverse proxy that answers in place of the service means by a status, and what to do."""


class Client:
    """A team's connection to a service.

    Args:
        address: Address of the service, such as `https://challenge.example.org`.
        token: The team's token.

    Raises:
        CallError: The address is not a web address, or the token has characters that no token has.
    """

    def __init__(self, address: str, token: str) -> None:
        parts = urlsplit(address)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise CallError("this is not a web address", found=address, required="http(s)://HOST")
        self._root = address.rstrip("/")
        self._token = token.strip()
        if not re.fullmatch(r"[\w-]+", self._token, re.ASCII):
            raise CallError(
                "this is not a token",
                required="letters, digits, _ and -, as the host sent it",
                fix="Copy it again.",
            )

    def page(self, view: dict[str, Any]) -> str:
        """Return the address of a submission's page."""
        return f"{self._root}/submissions/{view['id']}"

    def send(
        self,
        file: Path,
        *,
        phase: str | None = None,
        check_only: bool = False,
        progress: Progress = lambda done, total: None,
    ) -> dict[str, Any]:
        """Send a file and return the submission.

        Args:
            file: The file.
            phase: Name of the phase, or None for the first one that is open.
            check_only: Whether it is only checked.
            progress: Called with (bytes sent, bytes in all).

        Raises:
            CallError: The service does not accept it, or cannot be reached.
        """
        query = {"file_name": file.name, "check_only": str(check_only).lower()}
        query |= {} if phase is None else {"phase": phase}
        size = file.stat().st_size
        with open(file, "rb") as stream:
            body = _Watched(stream, size, progress)
            headers = {"Content-Type": "application/octet-stream", "Content-Length": str(size)}
            return self._call(f"submissions?{urlencode(query)}", body, headers)

    def wait(self, view: dict[str, Any], tell: Callable[[str], None]) -> dict[str, Any]:
        """Wait for the end of a submission and return it.

        Args:
            view: The submission.
            tell: Called with its state whenever that changes.
        """
        shown = ""
        answered = time.monotonic()
        while view["state"] in ("queued", "running"):
            place = view["queue_position"]
            text = f"number {place} in the queue" if place else "being scored"
            if text != shown:
                tell(text)
                shown = text
            time.sleep(_POLL_S)
            try:
                view = self._call(f"submissions/{view['id']}")
                answered = time.monotonic()
            except _UnavailableError:
                if time.monotonic() - answered > _PATIENCE_S:
                    raise
        return view

    def _call(
        self, path: str, body: Any = None, headers: dict[str, str] | None = None
    ) -> dict[str, Any]:
        head = {"Authorization": f"Bearer {self._token}", **(headers or {})}
        request = urllib.request.Request(f"{self._root}/api/v1/{path}", body, head)
        try:
            with _OPENER.open(request, timeout=_TIMEOUT_S) as answer:
                document: dict[str, Any] = json.load(answer)
                return document
        except urllib.error.HTTPError as error:
            with error:
                raise _refusal(error, self._root) from error
        except (OSError, ValueError) as error:
            reason = getattr(error, "reason", error)
            if isinstance(reason, ssl.SSLCertVerificationError):
                raise CallError(
                    "the service's certificate is not valid here",
                    path=self._root,
                    found=reason.verify_message,
                    fix="If you trust it, name its file in SSL_CERT_FILE.",
                ) from error
            raise _UnavailableError(
                _SILENT[0], path=self._root, found=str(reason), fix=_TRY_AGAIN
            ) from error


class _UnavailableError(CallError):
    """The service cannot be reached now."""


class _HearsRefusals(http.client.HTTPConnection):
    """Reads the answer of a service that refuses a file before all of it is sent."""

    def send(self, data: Any) -> None:
        """Send data, unless the other end has closed the connection."""
        try:
            super().send(data)
        except (BrokenPipeError, ConnectionResetError):
            if self.sock is None:  # it was never open
                raise


class _HearsRefusalsTls(_HearsRefusals, http.client.HTTPSConnection):
    """The same by TLS."""


class _Http(urllib.request.HTTPHandler):
    def http_open(self, req: urllib.request.Request) -> Any:
        return self.do_open(_HearsRefusals, req)


class _Https(urllib.request.HTTPSHandler):
    def https_open(self, req: urllib.request.Request) -> Any:
        return self.do_open(_HearsRefusalsTls, req)


_OPENER: Final = urllib.request.build_opener(_Http, _Https)


class _Watched:
    """A file that reports how much of it was read."""

    def __init__(self, stream: IO[bytes], size: int, progress: Progress) -> None:
        self._stream, self._size, self._progress = stream, size, progress

    def read(self, count: int = -1) -> bytes:
        """Read the next bytes."""
        data = self._stream.read(count)
        self._progress(self._stream.tell(), self._size)
        return data


def _refusal(error: urllib.error.HTTPError, address: str) -> CallError:
    kind = _UnavailableError if error.code in (502, 503, 504) else CallError
    try:
        found = json.load(error)
        message, code = str(found["message"]), str(found["code"])
    except (OSError, ValueError, KeyError, TypeError, http.client.HTTPException):
        if error.code in _OF_PROXIES:
            wrong, fix = _OF_PROXIES[error.code]
            return kind(wrong, path=address, found=f"status {error.code}", fix=fix)
        return kind(
            "this is not the answer of an evaluation service",
            path=address,
            found=f"status {error.code}",
            fix="Check the address: it is the one of the leaderboard's page.",
        )
    return kind(f"{message} ({code})")
