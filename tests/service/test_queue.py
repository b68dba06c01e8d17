"""Jobs: leased by one worker, taken over after it stops, started at most three times."""

from __future__ import annotations

import errno
import json
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from sqlalchemy import select, text

from pliant.baselines import METHODS
from pliant.baselines.predict import predict
from pliant.service import queue
from pliant.service.database import now_ms
from pliant.service.models import Job, LedgerEntry, Score, State, Submission
from pliant.service.queue import lease_next
from pliant.service.scoring import Result, Task, score, score_in_child
from pliant.service.settings import Scoring
from pliant.service.submissions import queue_position
from pliant.service.worker import Worker
from pliant.spec.dataset import Dataset
from pliant.spec.limits import LimitError
from tests.service.conftest import Halves, MakeTrial, Trial, quick


def state_of(trial: Trial, number: int) -> Submission:
    found: Submission
    (found,) = trial.values(select(Submission).where(Submission.id == number))
    return found


def end_leases(trial: Trial) -> None:
    with trial.challenge.database.write() as session:
        session.execute(text("UPDATE job SET lease_until_ms = 0"))


def test_many_workers_do_each_job_once(trial: Trial) -> None:
    for number in range(5):
        trial.send(f"{number}".encode())
        trial.send(f"{number}".encode(), team=1)
    done: list[str] = []

    def count(task: Task, limits: Scoring) -> Result:
        done.append(str(task.file))
        return quick(task, limits)

    with ThreadPoolExecutor(6) as pool:
        for each in [pool.submit(trial.work, count) for _ in range(6)]:
            each.result()
    assert len(trial.values(select(Score))) == 10
    assert set(trial.values(select(Job.tries))) == {1}
    assert len(done) == 10


def test_a_file_of_another_kind_or_split_is_refused_when_it_is_checked_and_when_it_is_scored(
    make_trial: MakeTrial, service_halves: Halves, tmp_path: Path
) -> None:
    public = Dataset.open(service_halves.public)
    predict(public, "test", METHODS["orb"](), tmp_path / "matches", "matches")
    predict(public, "val", METHODS["identity"](), tmp_path / "split")
    names = {"test": "test", "practice": "val", "again": "val", "later": "val"}
    phases = [f"- {{name: {name}, split: {split}}}\n" for name, split in names.items()]
    phases[-1] = "- {name: later, split: val, opens: 2199-03-01T00:00:00Z}\n"
    trial = make_trial(f"phases:\n{''.join(phases)}")
    for name in ("matches", "split"):
        content = (tmp_path / name).read_bytes()
        numbers = [trial.send(content, check_only=check) for check in (True, False)]
        trial.work(lambda task, limits: score(task))
        expected = {
            "matches": {
                "code": "KIND_NOT_ACCEPTED",
                "where": "footer.table",
                "message": "found table matches; required: answers, which phase test accepts",
            },
            "split": {
                "code": "SPLIT_NOT_OF_PHASE",
                "where": "footer.split",
                "message": "found split val; required: test, which phase test accepts. "
                "Send it to phase practice or again",
            },
        }[name]
        for number in numbers:
            found = state_of(trial, number)
            assert found.state == State.REFUSED
            assert found.problems
            (issue,) = found.problems["issues"]
            assert issue == {**expected, "severity": "error", "path": "given.parquet"}


def test_a_sound_file_that_is_only_checked_gets_the_name_of_its_method(
    make_trial: MakeTrial, service_halves: Halves
) -> None:
    trial = make_trial()
    number = trial.send(service_halves.submissions[0].read_bytes(), check_only=True)
    trial.work(lambda task, limits: score(task))
    found = state_of(trial, number)
    assert (found.state, found.method) == (State.CHECKED, "identity")


def test_a_refusal_has_no_path_of_this_machine(
    make_trial: MakeTrial, service_halves: Halves, tmp_path: Path
) -> None:
    predict(Dataset.open(service_halves.public), "test", METHODS["identity"](), tmp_path / "other")
    table = pq.read_table(tmp_path / "other")
    footer = json.loads(table.schema.metadata[b"pliant"])
    footer["dataset"]["version"] = "9.9.9"
    table = table.replace_schema_metadata({b"pliant": json.dumps(footer)})
    pq.write_table(table, tmp_path / "other")
    trial = make_trial()
    number = trial.send((tmp_path / "other").read_bytes())
    trial.work(lambda task, limits: score(task))
    found = state_of(trial, number)
    assert found.problems
    (issue,) = found.problems["issues"]
    assert issue["code"] == "DATASET_MISMATCH"
    assert issue["message"].endswith(", the dataset at /data")


def test_position_counts_the_jobs_before(trial: Trial) -> None:
    for number in range(3):
        trial.send(f"{number}".encode())
    for expected in ([1, 2, 3], [None, 1, 2]):
        with trial.challenge.database.read() as session:
            waiting = session.scalars(select(Submission).order_by(Submission.id))
            assert [queue_position(session, each) for each in waiting] == expected
        Worker(trial.challenge, quick).work_once()


def test_a_worker_that_comes_back_late_changes_nothing(trial: Trial) -> None:
    number = trial.send(b"good")
    slow, fast = Worker(trial.challenge, quick), Worker(trial.challenge, quick)
    lease = lease_next(trial.challenge.database, "slow", trial.challenge.settings.scoring)
    assert lease is not None
    end_leases(trial)
    assert fast.work_once()
    assert not queue.renew(trial.challenge.database, lease, trial.challenge.settings.scoring)
    other = {1: {"overall": {"rmse_px": 99.0}}}
    slow._store(lease, Result(method="late", figures=other))
    assert trial.values(select(Score.main)) == [12.34]
    assert state_of(trial, number).method == "quick"


