"""Faults: processes killed at any moment, a database that is gone, a disk that is full."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from sqlalchemy import event, func, select

from pliant.baselines.submission_file import query_keys, write_answers
from pliant.evaluator import evaluate
from pliant.evaluator.scores import public_scores
from pliant.service.audit import verify_log
from pliant.service.challenge import Challenge
from pliant.service.client import Client
from pliant.service.models import Job, LedgerEntry, Score, State, Submission
from pliant.service.receipts import read_public_key, verify_receipt
from pliant.service.scoring import Result, Task
from pliant.service.settings import Scoring
from pliant.service.worker import Worker
from pliant.spec.answers import Answers
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from tests.service.conftest import Halves, MakeTrial, PostgresServer, quick, running_postgres
from tests.service.server import Server, serving
from tests.service.test_api import API, client_of, submit

RULES = """
phases: [{name: test, split: test, attempts_per_day: 100000, attempts_total: 100000}]
submissions_per_minute: 1000
scoring: {lease_s: 2}
"""


class Sender(threading.Thread):
    """Sends one file after another until it is stopped; a lost answer is asked for again.

    Args:
        address: Address of the service.
        token: The team's token.
        dataset: The dataset; the files differ in the name of their method alone.
        folder: Folder for the files.
    """

    def __init__(self, address: str, token: str, dataset: Dataset, folder: Path) -> None:
        super().__init__(daemon=True)
        self._client = Client(address, token)
        self._dataset, self._folder = dataset, folder
        self._stopped = threading.Event()
        self.accepted: dict[int, str] = {}

    def run(self) -> None:
        keys = query_keys(self._dataset, "test")
        unmoved = Answers(np.concatenate([pair.uv_a_px for pair in self._dataset.pairs("test")]))
        number = 0
        while not self._stopped.is_set():
            number += 1
            path, method = self._folder / f"{number}.parquet", {"name": f"m{number}"}
            write_answers(path, self._dataset, "test", keys, unmoved, method)
            while True:
                try:
                    view = self._client.send(path)
                    break
                except CallError:
                    if self._stopped.wait(0.1):
                        return
            self.accepted[view["id"]] = view["file_sha256"]
            self._stopped.wait(4.0)

    def stop(self) -> None:
        self._stopped.set()
        self.join()


@pytest.mark.long
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
@pytest.mark.timeout(3600)
def test_killed_at_seeded_moments(
    make_trial: MakeTrial,
    service_halves: Halves,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    kind: str,
) -> None:
    """Nothing is lost, charged twice or scored twice with other figures; the log is whole."""
    url = request.getfixturevalue("postgres")() if kind == "postgresql" else None
    trial = make_trial(RULES, url)
    rng = random.Random(20261124)
    options = ["--workers", "2", *(["--database", url] if url else [])]
    with serving(trial.challenge.root, tmp_path / "log", *options) as server:
        dataset = Dataset.open(service_halves.public)
        sender = Sender(server.address, trial.tokens[0], dataset, tmp_path)
        sender.start()
        for _ in range(100):
            time.sleep(rng.uniform(0.0, 4.0))
            kill_something(server, rng)
            server.wait()
        sender.stop()
        trial.wait_until_idle(1500)
        assert server.stop() == 0
    assert sender.accepted
    check_books(trial.challenge, sender.accepted, service_halves)


def kill_something(server: Server, rng: random.Random) -> None:
    """Kill one worker, the web process, or all at once; what a supervisor restarts, is."""
    what = rng.choice(["worker", "web", "all"])
    with suppress(psutil.Error):  # a process may end while it is looked at
        processes = psutil.Process(server.process.pid).children(recursive=True)
        workers = [each for each in processes if "spawn_main" in " ".join(each.cmdline())]
        if what == "worker" and workers:
            rng.choice(workers).send_signal(signal.SIGKILL)
            return
    if what == "web":
        os.kill(server.process.pid, signal.SIGKILL)
        server.process.wait()
    else:
        server.kill()
    server.start()


def check_books(challenge: Challenge, accepted: dict[int, str], halves: Halves) -> None:
    scores = evaluate(halves.submissions[0], halves.public, truth=halves.private, hide_truth=True)
    expected = public_scores(scores).document
    figures = {"overall": expected["overall"], **expected["tiers"]}
    key = read_public_key(challenge.public_key)
    with challenge.database.read() as session:
        found = {each.id: each for each in session.scalars(select(Submission))}
        for number, sha256 in accepted.items():
            assert found[number].file_sha256 == sha256
        assert len({each.file_sha256 for each in found.values()}) >= len(accepted)
        scored = [each for each in found.values() if each.state == State.SCORED]
        failed = [each for each in found.values() if each.state == State.FAILED]
        assert len(scored) + len(failed) == len(found)
        assert len(failed) <= len(found) // 5
        by_submission = {each.submission_id: each for each in session.scalars(select(Score))}
        assert by_submission.keys() == {each.id for each in scored}
        for score in by_submission.values():
            assert score.figures == figures
            verify_receipt(score.receipt, key)
        charged = dict(
            session.execute(
                select(LedgerEntry.submission_id, func.sum(LedgerEntry.amount)).group_by(
                    LedgerEntry.submission_id
                )
            ).all()
        )
        assert charged == {**{each.id: -1 for each in scored}, **{each.id: 0 for each in failed}}
        verify_log(session)
    print(f"{len(accepted)} sent, {len(scored)} scored, {len(failed)} failed after three tries")


@pytest.fixture
def own_postgres() -> Iterator[PostgresServer]:
    with running_postgres() as server:
        yield server


@pytest.mark.parametrize("seconds", [2, pytest.param(30, marks=pytest.mark.long)])
def test_a_database_that_is_gone_for_a_while(
    make_trial: MakeTrial,
    own_postgres: PostgresServer,
    seconds: int,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Requests are answered with 503; the result that a worker has is stored afterwards."""
    trial = make_trial(RULES, own_postgres.new_database())
    trial.send(b"good")
    gone, scored = threading.Event(), threading.Event()

    def slow(task: Task, limits: Scoring) -> Result:
        scored.set()
        assert gone.wait(60)
        return quick(task, limits)

    worker = Worker(trial.challenge, slow)
    thread = threading.Thread(target=worker.run)
    thread.start()
    assert scored.wait(30)
    with client_of(trial) as client:
        own_postgres.stop()
        gone.set()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            answer = submit(client, trial.tokens[0], b"during")
            assert answer.status_code == 503
            assert client.get("/healthz").status_code == 503
            time.sleep(0.5)
        own_postgres.start()
        assert submit(client, trial.tokens[0], b"after").status_code == 201
        trial.wait_until_idle(60)
        worker.stop()
        thread.join()
        views = client.get(f"{API}/leaderboard").json()["rows"]
        assert views[0]["submissions"] == 2
    with trial.challenge.database.read() as session:
        assert set(session.scalars(select(Job.tries))) == {1}
        verify_log(session)
    kept = [vars(each) for each in caplog.records if "the result is kept" in each.message]
    assert "connection" in kept[0]["error"]


