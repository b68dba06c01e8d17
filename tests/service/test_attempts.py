"""Attempts: charged once, refunded, credited, and not to be had by racing or by the clock."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import select

from pliant.service import audit, database
from pliant.service.ledger import Attempts, attempts, credit
from pliant.service.models import LedgerEntry, State, Submission
from pliant.service.submissions import NotAcceptedError
from pliant.spec.errors import CallError
from tests.service.conftest import MakeTrial, Trial


def left(trial: Trial, team: int = 0) -> Attempts:
    who = trial.who(trial.tokens[team])
    with trial.challenge.database.read() as session:
        return attempts(session, who.team_id, trial.phase, audit.log_time(session))


def give(trial: Trial, amount: int, time_ms: int) -> None:
    """Give the first team credit at a time."""
    team = trial.who(trial.tokens[0]).team_id
    with trial.challenge.database.write() as session:
        credit(session, team, trial.phase, amount, time_ms, actor="host")


def test_a_scored_file_costs_one_attempt_and_a_refused_one_none(trial: Trial) -> None:
    trial.send(b"good")
    trial.send(b"bad")
    trial.send(b"only checked", check_only=True)
    assert left(trial) == Attempts(3, 98)
    trial.work()
    assert left(trial) == Attempts(4, 99)
    assert left(trial, 1) == Attempts(5, 100)


def test_parallel_requests_do_not_exceed_the_quota(trial: Trial) -> None:
    def send(number: int) -> str:
        try:
            trial.send(f"{number}".encode())
        except NotAcceptedError as error:
            return error.code
        return "accepted"

    with ThreadPoolExecutor(12) as pool:
        outcomes = list(pool.map(send, range(30)))
    assert outcomes.count("accepted") == 5
    assert set(outcomes) == {"accepted", "QUOTA_EXCEEDED"}
    assert left(trial).left == 0


def test_the_same_file_is_one_submission(trial: Trial) -> None:
    first = trial.send(b"one")
    assert [trial.send(b"one") for _ in range(8)] == [first] * 8
    assert trial.send(b"one", team=1) != first
    assert left(trial) == Attempts(4, 99)


def test_a_refused_file_is_checked_again(trial: Trial) -> None:
    """The rules may have changed since."""
    first = trial.send(b"bad")
    assert trial.send(b"bad") == first  # it waits
    trial.work()
    assert trial.send(b"bad") != first
    trial.work()
    assert left(trial) == Attempts(5, 100)


def test_credit_adds_attempts_today_and_in_all(trial: Trial) -> None:
    for number in range(5):
        trial.send(f"{number}".encode())
    with pytest.raises(NotAcceptedError, match="no attempt is left today"):
        trial.send(b"six")
    give(trial, 2, database.now_ms())
    assert left(trial) == Attempts(2, 97)
    trial.send(b"six")


def test_rules_with_fewer_attempts_leave_none_and_credit_counts_from_there(trial: Trial) -> None:
    for number in range(4):
        trial.send(f"{number}".encode())
    fewer = trial.phase.replace(attempts_per_day=1, attempts_total=2)
    with trial.challenge.database.write() as session:
        team = trial.who(trial.tokens[0]).team_id
        now = database.now_ms()
        found = attempts(session, team, fewer, now)
        assert (found.today, found.total, found.left) == (0, 0, 0)
        credit(session, team, fewer, 2, now, actor="host")
        assert attempts(session, team, fewer, now) == Attempts(2, 3)
        logged = audit.last_entry(session)
    assert logged is not None
    assert json.loads(logged.detail) == {"amount": 2, "forgiven": 3, "phase": "test"}


def test_files_in_the_queue_hold_attempts(trial: Trial) -> None:
    for number in range(5):
        trial.send(f"b{number}".encode())
    with pytest.raises(NotAcceptedError, match=r"your files in the queue \(5\)"):
        trial.send(b"six")
    trial.work()
    trial.send(b"six")


def test_credits_of_another_day_count_in_all_and_not_today(trial: Trial) -> None:
    give(trial, 1, 0)
    assert left(trial) == Attempts(5, 101)
    give(trial, 10_000, 86_400_000)
    with trial.challenge.database.read() as session:
        entry = audit.last_entry(session)
        assert entry is not None
        assert [entry.actor, entry.action, entry.subject] == ["host", "credited", "team 2"]
        days = list(session.scalars(select(LedgerEntry.day).order_by(LedgerEntry.id)))
    assert days == ["1970-01-01", "1970-01-02"]
    assert left(trial) == Attempts(5, 10_101)
    for amount in (0, 10_001):
        with pytest.raises(CallError, match=r"out of range.*1 to 10,000"):
            give(trial, amount, 0)


def test_a_clock_that_is_set_back_opens_no_day_again(
    trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(5):
        trial.send(f"{number}".encode())
    yesterday = database.now_ms() - 36 * 3600 * 1000
    monkeypatch.setattr(audit, "now_ms", lambda: yesterday)
    with pytest.raises(NotAcceptedError, match="no attempt is left today"):
        trial.send(b"six")


def test_a_phase_that_is_closed_accepts_nothing(make_trial: MakeTrial) -> None:
    trial = make_trial("phases:\n- {name: early, split: test, closes: '2020-01-01T00:00:00Z'}\n")
    with pytest.raises(NotAcceptedError, match="phase early is closed"):
        trial.send(b"late")
    assert trial.values(select(Submission)) == trial.values(select(LedgerEntry)) == []


def test_files_per_minute_are_limited(make_trial: MakeTrial) -> None:
    trial = make_trial("submissions_per_minute: 3\n")
    for number in range(3):
        trial.send(f"{number}".encode(), check_only=True)
    with pytest.raises(NotAcceptedError, match="too many files in one minute"):
        trial.send(b"four")
    trial.send(b"four", team=1)


def test_the_host_is_not_charged(trial: Trial) -> None:
    host = Trial(trial.challenge, trial.url, trial.host, (trial.host,))
    for number in range(7):
        host.send(f"{number}".encode())
    trial.work()
    assert trial.values(select(Submission.state)) == [State.SCORED] * 7
    assert trial.values(select(LedgerEntry)) == []
