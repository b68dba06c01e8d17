"""The web process: who may send, read and change what; limits; faults of disk and database."""

from __future__ import annotations

import asyncio
import csv
import errno
import io
import os
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select, text

from pliant.evaluator import read_protocol
from pliant.evaluator.protocols.protocol import parse_protocol
from pliant.service.challenge import FolderStore
from pliant.service.models import Submission
from pliant.service.scoring import Result, Task
from pliant.service.settings import Scoring
from pliant.service.web import api
from pliant.service.web.app import make_app
from pliant.service.web.security import COOKIE
from tests.service.conftest import Halves, MakeTrial, Trial, quick

API = "/api/v1"
FIGURES_OF_STANDARD = read_protocol("standard").headline


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def submit(client: TestClient, token: str, content: bytes, **query: Any) -> Any:
    return client.post(f"{API}/submissions", content=content, headers=bearer(token), params=query)


@pytest.fixture
def client(trial: Trial) -> Iterator[TestClient]:
    with client_of(trial) as made:
        yield made


@pytest.fixture
def plain(make_trial: MakeTrial) -> Trial:
    """A challenge where the kind of database does not matter."""
    return make_trial()


@pytest.fixture
def plain_client(plain: Trial) -> Iterator[TestClient]:
    with client_of(plain) as made:
        yield made


def client_of(trial: Trial) -> TestClient:
    app = make_app(trial.challenge)
    return TestClient(app, raise_server_exceptions=True, follow_redirects=False)


def test_other_teams_and_visitors_see_only_what_is_public(trial: Trial, client: TestClient) -> None:
    ada, grace = trial.tokens
    sent = submit(client, ada, b"good", file_name="../mine.parquet").json()
    assert (sent["queue_position"], sent["file_name"]) == (1, "mine.parquet")
    waiting = sent["id"]
    for headers in ({}, bearer(grace)):
        assert client.get(f"{API}/submissions/{waiting}", headers=headers).status_code == 404
        assert client.get("/teams/2", headers=headers).status_code == 404  # not even Ada's name
    for token in (ada, trial.host):
        assert "Ada" in client.get("/teams/2", headers=bearer(token)).text
    trial.work()
    assert "Ada" in client.get("/teams/2").text
    refused = submit(client, ada, b"bad").json()["id"]
    trial.work()
    for headers in ({}, bearer(grace)):
        public = client.get(f"{API}/submissions/{waiting}", headers=headers).json()
        assert public["state"] == "scored"
        assert public["file_name"] is None
        for path in (f"{refused}", f"{refused}/receipt"):
            found = client.get(f"{API}/submissions/{path}", headers=headers)
            assert found.status_code == 404, path
        for number in (waiting, refused):
            found = client.get(f"{API}/submissions/{number}/file", headers=headers)
            assert found.status_code in (401, 404)
    own = client.get(f"{API}/submissions/{waiting}/file", headers=bearer(ada))
    assert own.content == b"good"
    assert own.headers["content-disposition"] == 'attachment; filename="submission-1.parquet"'
    assert client.get(f"{API}/submissions/{waiting}/file", headers=bearer(trial.host)).is_success
    assert client.get(f"{API}/submissions", headers=bearer(grace)).json() == []


def test_tokens(trial: Trial, client: TestClient) -> None:
    ada, _ = trial.tokens
    name, secrets = ada.split("_", 2)[1], [token.split("_", 2)[2] for token in trial.tokens]
    mixed = f"pliant_{name}_{secrets[1]}"
    for wrong in ("", "pliant_", mixed, ada[:-1], ada.upper(), "é" * 30):
        found = client.get(
            f"{API}/submissions", headers=[(b"Authorization", b"Bearer " + wrong.encode())]
        )
        assert found.status_code == 401, wrong
    with trial.challenge.database.read() as session:
        stored = " ".join(map(str, session.execute(text("SELECT * FROM token")).all()))
    assert not any(secret in stored for secret in secrets)
    signed_in, admin = SignedIn(client, ada), SignedIn(client, trial.host)
    assert admin.post("/admin/revoke", token_id=trial.who(ada).token_id).status_code == 303
    assert client.get(f"{API}/submissions", headers=bearer(ada)).status_code == 401
    assert signed_in.get(f"{API}/submissions").status_code == 401