def test_a_full_database_disk(make_trial: MakeTrial) -> None:
    """With SQLite's own limit as the disk: nothing is charged, and later the service goes on."""
    trial = make_trial(RULES)
    database = trial.challenge.database
    limit: list[str] = []

    def set_limit(connection: Any, *_: Any) -> None:
        for each in limit:
            connection.execute(f"PRAGMA max_page_count={each}")

    event.listen(database.engine, "checkout", set_limit)
    with database.engine.connect() as connection:
        limit.append(str(connection.exec_driver_sql("PRAGMA page_count").scalar()))
    with client_of(trial) as client:
        statuses = [submit(client, trial.tokens[0], b"%d" % n).status_code for n in range(60)]
        assert set(statuses) == {201, 507}
        limit[0] = "1000000"
        assert submit(client, trial.tokens[0], b"last").status_code == 201
    trial.work()
    with database.read() as session:
        count = session.scalar(select(func.count()).select_from(Score))
        charged = session.scalar(select(func.sum(LedgerEntry.amount)))
        assert count == statuses.count(201) + 1 == -(charged or 0)
        verify_log(session)


def test_a_full_database_disk_of_a_server(
    make_trial: MakeTrial, postgres: Callable[[], str], caplog: pytest.LogCaptureFixture
) -> None:
    trial = make_trial("", postgres())
    full = "BEGIN RAISE EXCEPTION 'could not extend file' USING ERRCODE = 'disk_full'; END"
    with trial.challenge.database.engine.begin() as connection:
        for each in (
            f"CREATE FUNCTION full_disk() RETURNS trigger LANGUAGE plpgsql AS $$ {full} $$",
            "CREATE TRIGGER full_disk BEFORE INSERT ON audit EXECUTE FUNCTION full_disk()",
        ):
            connection.exec_driver_sql(each)
    with client_of(trial) as client:
        answer = submit(client, trial.tokens[0], b"good")
    assert (answer.status_code, answer.json()["code"]) == (507, "DISK_FULL")
    [logged] = [vars(each) for each in caplog.records if "the database" in each.message]
    assert "could not extend file" in logged["error"]  # for the host
    assert not trial.values(select(LedgerEntry))


def test_a_worker_waits_for_a_server_that_is_read_only(
    make_trial: MakeTrial, postgres: Callable[[], str], caplog: pytest.LogCaptureFixture
) -> None:
    """As after a failover to a standby, or where a provider's disk is nearly full."""
    url = postgres()
    trial = make_trial("", url)
    trial.send(b"good")
    engine = trial.challenge.database.engine

    def set_read_only(value: str) -> None:
        with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.exec_driver_sql("SET default_transaction_read_only = off")
            name = connection.exec_driver_sql("SELECT current_database()").scalar()
            connection.exec_driver_sql(
                f"ALTER DATABASE {name} SET default_transaction_read_only = {value}"
            )
        engine.dispose()  # so that the setting counts

    set_read_only("on")
    worker = Worker(trial.challenge, quick)
    thread = threading.Thread(target=worker.run)
    thread.start()
    try:
        with client_of(trial) as client:
            assert submit(client, trial.tokens[0], b"during").status_code == 503
        end = time.monotonic() + 30
        while "trying again" not in caplog.text:
            assert thread.is_alive()
            assert time.monotonic() < end
            time.sleep(0.1)
        set_read_only("off")
        trial.wait_until_idle(30)
    finally:
        worker.stop()
        thread.join()
    assert trial.values(select(Submission.state)) == [State.SCORED]
