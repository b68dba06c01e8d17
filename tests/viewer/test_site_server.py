"""`pliant serve`: a folder's own files, to this machine alone."""

from __future__ import annotations

import http.client
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from pliant.cli.main import run
from pliant.spec.errors import CallError
from pliant.viewer.site_server import make_site_server


@pytest.fixture
def port(tmp_path: Path) -> Iterator[int]:
    site = tmp_path / "site"
    (site / "reports").mkdir(parents=True)
    (site / "index.html").write_text("<!doctype html>the board")
    (site / "reports" / "one.html").write_text("one")
    (tmp_path / "secret").write_text("secret")
    server = make_site_server(site)
    assert server.server_address[0] == "127.0.0.1"
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield int(server.server_address[1])
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def ask(port: int, path: str, host: str = "") -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    try:
        connection.putrequest("GET", path, skip_host=True)
        connection.putheader("Host", host or f"127.0.0.1:{port}")
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def test_pages_are_served(port: int) -> None:
    assert ask(port, "/") == (200, b"<!doctype html>the board")
    assert ask(port, "/reports/one.html", f"localhost:{port}") == (200, b"one")
    assert ask(port, "/reports/")[0] == 404  # nothing is listed


@pytest.mark.parametrize(
    "path", ["/../secret", "/%2e%2e/secret", "/reports/../../secret", "/..%2fsecret", "//secret"]
)
def test_nothing_outside_is_read(port: int, path: str) -> None:
    assert ask(port, path)[0] == 404


def test_other_names_are_refused(port: int) -> None:
    assert ask(port, "/", "evil.example")[0] == 403


def test_a_folder_that_is_not_a_site_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(CallError, match="pliant site REPORTS"):
        make_site_server(tmp_path)
    assert run(["serve", str(tmp_path), "--no-browser"]) == 2
    assert run(["serve", str(tmp_path), "--out", str(tmp_path / "site")]) == 2
    said = capfd.readouterr().err.strip().splitlines()
    assert len(said) == 2
    assert "pliant site REPORTS --out SITE" in said[1]
