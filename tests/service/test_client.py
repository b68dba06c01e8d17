"""What `pliant submit` says when a service refuses a file, or is not one."""

from __future__ import annotations

import socket
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509 import CertificateBuilder, Name, NameAttribute
from cryptography.x509.oid import NameOID

from pliant.cli.submit import print_submission
from pliant.service.client import Client
from pliant.spec.errors import CallError

REFUSED = b'{"code": "FILE_TOO_LARGE", "message": "the file is too large"}'
STRANGER = b"<html>Not here</html>"


@contextmanager
def answering(status: str, body: bytes, context: ssl.SSLContext | None = None) -> Iterator[str]:
    """Run a server that answers each request before it has read it, and closes the connection."""
    head = f"HTTP/1.1 {status}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while True:
                try:
                    connection = server.accept()[0]
                except OSError:
                    return
                with connection, suppress(ssl.SSLError):
                    if context is not None:
                        connection = context.wrap_socket(connection, server_side=True)
                    connection.recv(100)
                    connection.sendall(head.encode() + body)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"{'http' if context is None else 'https'}://127.0.0.1:{server.getsockname()[1]}"
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


def test_a_certificate_that_is_not_known(large: Path, tmp_path: Path) -> None:
    key, name = Ed25519PrivateKey.generate(), Name([NameAttribute(NameOID.COMMON_NAME, "host")])
    now = datetime.now(UTC)
    made = CertificateBuilder(name, name, key.public_key(), 1, now, now + timedelta(1))
    held = tmp_path / "both.pem"
    held.write_bytes(
        key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        + made.sign(key, None).public_bytes(Encoding.PEM)
    )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(held)
    message = r"self-signed certificate.*SSL_CERT_FILE"
    with (
        answering("413 Too Large", REFUSED, context) as address,
        pytest.raises(CallError, match=message),
    ):
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


def test_hidden_scores_are_announced_where_a_file_was_scored(
    capsys: pytest.CaptureFixture[str],
) -> None:
    view = {"id": 1, "issues": [], "failure": None, "scores": [], "hidden_until": "2199-03-01"}
    print_submission({**view, "state": "queued"}, "URL")
    assert "hidden" not in capsys.readouterr().out
    print_submission({**view, "state": "scored"}, "URL")
    assert "hidden until 2199-03-01." in capsys.readouterr().out
