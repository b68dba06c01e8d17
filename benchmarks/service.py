"""The evaluation service under load, on 127.0.0.1, with SQLite.

50 participants send 10,000-row files at once to a challenge that has 10,000 scored submissions
(`--quick`: 10, 1,000 and 1,000). `submit_p95_ms` is of the whole request with all participants at
once, `submit_alone_p95_ms` of one after another. `leaderboard_p95_ms` is of requests of which
every third comes after a change, so the page is made again; `leaderboard_made_ms` is the median of
making it. `scoring_ratio` is the rate of two workers over that of two processes that run bare
`pliant evaluate --hide-truth` on the same files, one interpreter per file in both cases, and
`web_mb` the resident memory of the web process at the end. Times depend on what else runs on the
machine; `…_cpu_ms` and `scoring_cpu_ratio` are the same in CPU time, which hardly does.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pyarrow.parquet as pq
from record import Value, main
from sqlalchemy import func, insert, select

from pliant.baselines import METHODS
from pliant.baselines.predict import predict
from pliant.generator.config import GenerateConfig, QuerySettings
from pliant.generator.runner.run import generate
from pliant.publishing import PublishSettings, publish
from pliant.service.challenge import Challenge
from pliant.service.client import Client
from pliant.service.creation import create_challenge
from pliant.service.leaderboard import leaderboard
from pliant.service.models import Job, Score, Submission, Version
from pliant.service.teams import invite
from pliant.spec.dataset import Dataset

CORES = 2
PLIANT = [sys.executable, "-c", "from pliant.cli.main import main; main()"]
RULES = {
    "phases": [
        {"name": "test", "split": "test", "attempts_per_day": 10**6, "attempts_total": 10**6}
    ],
    "submissions_per_minute": 1000,
}


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    participants: int
    rows: int
    stored: int
    scored: int


def measure(quick: bool) -> Mapping[str, Value]:
    """Return the figures."""
    size = Size(10, 1_000, 1_000, 6) if quick else Size(50, 10_000, 10_000, 30)
    with tempfile.TemporaryDirectory(prefix="pliant-service-") as folder:
        return _measure(Path(folder), size)


def _measure(place: Path, size: Size) -> Mapping[str, Value]:
    public, private = _publish(place, size.rows)
    config = place / "rules.json"
    config.write_text(json.dumps(RULES))
    root = place / "challenge"
    create_challenge(root, public, private, [], config)
    challenge = Challenge.open(root)
    with challenge.database.write() as session:
        made = [invite(session, f"team {n}", actor="host") for n in range(size.participants)]
        teams, tokens = [team.id for team, _ in made], [token for _, token in made]
    _store(challenge, teams, size.stored)
    source = place / "identity.parquet"
    predict(Dataset.open(public), "test", METHODS["identity"](), source)
    files = [_variant(source, n) for n in range(2 * size.participants)]
    port = 18437
    address = f"http://127.0.0.1:{port}"
    command = [*PLIANT, "serve", str(root), "--port", str(port), "--workers", "0"]
    with open(place / "log", "wb") as log:
        server = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        _wait(lambda: Client(address, tokens[0])._call("challenge"))
        with ThreadPoolExecutor(size.participants) as pool:
            start = threading.Barrier(size.participants)
            web = psutil.Process(server.pid)
            before = _cpu_s(web)
            together = list(
                pool.map(
                    lambda n: _timed_send(address, tokens[n], files[n], start),
                    range(size.participants),
                )
            )
        submit_cpu_s = _cpu_s(web) - before
        alone, pages = [], []
        for number in range(size.participants):
            file = files[size.participants + number]
            alone.append(_timed_send(address, tokens[number], file))
            pages += [_timed_get(address + "/") for _ in range(3)]
        web_mb = web.memory_info().rss / 1e6
        making, making_cpu = _making(challenge)
        rate, rate_cpu = _service_rate(challenge, root, size.scored)
    finally:
        server.terminate()
        server.wait()
    bare, bare_cpu = _bare_rate(files[: size.scored], public, private)
    return {
        "participants": size.participants,
        "rows": size.rows,
        "stored": size.stored,
        "submit_p95_ms": _p95(together),
        "submit_alone_p95_ms": _p95(alone),
        "leaderboard_p95_ms": _p95(pages),
        "leaderboard_made_ms": making,
        "submit_cpu_ms": submit_cpu_s / size.participants * 1000,
        "leaderboard_made_cpu_ms": making_cpu,
        "files_per_s_service": rate,
        "files_per_s_bare": bare,
        "scoring_ratio": rate / bare,
        "scoring_cpu_ratio": bare_cpu / rate_cpu,
        "web_mb": web_mb,
    }


def _publish(place: Path, rows: int) -> tuple[Path, Path]:
    """Make a small dataset with so many queries and publish it."""
    sequences = 10
    config = GenerateConfig(
        tiers=("rope",),
        splits={"test": sequences},
        frames=4,
        width=64,
        height=48,
        style="raster",
        queries=QuerySettings(pairs_per_sequence=10, queries_per_pair=rows // sequences // 10),
        id="load",
    )
    generate(config, place / "data", workers=CORES)
    settings = PublishSettings(hold_out=("test",), answers_are_public=True)
    facts = publish(place / "data", place / "public", settings)
    assert facts.private is not None
    return facts.public, facts.private


def _store(challenge: Challenge, teams: list[int], count: int) -> None:
    """Store scored submissions; their files and log entries are not needed for a page."""
    with challenge.database.write() as session:
        version = session.scalars(select(Version)).one()
        figures: dict[str, dict[str, float]] = {}
        for each in version.figures:
            figures.setdefault(each["group"], {})[each["metric"]] = 1.0
        rows = [
            {
                "id": number,
                "team_id": teams[number % len(teams)],
                "phase": "test",
                "file_sha256": f"{number:064x}",
                "file_name": "a.parquet",
                "file_bytes": 1,
                "check_only": False,
                "state": "scored",
                "method": f"method {number}",
                "created_ms": number,
                "finished_ms": number,
            }
            for number in range(1, count + 1)
        ]
        session.execute(insert(Submission), rows)
        scores = [
            {
                "submission_id": row["id"],
                "version_id": version.id,
                "figures": figures,
                "main": float(hash(str(row["id"])) % 9999) / 100,
                "coverage": 1.0,
                "receipt": {"figures": figures},
                "scored_ms": row["id"],
            }
            for row in rows
        ]
        session.execute(insert(Score), scores)


def _variant(source: Path, number: int) -> Path:
    """Write the same answers with another method's name, so that the file is another one."""
    table = pq.read_table(source)
    metadata = dict(table.schema.metadata)
    footer = json.loads(metadata[b"pliant"])
    footer["method"]["name"] = f"method-{number}"
    metadata[b"pliant"] = json.dumps(footer).encode()
    path = source.with_name(f"{number}.parquet")
    pq.write_table(table.replace_schema_metadata(metadata), path)
    return path


