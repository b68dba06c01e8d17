"""A challenge of the tiny dataset, on SQLite and on a PostgreSQL server that the tests start."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fastapi", reason="needs the extra 'service'")

from sqlalchemy import Select, select

from pliant.baselines import METHODS
from pliant.baselines.predict import predict
from pliant.publishing import PublishSettings, publish
from pliant.service.challenge import Challenge
from pliant.service.creation import create_challenge
from pliant.service.models import Job
from pliant.service.scoring import Result, Task
from pliant.service.settings import Phase, Scoring
from pliant.service.submissions import Upload, accept
from pliant.service.teams import Identity, identify, invite
from pliant.service.versions import add_missing_versions
from pliant.service.worker import Scorer, Worker
from pliant.spec.dataset import Dataset

POSTGRES = Path("/usr/lib/postgresql/15/bin")
FIGURES = {"overall": {"rmse_px": 12.34}, "rope": {"rmse_px": 12.34}}


@dataclass(frozen=True)
class Halves:
    """The two halves of the tiny dataset, and submissions to its test split."""

    public: Path
    private: Path
    submissions: tuple[Path, ...]
    bad: Path


@pytest.fixture(scope="session")
def service_halves(tiny_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Halves:
    out = tmp_path_factory.mktemp("service") / "tiny"
    settings = PublishSettings(hold_out=("test",), answers_are_public=True)
    facts = publish(tiny_dataset, out, settings)
    assert facts.private is not None
    files = []
    for name in ("identity", "centroid"):
        files.append(out.parent / f"{name}.parquet")
        predict(Dataset.open(out), "test", METHODS[name](), files[-1])
    bad = out.with_name("bad.parquet")
    bad.write_bytes(files[0].read_bytes()[:3000])
    return Halves(out, facts.private, tuple(files), bad)


class PostgresServer:
    """A server on a socket in a temporary folder, run by the user `postgres`.

    Args:
        place: A folder with a short path.
    """

    def __init__(self, place: Path) -> None:
        self.place = place
        self._databases = 0

    def start(self) -> None:
        options = f"-k {self.place} -c listen_addresses= -c fsync=off -c max_connections=60"
        self.run("pg_ctl", "-D", "data", "-w", "-l", "log", "-o", options, "start")

    def stop(self) -> None:
        self.run("pg_ctl", "-D", "data", "-w", "-m", "immediate", "stop")  # without a checkpoint

    def new_database(self) -> str:
        self._databases += 1
        name = f"t{self._databases}"
        self.run("createdb", "-h", str(self.place), name)
        return f"postgresql://postgres@/{name}?host={self.place}"

    def run(self, program: str, *arguments: str) -> None:
        command = ["runuser", "-u", "postgres", "--", str(POSTGRES / program), *arguments]
        done = subprocess.run(command, cwd=self.place, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


@contextmanager
def running_postgres() -> Iterator[PostgresServer]:
    """Run a server; skip the test where PostgreSQL cannot be run."""
    if not (POSTGRES / "initdb").is_file() or shutil.which("runuser") is None:
        pytest.skip("PostgreSQL is not installed")
    with tempfile.TemporaryDirectory(prefix="pg", dir="/tmp") as place:
        server = PostgresServer(Path(place))
        shutil.chown(place, "postgres")
        server.run("initdb", "-D", "data", "-A", "trust", "--no-sync", "-E", "UTF8")
        server.start()
        try:
            yield server
        finally:
            server.stop()


@pytest.fixture(scope="session")
def postgres() -> Iterator[Callable[[], str]]:
    """A function that makes an empty database on a server of its own and returns its URL."""
    with running_postgres() as server:
        yield server.new_database


@dataclass(frozen=True)
class Trial:
    """A challenge with a host and two teams, and their tokens."""

    challenge: Challenge
    url: str | None
    host: str
    tokens: tuple[str, ...]

    @property
    def phase(self) -> Phase:
        return self.challenge.settings.phases[0]

    def who(self, token: str) -> Identity:
        with self.challenge.database.read() as session:
            found = identify(session, token)
        assert found is not None
        return found

    def values(self, query: Select[Any]) -> list[Any]:
        """Return the first column of what is in the database."""
        with self.challenge.database.read() as session:
            return list(session.scalars(query))

    def send(self, content: bytes, team: int = 0, *, check_only: bool = False) -> int:
        """Accept a file as the web process does, and return the submission's number."""
        path = self.challenge.incoming / f"given-{os.urandom(4).hex()}"
        path.write_bytes(content)
        sha256 = hashlib.sha256(content).hexdigest()
        self.challenge.store.put(path, sha256)
        upload = Upload(sha256, "given.parquet", len(content), check_only)
        with self.challenge.database.write() as session:
            who = self.who(self.tokens[team])
            return accept(session, self.challenge, self.phase, who, upload)[0].id

    def with_rules(self, old: str, new: str) -> Trial:
        """Change the rules, and start the service again in two processes at once."""
        path = self.challenge.root / "challenge.yaml"
        path.write_text(path.read_text().replace(old, new))
        challenge = Challenge.open(self.challenge.root)
        for _ in range(2):  # one of them adds what is new
            with challenge.database.write() as session:
                add_missing_versions(session, challenge)
        return replace(self, challenge=challenge)

    def wait_until_idle(self, seconds: float) -> None:
        """Wait for workers in other processes or threads until no job is left."""
        end = time.monotonic() + seconds
        while self.values(select(Job.id).where(Job.state.in_(["queued", "leased"]))):
            assert time.monotonic() < end, "jobs are left"
            time.sleep(0.3)

    def work(self, scorer: Scorer | None = None) -> None:
        """Do every job that waits, by default with `quick`."""
        worker = Worker(self.challenge, scorer or quick)
        while worker.work_once():
            pass