def test_wrong_tokens_are_limited(plain: Trial, plain_client: TestClient) -> None:
    client = plain_client
    codes = [client.get(f"{API}/submissions", headers=bearer("x")).status_code for _ in range(12)]
    assert codes == [401] * 10 + [429] * 2
    assert client.post("/login", data={"token": plain.host}).status_code == 429


class SignedIn:
    """A browser that has signed in.

    Args:
        client: The connection, which keeps no cookie.
        token: The token.
    """

    def __init__(self, client: TestClient, token: str) -> None:
        answer = client.post("/login", data={"token": token})
        assert answer.status_code == 303
        cookie = answer.headers["set-cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=lax" in cookie
        client.cookies.clear()
        self._client = client
        self.headers = {"Cookie": f"{COOKIE}={cookie.partition('=')[2].partition(';')[0]}"}
        self.csrf = self.get("/submissions").text.partition('name="csrf" value="')[2].split('"')[0]

    def get(self, path: str) -> Any:
        return self._client.get(path, headers=self.headers)

    def post(self, path: str, *, file: bytes | None = None, **form: Any) -> Any:
        files = None if file is None else {"file": ("a", file)}
        data = {"csrf": self.csrf, **form}
        return self._client.post(path, data=data, files=files, headers=self.headers)


def test_forms_need_their_own_page(plain: Trial, plain_client: TestClient) -> None:
    client, host = plain_client, SignedIn(plain_client, plain.host)
    whole = {"name": "Eve", "csrf": host.csrf}
    elsewhere = {**host.headers, "Origin": "https://elsewhere.example"}
    wrong = [
        client.post("/admin/invite", data={"name": "Eve"}, headers=host.headers),
        host.post("/admin/invite", name="Eve", csrf="x"),
        client.post("/admin/invite", data=whole, headers=elsewhere),
        client.post(f"{API}/submissions", content=b"x", headers=host.headers),
        client.post("/admin/invite", data=whole),
    ]
    assert [each.status_code for each in wrong] == [422, 403, 403, 401, 401]
    assert "shown this once" in host.post("/admin/invite", name="Eve").text
    ada = SignedIn(client, plain.tokens[0])
    assert [ada.get(path).status_code for path in ("/admin", "/admin/audit")] == [404, 404]
    assert ada.post("/admin/credit", team=2, phase="test", amount=5).status_code == 404
    signed_out = [ada.post("/logout") for _ in range(2)]  # in two tabs
    assert [each.headers["location"] for each in signed_out] == ["/", "/"]


def test_a_proxy_that_passes_its_own_host_name_on(plain: Trial) -> None:
    """As nginx does by default; browsers name the origin that they see."""
    app = make_app(plain.challenge, "https://challenge.example.org")
    with TestClient(app, follow_redirects=False) as client:
        for origin, status in (("challenge.example.org", 303), ("elsewhere.example", 403)):
            headers = {"Origin": f"https://{origin}"}
            signed_in = client.post("/login", data={"token": plain.host}, headers=headers)
            assert signed_in.status_code == status
        assert client.get("/rules/").status_code == 404  # and leads to no name of this machine


def test_an_error_page_does_not_ask_a_team_to_sign_in_again(
    plain: Trial, plain_client: TestClient
) -> None:
    page = SignedIn(plain_client, plain.tokens[0]).get("/submissions/99")
    assert page.status_code == 404
    assert "Sign in" not in page.text
    assert "Sign out" in page.text
    for path in ("/nothing", "/data/nothing"):
        assert "Sign out" in SignedIn(plain_client, plain.tokens[0]).get(path).text
        assert '<a href="/login">Sign in</a>' in plain_client.get(path).text


def test_upload_by_form(make_trial: MakeTrial) -> None:
    trial = make_trial("max_file_mb: 0.2\n")
    with client_of(trial) as client:
        ada = SignedIn(client, trial.tokens[0])
        sent = ada.post("/submit", file=b"good", phase="test")
        assert sent.headers["location"] == "/submissions/1"
        assert ada.post("/submit", file=b"x" * 500_000, phase="test").status_code == 413
        assert ada.post("/submit", phase="test").status_code == 400
        assert submit(client, trial.tokens[0], b"x" * 250_000).status_code == 413
        assert submit(client, trial.tokens[0], b"").json()["message"] == "the file is empty"
        long = {"file": ("n" * 300 + "-7.parquet", b"long")}
        form = {"csrf": ada.csrf, "phase": "test"}
        client.post("/submit", data=form, files=long, headers=ada.headers)
        assert f">{'n' * 59}…{'n' * 50}-7.parquet<" in ada.get("/submissions").text
        assert not list(trial.challenge.incoming.glob("*.parquet"))


TWO_PHASES = """
phases:
- {name: first, split: test, attempts_total: 1, show: last}
- {name: second, split: test}
"""


def test_a_client_that_lost_the_answer_to_its_last_attempt(make_trial: MakeTrial) -> None:
    trial = make_trial(TWO_PHASES)
    with client_of(trial) as client:
        first = submit(client, trial.tokens[0], b"last")
        assert first.status_code == 201
        refused = submit(client, trial.tokens[0], b"next")
        assert refused.json()["code"] == "QUOTA_EXCEEDED"
        assert "retry-after" not in refused.headers  # a client would send it again and again
        assert submit(client, trial.tokens[0], b"longer").json()["code"] == "QUOTA_EXCEEDED"
        again = submit(client, trial.tokens[0], b"last")
        assert (again.status_code, again.json()["id"]) == (200, first.json()["id"])
        ada = SignedIn(client, trial.tokens[0])
        form = ada.post("/submit", file=b"last", phase="first")
        assert (form.status_code, form.headers["location"]) == (303, "/submissions/1?again=1")
        assert "sent this file before" in ada.get("/submissions/1?again=1").text
        stored = [path for path in (trial.challenge.root / "submissions").rglob("*.parquet")]
        assert len(stored) == 1


def test_a_file_that_is_refused_at_the_last_moment_is_not_stored(
    make_trial: MakeTrial, monkeypatch: pytest.MonkeyPatch
) -> None:
    trial = make_trial(TWO_PHASES)
    stored = trial.challenge.root / "submissions"
    # Before the transfer, an attempt was left.
    monkeypatch.setattr("pliant.service.web.uploads.check_allowed", lambda *_, **__: 0)
    with client_of(trial) as client:
        assert submit(client, trial.tokens[0], b"last").status_code == 201
        assert submit(client, trial.tokens[0], b"next").json()["code"] == "QUOTA_EXCEEDED"
        assert [path.read_bytes() for path in stored.rglob("*.parquet")] == [b"last"]
        assert submit(client, trial.tokens[1], b"next").status_code == 201
        assert submit(client, trial.tokens[0], b"next").json()["code"] == "QUOTA_EXCEEDED"
        assert len(list(stored.rglob("*.parquet"))) == 2


def test_pages_show_the_digits_that_decide_ranks(plain: Trial, plain_client: TestClient) -> None:
    def close(task: Task, limits: Scoring) -> Result:
        figures = {"overall": {"rmse_px": 131.7, "pck_8px": 0.03535}}
        return replace(quick(task, limits), figures={task.versions[0][0]: figures})

    plain.send(b"good")
    plain.work(close)
    team = plain.who(plain.tokens[0]).team_id
    for page in ("/", f"/teams/{team}", "/submissions/1"):
        shown = SignedIn(plain_client, plain.tokens[0]).get(page).text
        assert "131.7</td>" in shown
        assert "0.03535</td>" in shown


def test_a_submission_without_the_figure_that_ranks_has_no_rank(
    plain: Trial, plain_client: TestClient
) -> None:
    def without(task: Task, limits: Scoring) -> Result:
        figures = {"overall": {"rmse_px": None, "pck_8px": 0.5}}
        return replace(quick(task, limits), figures={task.versions[0][0]: figures})

    plain.send(b"without", team=1)
    plain.work(without)
    plain.send(b"good")
    plain.work()
    board = plain_client.get(f"{API}/leaderboard").json()
    assert [(row["rank"], row["team"]) for row in board["rows"]] == [(1, "Ada"), (None, "Grace")]
    rows = csv.DictReader(io.StringIO(plain_client.get(f"{API}/leaderboard.csv").text))
    assert [(row["rank"], row["team"]) for row in rows] == [("1", "Ada"), ("", "Grace")]
    page = plain_client.get("/").text
    assert re.search(r'Grace</a><small>quick</small></th><td data-key="">–</td>', page)
    assert "submissions without this figure have none" in page


def test_the_csv_of_a_page_of_submissions_has_the_same_ones(
    plain: Trial, plain_client: TestClient
) -> None:
    for content in (b"first", b"second"):
        plain.send(content)
    team = SignedIn(plain_client, plain.tokens[0])
    for page, numbers in (("/submissions", ["2", "1"]), ("/submissions?before=2", ["1"])):
        text = team.get(page).text
        assert re.findall(r'href="/submissions/(\d+)"', text) == numbers
        (link,) = re.findall(r'href="([^"]*submissions\.csv[^"]*)"', text)
        rows = csv.DictReader(io.StringIO(team.get(link).text))
        assert [row["id"] for row in rows] == numbers


def test_a_full_page_links_to_earlier_submissions_if_there_are_some(
    plain: Trial, plain_client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(api, "_PAGE", 2)
    team = SignedIn(plain_client, plain.tokens[0])
    for content, linked in ((b"1", False), (b"2", False), (b"3", True)):
        plain.send(content)
        assert ("Earlier ones" in team.get("/submissions").text) == linked
        assert len(team.get(f"{API}/submissions").json()) <= 2


def test_times_of_phases_are_shown_in_utc(make_trial: MakeTrial) -> None:
    trial = make_trial(
        "phases:\n- {name: later, split: test, opens: 2199-03-01T00:00:00+09:00}\n"
        "- {name: brief, split: test, closes: 2199-03-01T00:00:30.5Z}\n"
    )
    with client_of(trial) as client:
        assert "upcoming, opens 2199-02-28 15:00 UTC;" in client.get("/?phase=later").text
        assert "open, closes 2199-03-01 00:00:30 UTC;" in client.get("/?phase=brief").text
        for moment in ("2199-02-28 15:00", "2199-03-01 00:00:30"):
            assert f"<td>{moment} UTC</td>" in client.get("/rules").text
        refused = submit(client, trial.tokens[0], b"early", phase="later").json()
        assert refused["message"] == "phase later is upcoming; found opens 2199-02-28 15:00 UTC"


def test_what_opens_first(make_trial: MakeTrial) -> None:
    trial = make_trial(TWO_PHASES)
    with client_of(trial) as client:
        assert client.get(f"{API}/leaderboard").json()["show"] == "last"
        assert client.get(f"{API}/leaderboard?phase=second").json()["show"] == "best"
        for token in (trial.tokens[0], trial.host):
            page = SignedIn(client, token).get("/submit").text
            chosen = re.findall(r'value="(\w+)" checked', page)
            assert chosen == ["first"]
        assert (
            "first: 1 today, 1 in all<br>second: 5 today"
            in SignedIn(client, trial.host).get("/admin").text
        )
        assert "--to http://testserver --token" in client.get("/rules").text


def test_between_two_rounds_the_results_of_the_first_are_shown(make_trial: MakeTrial) -> None:
    rounds = (
        "{name: r1, split: test, closes: 2026-01-01T00:00:00Z}",
        "{name: r2, split: test, opens: 2199-01-01T00:00:00Z}",
        "{name: r3, split: test, opens: 2199-02-01T00:00:00Z}",
    )
    for some, phase in ((rounds, "r1"), (rounds[1:], "r2")):
        trial = make_trial(f"phases: [{', '.join(some)}]")
        with client_of(trial) as client:
            assert client.get(f"{API}/leaderboard").json()["phase"] == phase
            page = client.get("/").text
            assert "submit a file" not in page
            assert ("closed since 2026-01-01 00:00 UTC;" in page) == (phase == "r1")
            for token, closed in ((trial.tokens[0], True), (trial.host, False)):
                form = SignedIn(client, token).get("/submit").text
                assert ('<button class="main" disabled>' in form) == closed
                assert "upcoming, opens 2199-01-01 00:00 UTC<" in form


def test_a_form_in_place_of_the_file_is_refused(plain: Trial, plain_client: TestClient) -> None:
    """`curl -F file=@mine.parquet` is a habit."""
    sent = plain_client.post(
        f"{API}/submissions", files={"file": b"PAR1"}, headers=bearer(plain.tokens[0])
    )
    assert (sent.status_code, sent.json()["code"]) == (415, "FILE_IN_FORM")
    assert "`curl -T`" in sent.json()["message"]


def test_a_misspelt_parameter_charges_nothing(plain: Trial, plain_client: TestClient) -> None:
    sent = submit(plain_client, plain.tokens[0], b"good", **{"check-only": "true"})
    assert (sent.status_code, sent.json()["code"]) == (422, "PARAMETER_INVALID")
    assert "query.check-only" in sent.json()["message"]
    assert plain.values(select(Submission)) == []


@pytest.mark.parametrize(("stopped", "status"), [(False, 400), (True, 503)])
def test_a_client_or_a_service_that_goes_away(plain: Trial, stopped: bool, status: int) -> None:
    """The transfer ends early: no fault of the service, so no traceback in its log."""
    sent: list[dict[str, Any]] = []
    half = {"type": "http.request", "body": b"half", "more_body": True}
    left: list[dict[str, Any]] = [half, {"type": "http.disconnect"}]

    async def receive() -> dict[str, Any]:
        if stopped and len(left) == 1:
            raise asyncio.CancelledError  # as uvicorn does when it stops
        return left.pop(0)

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    scope = {
        "type": "http", "method": "POST", "path": f"{API}/submissions", "query_string": b"",
        "headers": [(b"authorization", f"Bearer {plain.tokens[0]}".encode())],
    }  # fmt: skip
    asyncio.run(make_app(plain.challenge)(scope, receive, send))  # type: ignore[arg-type]
    assert sent[0]["status"] == status
    assert not list(plain.challenge.incoming.iterdir())


def test_the_protocol_that_scores_can_be_downloaded(plain_client: TestClient) -> None:
    address = f"{API}/protocols/{read_protocol('standard').sha256}"
    assert f'href="{address}"' in plain_client.get("/").text
    assert f'href="{address}"' in plain_client.get("/rules").text
    given = plain_client.get(address)
    assert parse_protocol(given.content).sha256 == read_protocol("standard").sha256
    assert "attachment" in given.headers["content-disposition"]
    assert plain_client.get(f"{API}/protocols/{'0' * 64}").json()["code"] == "NOT_FOUND"
    assert plain_client.get(f"{API}/protocols/..%2f..%2fchallenge").status_code in (404, 422)


def test_download_in_ranges(plain_client: TestClient, service_halves: Halves) -> None:
    name, client = "sequences.parquet", plain_client
    whole = (service_halves.public / name).read_bytes()
    part = client.get(f"/data/{name}", headers={"Range": "bytes=10-19"})
    assert part.status_code == 206
    assert part.content == whole[10:20]
    assert client.get(f"/data/{name}").content == whole
    escapes = ("../challenge.yaml", "%2e%2e/challenge.sqlite", "..%2fkeys", "x%00y", "a" * 999)
    for path in escapes:
        assert client.get(f"/data/{path}").status_code == 404, path
    known = {"If-None-Match": client.head(f"/data/{name}").headers["etag"]}
    assert client.get(f"/data/{name}", headers=known).status_code == 304


def test_headers_and_operations(plain_client: TestClient) -> None:
    page = plain_client.get("/")
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert page.headers["x-content-type-options"] == "nosniff"
    assert plain_client.get("/healthz").text == "ok"
    for path in ("/", "/healthz", "/static/service.css", "/data"):  # monitors and link checkers
        assert plain_client.head(path).status_code == 200
    missing = plain_client.get(f"{API}/nope")
    assert (missing.status_code, missing.json()["code"]) == (404, "NOT_FOUND")
    assert plain_client.get("/no/such/page").status_code == 404
    wrong = plain_client.put(f"{API}/submissions")
    assert (wrong.status_code, wrong.headers["allow"]) == (405, "POST")


def test_a_full_disk_charges_nothing(
    trial: Trial, client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: FolderStore, file: Path, sha256: str) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(FolderStore, "copied", full)
        answer = submit(client, trial.tokens[0], b"good")
    assert answer.status_code == 507
    assert answer.json()["code"] == "DISK_FULL"
    assert not list(trial.challenge.incoming.glob("*.parquet"))
    assert client.get(f"{API}/submissions", headers=bearer(trial.tokens[0])).json() == []
    assert submit(client, trial.tokens[0], b"good").status_code == 201


def test_a_locked_database_is_a_503(make_trial: MakeTrial, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pliant.service.database.BUSY_S", 0.2)
    trial = make_trial()
    with client_of(trial) as client, trial.challenge.database.write():
        answer = submit(client, trial.tokens[0], b"good")
        assert answer.status_code == 503
        assert answer.json()["code"] == "DATABASE_UNREACHABLE"
        assert "retry-after" in answer.headers
        assert client.get("/").status_code == 200
    with client_of(trial) as client:
        assert submit(client, trial.tokens[0], b"good").status_code == 201


def test_withdraw_credit_and_rescore_by_the_host(trial: Trial, client: TestClient) -> None:
    submit(client, trial.tokens[0], b"good")
    submit(client, trial.tokens[1], b"good too")
    trial.work()
    host = SignedIn(client, trial.host)
    # What is final takes a second step, which works without JavaScript.
    for path, action in (("/submissions/1", "withdraw"), ("/admin", "revoke")):
        form = f'<form [^>]*action="/admin/{action}"'
        found = host.get(path).text
        guarded = re.findall(f"<details[^>]*><summary[^>]*>(?:(?!</?details).)*?{form}", found)
        assert len(guarded) == len(re.findall(form, found)) > 0
    assert host.post("/admin/withdraw", submission=1).status_code == 303
    board = client.get(f"{API}/leaderboard").json()
    assert [row["team"] for row in board["rows"]] == ["Grace"]
    assert '<span class="state withdrawn">' in host.get("/submissions/1").text
    assert client.get(f"{API}/submissions/1").status_code == 404
    table = csv.DictReader(io.StringIO(host.get(f"{API}/submissions.csv").text))
    assert [row["state"] for row in table] == ["scored", "withdrawn"]
    assert host.post("/admin/credit", team=2, phase="test", amount=3).status_code == 303
    page = host.post(
        "/admin/rescore", phase="test", protocol="paper", reason="the paper's figures"
    ).text
    assert "2 submissions wait" in page
    trial.work()
    view = client.get(f"{API}/submissions/2").json()
    assert [each["protocol"].split()[0] for each in view["scores"]] == ["standard", "paper"]
    page = host.get("/admin").text
    bits = 13.1357 * (len(FIGURES_OF_STANDARD) + 3)
    assert f"<td>{bits:.0f}</td>" in page  # given away by one submission
    log = host.get("/admin/audit").text
    for action in ("withdrawn", "credited", "version added", "rescored"):
        assert action in log
