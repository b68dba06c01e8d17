"""A phase whose scores are hidden until it closes: nothing shows them before, everything after."""

from __future__ import annotations

from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from pliant.service.settings import read_challenge_settings
from pliant.service.site import write_challenge_site
from pliant.spec.errors import CallError
from tests.service.conftest import FIGURES, MakeTrial, Trial
from tests.service.test_api import API, bearer, client_of, submit

FIGURE = str(FIGURES["overall"]["rmse_px"])
CLOSES = "2199-03-01T00:00:00Z"
RULES = f"phases:\n- {{name: final, split: test, closes: {CLOSES}, hidden_until_close: true}}\n"
WITH_SCORES = (
    "/",
    "/?show=last",
    "/?version=1",
    "/teams/2",
    "/teams/2?version=1",
    "/submissions/1",
    f"{API}/leaderboard",
    f"{API}/leaderboard?version=1&show=best",
    f"{API}/leaderboard.csv",
    f"{API}/submissions/1",
    f"{API}/submissions/1/receipt",
    f"{API}/submissions/1/receipt?version=1",
)
PLACES = (*WITH_SCORES, "/rules", "/submissions", f"{API}/submissions", f"{API}/submissions.csv")


@pytest.fixture
def trial(make_trial: MakeTrial) -> Trial:
    """A challenge with hidden scores, to which the first team has sent a file."""
    made = make_trial(RULES)
    assert made.send(b"good") == 1
    made.work()
    return made


def seen(client: TestClient, token: str | None) -> dict[str, str]:
    """Return what somebody is shown at each place."""
    headers = {} if token is None else bearer(token)
    return {place: client.get(place, headers=headers).text for place in PLACES}


def test_scores_are_hidden_from_all_but_the_host_until_the_phase_closes(trial: Trial) -> None:
    own, other = trial.tokens
    with client_of(trial) as client:
        for token in (None, own, other):
            assert not [place for place, text in seen(client, token).items() if FIGURE in text]
        for token in (None, other):
            assert not [place for place, text in seen(client, token).items() if "Ada" in text]
        assert FIGURE in client.get(f"{API}/leaderboard", headers=bearer(trial.host)).text
        assert FIGURE in client.get(f"{API}/submissions/1/receipt", headers=bearer(trial.host)).text
    closed = trial.with_rules(closes_of(trial), "2020-01-01T00:00:00Z")
    with client_of(closed) as client:
        shown = [place for place, text in seen(client, None).items() if FIGURE in text]
    assert shown == list(WITH_SCORES)


def closes_of(trial: Trial) -> str:
    """Return the closing time as the stored rules have it."""
    text = (trial.challenge.root / "challenge.yaml").read_text()
    return next(line.split(": ", 1)[1] for line in text.splitlines() if "closes: " in line)


def test_a_team_reads_that_its_file_was_scored_and_when_it_will_see_the_scores(
    trial: Trial,
) -> None:
    own = bearer(trial.tokens[0])
    with client_of(trial) as client:
        view = client.get(f"{API}/submissions/1", headers=own).json()
        assert (view["state"], view["scores"]) == ("scored", [])
        assert view["hidden_until"] == CLOSES
        again = submit(client, trial.tokens[0], b"good").json()
        assert (again["id"], again["scores"]) == (1, [])
        told = "hidden until 2199-03-01 00:00 UTC"
        for place in ("/", "/teams/2", "/submissions/1"):
            assert told in client.get(place, headers=own).text, place
        assert "scores are hidden until then" in client.get("/rules").text
        refused = client.get(f"{API}/submissions/1/receipt", headers=own)
        assert (refused.status_code, refused.json()["code"]) == (403, "SCORES_HIDDEN")
        assert client.get(f"{API}/challenge").json()["phases"][0]["hidden_until_close"] is True


def test_the_static_site_has_no_hidden_scores(trial: Trial, tmp_path: Path) -> None:
    write_challenge_site(trial.challenge, tmp_path / "site")
    files = [path for path in (tmp_path / "site").rglob("*") if path.is_file()]
    assert not [path for path in files if FIGURE.encode() in path.read_bytes()]
    assert "hidden until 2199-03-01" in (tmp_path / "site" / "index.html").read_text()
    closed = trial.with_rules(closes_of(trial), "2020-01-01T00:00:00Z")
    write_challenge_site(closed.challenge, tmp_path / "site")
    assert FIGURE in (tmp_path / "site" / "submissions" / "1-1.json").read_text()


def test_scores_cannot_be_hidden_for_ever(tmp_path: Path) -> None:
    rules = tmp_path / "rules.yaml"
    rules.write_text("phases:\n- {name: final, split: test, hidden_until_close: true}\n")
    with pytest.raises(CallError, match=r"hidden_until_close.*closes"):
        read_challenge_settings(rules)