MakeTrial = Callable[..., Trial]


@pytest.fixture(scope="session")
def plain_challenge(
    service_halves: Halves, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, str]:
    """A challenge without settings on SQLite, to be copied, and its host's token."""
    root = tmp_path_factory.mktemp("plain") / "challenge"
    return root, create_challenge(root, service_halves.public, service_halves.private, ["test"])


@pytest.fixture
def make_trial(
    service_halves: Halves, plain_challenge: tuple[Path, str], tmp_path: Path
) -> Iterator[MakeTrial]:
    """A function that makes a challenge, with other settings or another database."""
    opened: list[Challenge] = []

    def make(text: str = "", url: str | None = None) -> Trial:
        config = tmp_path / "given.yaml"
        config.write_text(text)
        root = tmp_path / f"challenge{len(opened)}"
        halves = service_halves
        if text or url:
            host = create_challenge(
                root, halves.public, halves.private, [], config if text else None, url
            )
        else:
            plain, host = plain_challenge
            shutil.copytree(plain, root)
        challenge = Challenge.open(root, url)
        opened.append(challenge)
        with challenge.database.write() as session:
            tokens = [invite(session, name, actor="host")[1] for name in ("Ada", "Grace")]
        return Trial(challenge, url, host, tuple(tokens))

    yield make
    for challenge in opened:
        challenge.database.engine.dispose()


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.long)])
def trial(request: pytest.FixtureRequest, make_trial: MakeTrial) -> Trial:
    """A challenge on each kind of database."""
    url = None
    if request.param == "postgresql":
        url = request.getfixturevalue("postgres")()
    return make_trial(url=url)


def quick(task: Task, limits: Scoring) -> Result:
    """Score without reading the file, by its first byte: `b` is bad, all others are scored."""
    del limits
    if task.file.read_bytes()[:1] == b"b":
        issue = {"code": "FILE_UNREADABLE", "severity": "error", "path": task.name}
        return Result(issues=({**issue, "where": "", "message": "bad"},), counts={issue["code"]: 1})
    if not task.versions:
        return Result(method="quick")
    figures = {version: FIGURES for version, _, _ in task.versions}
    return Result(method="quick", figures=figures, queries_sha256="0" * 64, tools={"pliant": "0"})
