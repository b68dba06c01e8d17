"""HTTP requests as bytes, given to the service and to the pages of the viewer without a network.

GET /api/v1/leaderboard?phase=test
authorization: Bearer TEAM

BODY
"""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import h11

from pliant.baselines import METHODS
from pliant.publishing import PublishSettings, publish
from pliant.service.challenge import Challenge
from pliant.service.creation import create_challenge
from pliant.service.teams import begin_session, identify, identify_session, invite
from pliant.service.web.app import make_app
from pliant.spec.dataset import Dataset
from pliant.spec.io.png import write_rgb
from pliant.spec.opening import SAMPLE
from pliant.viewer.annotate_app import annotate_application
from pliant.viewer.annotation import Annotation
from pliant.viewer.explorer.app import open_explorer
from pliant.viewer.local_app import site_application
from tests.fuzz.reader import ROOT

DATA: Final = ROOT / "spec" / "conformance" / "datasets" / "full"
HOST: Final = b"127.0.0.1:80"
_client: Final = count()


def send(application: Any, data: bytes, tokens: dict[bytes, bytes]) -> int:
    """Send a request, and return its status.

    Args:
        application: An ASGI application.
        data: The request; its first line names no version of HTTP.
        tokens: Placeholder in a request -> the token that the service drew when it started.

    Raises:
        AssertionError: The answer is a fault of the server, or there is none.
    """
    for public, secret in tokens.items():
        data = data.replace(public, secret)
    head, _, body = data.partition(b"\n\n")
    first, *lines = head.split(b"\n")
    method, _, target = first.partition(b" ")
    headers = [(b"host", HOST), (b"content-length", str(len(body)).encode())]
    for line in lines:
        name, _, value = line.partition(b":")
        headers.append((name.strip().lower(), value.strip()))
    try:  # what the web server refuses does not reach the application
        h11.Request(method=method, target=target, headers=headers)
    except h11.LocalProtocolError:
        return 400
    path, _, query = target.partition(b"?")
    number = next(_client)
    scope = {
        "type": "http",
        "asgi": {"version": "3.0", "spec_version": "2.3"},
        "http_version": "1.1",
        "method": method.decode(),
        "scheme": "http",
        "path": unquote(path.decode()),
        "raw_path": path,
        "query_string": query,
        "root_path": "",
        "headers": headers,
        "client": (f"10.{number >> 16 & 255}.{number >> 8 & 255}.{number & 255}", 1),
        "server": ("127.0.0.1", 80),
    }
    return _loop().run_until_complete(_answered(application, scope, body))


async def _answered(application: Any, scope: dict[str, Any], body: bytes) -> int:
    received = iter([{"type": "http.request", "body": body, "more_body": False}])
    status: list[int] = []

    async def receive() -> dict[str, Any]:
        return next(received, {"type": "http.disconnect"})

    async def answer(message: dict[str, Any]) -> None:
        if message["type"] == "http.response.start":
            status.append(message["status"])

    await application(scope, receive, answer)
    assert max(status, default=500) < 500, (status, scope["method"], scope["path"])
    return status[0]


@cache
def _loop() -> asyncio.AbstractEventLoop:
    return asyncio.new_event_loop()


@cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="pliant-fuzz-")


@cache
def service() -> tuple[Any, dict[bytes, bytes]]:
    """Return the service of a small challenge, and the tokens of its host and of a team."""
    place = Path(_scratch().name)
    facts = publish(
        DATA, place / "data", PublishSettings(hold_out=("test",), answers_are_public=True)
    )
    assert facts.private is not None
    host = create_challenge(place / "challenge", place / "data", facts.private, ["test"])
    challenge = Challenge.open(place / "challenge")
    with challenge.database.write() as session:
        tokens = {"HOST": host, "TEAM": invite(session, "Ada", actor="host")[1]}
        who = identify(session, host)
        assert who is not None
        tokens["COOKIE"] = begin_session(session, who)
        signed_in = identify_session(session, tokens["COOKIE"])
        assert signed_in is not None
        tokens["CSRF"] = signed_in.csrf
    return make_app(challenge), {key.encode(): value.encode() for key, value in tokens.items()}