def _timed_send(
    address: str, token: str, file: Path, start: threading.Barrier | None = None
) -> float:
    client = Client(address, token)
    if start is not None:
        start.wait()
    begun = time.perf_counter()
    client.send(file)
    return (time.perf_counter() - begun) * 1000


def _timed_get(address: str) -> float:
    import urllib.request

    begun = time.perf_counter()
    with urllib.request.urlopen(address) as answer:
        answer.read()
    return (time.perf_counter() - begun) * 1000


def _making(challenge: Challenge) -> tuple[float, float]:
    times, cpu = [], []
    with challenge.database.read() as session:
        version = session.scalars(select(Version)).one()
        for _ in range(9):
            begun, used = time.perf_counter(), time.process_time()
            leaderboard(session, version, "best")
            times.append((time.perf_counter() - begun) * 1000)
            cpu.append((time.process_time() - used) * 1000)
    return statistics.median(times), statistics.median(cpu)


def _service_rate(challenge: Challenge, root: Path, count: int) -> tuple[float, float]:
    """Return files per second and CPU seconds per file of two workers, without their start."""
    workers = [subprocess.Popen([*PLIANT, "challenge", "work", str(root)]) for _ in range(CORES)]
    try:
        _wait(lambda: _done(challenge) >= CORES or _fail())
        first, begun = _done(challenge), time.perf_counter()
        used = sum(_cpu_s(psutil.Process(each.pid)) for each in workers)
        _wait(lambda: _done(challenge) >= first + count or _fail())
        scored = _done(challenge) - first
        used = sum(_cpu_s(psutil.Process(each.pid)) for each in workers) - used
        return scored / (time.perf_counter() - begun), used / scored
    finally:
        for worker in workers:
            worker.terminate()
        for worker in workers:
            worker.wait()


def _done(challenge: Challenge) -> int:
    with challenge.database.read() as session:
        query = select(func.count()).select_from(Job).where(Job.state == "done")
        return session.scalar(query) or 0


def _cpu_s(process: psutil.Process) -> float:
    """Return the CPU time of a process and of its children that have ended."""
    return sum(process.cpu_times()[:4])


def _bare_rate(files: list[Path], public: Path, private: Path) -> tuple[float, float]:
    code = (
        "import sys; from pliant.evaluator import evaluate; "
        "evaluate(sys.argv[1], sys.argv[2], truth=sys.argv[3], hide_truth=True)"
    )

    def bare(file: Path) -> None:
        subprocess.run([sys.executable, "-c", code, file, public, private], check=True)

    begun, used = time.perf_counter(), _cpu_s(psutil.Process())
    with ThreadPoolExecutor(CORES) as pool:
        list(pool.map(bare, files))
    used = _cpu_s(psutil.Process()) - used
    return len(files) / (time.perf_counter() - begun), used / len(files)


def _wait(ready: Callable[[], Any], seconds: float = 900) -> None:
    end = time.monotonic() + seconds
    while True:
        try:
            ready()
            return
        except Exception:
            if time.monotonic() > end:
                raise
            time.sleep(0.05)


def _fail() -> None:
    raise TimeoutError("not ready")


def _p95(values: list[float]) -> float:
    return statistics.quantiles(values, n=20)[-1]


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main("service", measure, __doc__)
