"""One guard for all local pages: nobody but the page gets anything, and no file but its own."""

from __future__ import annotations

import logging
import socket
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from pliant.spec.errors import CallError
from pliant.viewer.local_app import LocalServer, page_application, site_server
from tests.conftest import Refused
from tests.viewer.serving import ask, ask_for, below, served, serving


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A site with a file outside, links to it, and a file that begins with a dot."""
    root = tmp_path_factory.mktemp("web")
    (root / "secret").write_text("secret")
    site = root / "site"
    (site / "reports").mkdir(parents=True)
    (site / ".git").mkdir()
    (site / "index.html").write_text("<!doctype html>the board")
    for name in ("reports/one.html", ".env", ".git/config"):
        (site / name).write_text("one" if name.endswith("html") else "secret")
    (site / "link.html").symlink_to("../secret")
    (site / "own.html").symlink_to("reports/one.html")
    (site / "way").symlink_to("..")
    return site


@pytest.fixture(scope="module")
def site(folder: Path) -> Iterator[str]:
    with serving(site_server(folder)) as address:
        yield address


@pytest.fixture(scope="module")
def page(folder: Path) -> Iterator[str]:
    with served(partial(page_application, folder, [])) as at:
        yield at


def test_pages_are_served_to_this_machine(site: str, page: str) -> None:
    port = urlsplit(site).port
    assert site == f"http://127.0.0.1:{port}/"
    assert ask(site, "/") == (200, b"<!doctype html>the board")
    assert ask(site, "/reports/one.html", Host=f"localhost:{port}") == (200, b"one")
    assert ask(site, "/", "HEAD") == (200, b"")
    assert ask(site, "/reports/")[0] == 404  # nothing is listed
    assert urlsplit(page).hostname == "127.0.0.1"
    assert len(urlsplit(page).path.strip("/")) >= 20
    own = f"localhost:{urlsplit(page).port}"
    assert ask(page, below(page, ""), Host=own, Origin=f"http://{own}")[0] == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "127.0.0.1"},
        {"Host": "127.0.0.1:1"},
        {"Host": "127.0.0.1.evil.example:{port}"},
        {"Host": ""},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
        {"Origin": "https://127.0.0.1:{port}"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ],
)
def test_foreign_requests_are_refused(site: str, page: str, headers: dict[str, str]) -> None:
    for address in (site, page):
        port = urlsplit(address).port
        given: dict[str, Any] = {name: each.format(port=port) for name, each in headers.items()}
        for name in ("", "static/own.html"):
            status, body = ask(address, below(address, name), **given)
            assert status == 403
            assert body.startswith(b"Refused")


@pytest.mark.parametrize("token", ["", "guessed", "../", "%00", "%E2%82%AC"])
def test_the_address_needs_its_token(page: str, token: str) -> None:
    for path in (f"/{token}", f"/{token}/", f"/{token}/static/index.html", "/static/"):
        assert ask(page, path)[0] in (400, 403)


@pytest.mark.parametrize(
    "name",
    [
        *("../secret", "%2e%2e/secret", "reports/../../secret", "..%2fsecret", "/secret"),
        *("..%5csecret", "%2fetc%2fpasswd", "%00", "own.html", "link.html", "way/secret"),
        *("way/site/reports/one.html", ".env", ".git/config", "reports/../.env", "x" * 5000),
    ],
)
def test_no_file_outside_no_link_and_no_dotfile_is_read(site: str, page: str, name: str) -> None:
    for address, path in ((site, f"/{name}"), (page, below(page, f"static/{name}"))):
        status, body = ask(address, path)
        assert status in (400, 404)
        assert b"secret" not in body
        assert b"root:" not in body


ODD = {
    "CONNECT": (b"CONNECT evil.example:443 HTTP/1.1\r\nHost: {own}\r\n\r\n", b"405"),
    "OPTIONS *": (b"OPTIONS * HTTP/1.1\r\nHost: {own}\r\n\r\n", b"405"),
    "GET *": (b"GET * HTTP/1.1\r\nHost: {own}\r\n\r\n", b"400"),
    "whole address": (b"GET http://evil.example/ HTTP/1.1\r\nHost: {own}\r\n\r\n", b"400"),
    "no number": (b"POST / HTTP/1.1\r\nHost: {own}\r\nContent-Length: many\r\n\r\n", b"400"),
    "negative": (b"POST / HTTP/1.1\r\nHost: {own}\r\nContent-Length: -1\r\n\r\n", b"400"),
    "digits": (
        b"POST / HTTP/1.1\r\nHost: {own}\r\nContent-Length: " + b"9" * 5000 + b"\r\n\r\n",
        b"400",
    ),
    "no host": (b"GET / HTTP/1.1\r\n\r\n", b"400"),
    "two hosts": (b"GET / HTTP/1.1\r\nHost: {own}\r\nHost: evil.example\r\n\r\n", b"400"),
    "noise": (b"\x00\xff\xfe\r\n\r\n", b"400"),
    "long": (b"GET /" + b"x" * 10**6 + b" HTTP/1.1\r\n\r\n", b"400"),
}


@pytest.mark.parametrize("case", ODD)
def test_odd_requests_are_refused_and_nothing_is_printed(
    site: str, case: str, capfd: pytest.CaptureFixture[str]
) -> None:
    port = urlsplit(site).port
    request, status = ODD[case]
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        request = request.replace(b"{own}", f"127.0.0.1:{port}".encode())
        try:
            connection.sendall(request)
        except (BrokenPipeError, ConnectionResetError):
            assert case == "long"
        try:
            assert connection.recv(64).split()[1] == status
        except ConnectionResetError:
            assert case == "long"
    assert ask(site, "/")[0] == 200
    assert capfd.readouterr() == ("", "")


def test_browsers_are_kept_from_asking_others(site: str, page: str) -> None:
    headers = ask_for(page, below(page, ""))[0].headers
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "connect-src 'self'" in headers["Content-Security-Policy"]
    for answer in (headers, ask_for(site, "/")[0].headers, ask_for(site, "/no")[0].headers):
        assert answer["Referrer-Policy"] == "no-referrer"  # the token stays here
        assert answer["X-Content-Type-Options"] == "nosniff"
        assert answer["Cross-Origin-Resource-Policy"] == "same-origin"


def test_a_folder_that_is_no_site_is_refused(
    tmp_path: Path, folder: Path, refused: Refused
) -> None:
    said = refused(2, "serve", tmp_path, "--no-browser")
    assert "pliant leaderboard REPORTS --out SITE" in said
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        call = ("serve", folder, "--port", str(taken.getsockname()[1]), "--no-browser")
        said = refused(2, *call, "--host", "0.0.0.0", "--workers", "2")
        assert "--host, --workers: a site is served to this machine alone" in said
        with pytest.raises(CallError, match="the port cannot be used"):
            LocalServer(lambda token: page_application(folder, [], token), taken.getsockname()[1])


def test_the_programs_logging_stays_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Handlers may own their stream: absl's closes the standard error of a test run."""
    closed: list[logging.Handler] = []
    monkeypatch.setattr(logging.Handler, "close", closed.append)
    (tmp_path / "index.html").touch()
    site_server(tmp_path)._socket.close()
    assert closed == []