def test_a_lease_of_a_clock_that_was_set_back_ends(trial: Trial) -> None:
    limits = trial.challenge.settings.scoring
    number = trial.send(b"good")
    assert lease_next(trial.challenge.database, "gone", limits) is not None
    trial.work()
    assert state_of(trial, number).state == State.RUNNING
    with trial.challenge.database.write() as session:
        session.execute(text("UPDATE job SET lease_until_ms = lease_until_ms + 86400000"))
    trial.work()
    assert state_of(trial, number).state == State.SCORED


def test_a_job_whose_workers_stop_fails_after_three_tries_and_is_refunded(trial: Trial) -> None:
    number = trial.send(b"good")
    limits = trial.challenge.settings.scoring
    for tries in (1, 2, 3):
        lease = lease_next(trial.challenge.database, "dies", limits)
        assert lease is not None
        assert lease.tries == tries
        end_leases(trial)
    assert lease_next(trial.challenge.database, "fourth", limits) is None
    found = state_of(trial, number)
    assert found.state == State.FAILED
    assert found.failure is not None
    assert "no attempt was charged" in found.failure
    again = trial.send(b"good")
    assert again != number


def test_a_job_that_waits_with_all_its_tries_fails_and_lets_others_pass(trial: Trial) -> None:
    """The rules allow fewer tries than before."""
    first, second = trial.send(b"good"), trial.send(b"fine", team=1)
    limits = trial.challenge.settings.scoring
    lease = lease_next(trial.challenge.database, "gone", limits)
    assert lease is not None
    queue.release_job(trial.challenge.database, lease, "a crash", later=False)
    assert lease_next(trial.challenge.database, "next", limits.replace(tries=1)) is None
    assert state_of(trial, first).state == State.FAILED
    trial.work()
    assert state_of(trial, second).state == State.SCORED


def test_a_running_job_keeps_its_lease(make_trial: MakeTrial) -> None:
    trial = make_trial("scoring: {lease_s: 3}\n")
    number = trial.send(b"good")
    going, ended = threading.Event(), threading.Event()

    def slow(task: Task, limits: Scoring) -> Result:
        going.set()
        assert ended.wait(60)
        return quick(task, limits)

    thread = threading.Thread(target=Worker(trial.challenge, slow).work_once)
    thread.start()
    assert going.wait(60)
    first = lease_end_ms(trial)
    while now_ms() <= first:
        time.sleep(0.1)
    assert lease_end_ms(trial) > first  # renewed before it ended
    assert not Worker(trial.challenge, quick).work_once()
    ended.set()
    thread.join()
    assert state_of(trial, number).state == State.SCORED


def lease_end_ms(trial: Trial) -> int:
    end: int
    (end,) = trial.values(select(Job.lease_until_ms))
    return end


@pytest.mark.parametrize(
    ("error", "told", "tries"),
    [
        (
            LimitError("time", "it takes too long", path="given.parquet"),
            "failed: given.parquet: it takes too long. No attempt was",
            1,
        ),
        (LimitError("crash", "the reader crashed"), "failed: the reader crashed. No attempt", 3),
        (OSError("cannot read /srv/challenge"), "The host sees why; no attempt was charged.", 3),
    ],
)
def test_a_scorer_that_misbehaves_costs_no_attempt(
    make_trial: MakeTrial,
    error: Exception,
    told: str,
    tries: int,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A crash and a fault of the machine are tried again; of neither is a path told."""
    trial = make_trial()
    number = trial.send(b"good")

    def scorer(task: Task, limits: Scoring) -> Result:
        raise error

    for _ in range(3):
        trial.work(scorer)
        end_leases(trial)
    found = state_of(trial, number)
    assert found.state == State.FAILED
    assert found.failure is not None
    assert told in found.failure
    assert "/srv" not in found.failure
    assert trial.values(select(Job.tries)) == [tries]
    assert trial.values(select(LedgerEntry.amount)) == [-1, 1]
    logged = [str(vars(each)) for each in caplog.records if each.message == "job failed"]
    assert len(logged) == tries
    assert "given.parquet" not in "".join(logged)


def test_a_full_disk_of_a_worker_fails_nothing_that_waits(make_trial: MakeTrial) -> None:
    trial = make_trial()
    numbers = [trial.send(b"good"), trial.send(b"fine")]

    def full(task: Task, limits: Scoring) -> Result:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    trial.work(full)
    assert trial.values(select(Job.tries)) == [1, 1]
    assert "No space left" in trial.values(select(Job.error))[0]
    end_leases(trial)
    trial.work()
    assert [state_of(trial, number).state for number in numbers] == [State.SCORED] * 2


def hang(task: Task) -> Result:
    time.sleep(3600)
    return Result()


def take_memory(task: Task) -> Result:
    _ = bytearray(8 * 2**30)
    return Result()


@pytest.mark.parametrize(
    ("what", "wall_s", "told"),
    [(hang, 2, "too long"), (take_memory, 300, "too much memory")],
)
def test_limits_of_the_settings_end_a_scorer(
    what: object, wall_s: int, told: str, make_trial: MakeTrial, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pliant.service.scoring.score", what)
    trial = make_trial(f"scoring: {{wall_s: {wall_s}, memory_gib: 1, tries: 1}}\n")
    number = trial.send(b"good")
    trial.work(score_in_child)
    assert told in str(state_of(trial, number).failure)