@cache
def viewer() -> tuple[Any, ...]:
    """Return the explorer of the sample, a page of annotations, and a plain site."""
    place = Path(_scratch().name)
    pictures, site = place / "pictures", place / "site"
    shutil.copytree(SAMPLE, site)
    (site / "index.html").write_text("<h1>site</h1>")
    pictures.mkdir()
    dataset = Dataset.open(SAMPLE)
    for frame in range(2):
        write_rgb(pictures / f"{frame}.png", dataset.frame("rope-train-000000", frame).rgb)
    explorer = open_explorer(dataset, ["identity"], lambda name: METHODS[name]())
    return (
        explorer.application("explore"),
        annotate_application(Annotation(pictures), None, "annotate"),
        site_application(site),
    )


def service_requests() -> list[bytes]:
    """Return requests that the service answers."""
    host, cookie = b"authorization: Bearer HOST\n", b"cookie: pliant_session=COOKIE\n"
    form = cookie + b"content-type: application/x-www-form-urlencoded\n\ncsrf=CSRF&"
    file = (ROOT / "spec" / "conformance" / "submissions" / "perfect.parquet").read_bytes()
    asked = (
        *("", "rules", "data", "data/dataset.json", "submit", "submissions", "submissions/1"),
        *("login", "teams/1", "admin", "admin/audit?before=3", "healthz", "metrics"),
        *("static/style.css", "?phase=test&version=1&show=last"),
        *(
            f"api/v1/{name}"
            for name in (
                *("challenge", "leaderboard?phase=test&version=1", "leaderboard.csv", "key"),
                *("submissions?before=9", "submissions.csv", "submissions/1", "openapi.json"),
                *("submissions/1/file", "submissions/1/receipt", "submissions/1/events"),
            )
        ),
    )
    posted = {
        "admin/invite": b"name=Grace",
        "admin/token": b"team=2",
        "admin/revoke": b"token_id=aaaa",
        "admin/credit": b"team=2&phase=test&amount=3",
        "admin/withdraw": b"submission=1",
        "admin/rescore": b"phase=test&protocol=standard&reason=new",
        "submit": b"phase=test&check_only=yes",
        "login": b"token=TEAM&next=/submit",
    }
    return [
        *(b"GET /" + path.encode() + b"\n" + (cookie, host)[path[:3] == "api"] for path in asked),
        *(b"POST /" + path.encode() + b"\n" + form + values for path, values in posted.items()),
        b"POST /api/v1/submissions?phase=test&file_name=a.parquet\n" + host + b"\n" + file,
        b"POST /api/v1/submissions?check_only=true\nauthorization: Bearer TEAM\n\n" + file,
    ]


def viewer_requests() -> list[bytes]:
    """Return requests that the pages of the viewer answer."""
    pair = "a=rope-train-000000/0&b=rope-train-000000/1"
    marks = b'{"points": ["end"], "marks": {"0.png": {"end": [1.5, 2.5, true, "person"]}}}'
    asked = (
        *("", "static/explore.js", "api/dataset", f"api/truth?{pair}&u=100.5&v=90"),
        f"api/answer?{pair}&u=100.5&v=90&method=0",
        *(f"api/{name}?{pair}&method=0" for name in ("warm", "queries", "error")),
        *(f"api/{name}?frame=rope-train-000000/0" for name in ("scene", "pose", "depth")),
        *(f"api/layer?layer={name}&frame=rope-train-000000/0" for name in ("rgb", "mask")),
        f"api/layer?layer=error&{pair}&method=0&of=b",
    )
    return [
        *(b"GET /explore/" + path.encode() for path in asked),
        *(b"GET /annotate/" + path for path in (b"state", b"picture/0", b"static/annotate.js")),
        b"POST /annotate/marks\norigin: http://127.0.0.1:80\n\n" + marks,
        b"GET /index.html",
        b"GET /dataset.json\nrange: bytes=0-5,7-9\nsec-fetch-site: none",
        b"HEAD /folders/../dataset.json\nif-none-match: x",
    ]


def to_service(path: Path) -> int:
    return send(service()[0], path.read_bytes(), service()[1])


def to_viewer(path: Path) -> int:
    data = path.read_bytes()
    pages = dict(zip((b"explore", b"annotate"), viewer(), strict=False))
    token = data.partition(b" ")[2].lstrip(b"/").partition(b"/")[0]
    return send(pages.get(token, viewer()[2]), data, {})
