"""Nobody but the page itself gets anything from the server, and no file but its own."""

from __future__ import annotations

import http.client
from urllib.parse import quote, urlsplit

import pytest


def ask(address: str, path: str, method: str = "GET", **headers: str) -> tuple[int, bytes]:
    """Send a path exactly as it is given; return status and body."""
    place = urlsplit(address)
    connection = http.client.HTTPConnection(str(place.hostname), place.port, timeout=20)
    try:
        connection.putrequest(method, path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def below(address: str, name: str) -> str:
    return urlsplit(address).path + name


def test_the_page_is_served_to_this_machine(address: str) -> None:
    assert urlsplit(address).hostname == "127.0.0.1"
    assert len(urlsplit(address).path.strip("/")) >= 20
    status, body = ask(address, below(address, ""))
    assert status == 200
    assert b"<!doctype html>" in body
    port = urlsplit(address).port
    own = {"Host": f"localhost:{port}", "Origin": f"http://localhost:{port}"}
    assert ask(address, below(address, "api/dataset"), **own)[0] == 200


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
def test_foreign_requests_are_refused(address: str, headers: dict[str, str]) -> None:
    port = urlsplit(address).port
    given = {name: value.format(port=port) for name, value in headers.items()}
    for name in ("", "api/dataset", "static/main.js"):
        status, body = ask(address, below(address, name), **given)
        assert status == 403
        assert body.startswith(b"Refused")


@pytest.mark.parametrize("token", ["", "guessed", "../", "%00"])
def test_the_address_needs_its_token(address: str, token: str) -> None:
    for path in (f"/{token}", f"/{token}/", f"/{token}/api/dataset", "/api/dataset", "/static/"):
        assert ask(address, path)[0] == 403


@pytest.mark.parametrize(
    "name",
    [
        "static/../app.py",
        "static/../../../../../../../etc/passwd",
        "static/..%2fapp.py",
        "static/%2e%2e/app.py",
        "static/%2e%2e%2fapp.py",
        "static/..%5capp.py",
        "static//etc/passwd",
        "static/%2fetc%2fpasswd",
        "static/vendor/..%2f..%2fguard.py",
        "static/%00",
        "static",
        "static/vendor",
    ],
)
def test_no_file_outside_static_is_read(address: str, name: str) -> None:
    status, body = ask(address, below(address, name))
    assert status in (307, 404)
    assert b"import" not in body
    assert b"root:" not in body


@pytest.mark.parametrize(
    "frame", ["../../dataset/0", "rope-test-000000/../0", "rope-test-000000/-1", "/0", "x/9999", ""]
)
def test_frames_are_looked_up_and_never_paths(address: str, frame: str) -> None:
    for call in ("layer?layer=rgb&frame=", "scene?frame=", "pose?frame=", "truth?u=1&v=1&b=x/0&a="):
        status, body = ask(address, below(address, f"api/{call}{quote(frame, safe='')}"))
        assert status == 400
        assert b"no such frame" in body


def test_wrong_parameters_get_one_sentence(address: str) -> None:
    pair = "a=rope-test-000000/0&b=rope-test-000001/0"
    for call, said in (
        (f"truth?{pair}&u=nan&v=1", b"two numbers"),
        (f"truth?{pair}", b"two numbers"),
        (f"answer?{pair}&u=1&v=1&method=7", b"unknown method"),
        (f"answer?{pair}&u=1&v=1", b"unknown method"),
        ("layer?layer=secret&frame=rope-test-000000/0", b"unknown layer"),
        ("truth?a=rope-test-000000/0&b=cloth-1-test-000000/0&u=1&v=1", b"different tiers"),
    ):
        status, body = ask(address, below(address, f"api/{call}"))
        assert (status, said in body) == (400, True), body


def test_nothing_can_be_written(address: str) -> None:
    for method in ("POST", "PUT", "DELETE", "PATCH"):
        assert ask(address, below(address, "api/dataset"), method)[0] == 405


def test_the_browser_is_kept_from_asking_others(address: str) -> None:
    place = urlsplit(address)
    connection = http.client.HTTPConnection(str(place.hostname), place.port, timeout=20)
    try:
        connection.request("GET", place.path)
        answer = connection.getresponse()
        policy = answer.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "connect-src 'self'" in policy
        assert answer.headers["Referrer-Policy"] == "no-referrer"  # the token stays here
        answer.read()
    finally:
        connection.close()
