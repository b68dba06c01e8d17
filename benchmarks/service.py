"""The evaluation service under load, on 127.0.0.1, with SQLite.

50 participants send 10,000-row files at once to a challenge that has 10,000 scored submissions
(`--quick`: 10, 1,000 and 1,000). `submit_p95_ms` is of the whole request, and `web_mb` the resident
memory of the web process afterwards. `leaderboard_made_cpu_ms` is the median of making the page.
`scoring_cpu_ratio` is the CPU time of two processes that run bare `pliant evaluate --hide-truth`
over that of two workers, per file, with one interpreter per file in both cases. Times on the clock
depend on what else runs on the machine; CPU times hardly do.
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
from contextlib import suppress
from pathlib import Path

import psutil
from record import Value, cpu_s, main
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
from pliant.spec.errors import CallError

CORES = 2
PLIANT = [sys.executable, "-c", "from pliant.cli.main import main; main()"]
RULES = {
    "phases": [
        {"name": "test", "split": "test", "attempts_per_day": 10**6, "attempts_total": 10**6}
    ],
    "submissions_per_minute": 1000,
}


def measure(quick: bool) -> Mapping[str, Value]:
    """Return the figures."""
    sizes = (10, 1_000, 1_000, 6) if quick else (50, 10_000, 10_000, 30)
    with tempfile.TemporaryDirectory(prefix="pliant-service-") as folder:
        return _measure(Path(folder), *sizes)


def _measure(
    place: Path, participants: int, row_count: int, stored: int, scored: int
) -> Mapping[str, Value]:
    public, private = _publish(place, row_count)
    config = place / "rules.json"
    config.write_text(json.dumps(RULES))
    root = place / "challenge"
    create_challenge(root, public, private, [], config)
    challenge = Challenge.open(root)
    with challenge.database.write() as session:
        made = [invite(session, f"team {n}", actor="host") for n in range(participants)]
        teams, tokens = [team.id for team, _ in made], [token for _, token in made]
    _store(challenge, teams, stored)
    dataset = Dataset.open(public)
    files = [place / f"{number}.parquet" for number in range(participants)]
    for number, file in enumerate(files):
        predict(dataset, "test", METHODS["random"](seed=number), file)
    address = "http://127.0.0.1:18437"
    command = [*PLIANT, "serve", str(root), "--port", "18437", "--workers", "0"]
    with open(place / "log", "wb") as log:
        server = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        _wait(lambda: _answers(address, tokens[0]))
        start = threading.Barrier(participants)
        web = psutil.Process(server.pid)
        before = _cpu_s(web)
        with ThreadPoolExecutor(participants) as pool:
            sent = list(pool.map(lambda *one: _timed_send(address, start, *one), tokens, files))
        submit_cpu_s = _cpu_s(web) - before
        web_mb = web.memory_info().rss / 1e6
        scoring_cpu_s = _service_cpu_s(challenge, root, scored)
    finally:
        server.terminate()
        server.wait()
    return {
        "participants": participants,
        "rows": row_count,
        "stored": stored,
        "submit_p95_ms": statistics.quantiles(sent, n=20)[-1],
        "submit_cpu_ms": submit_cpu_s / participants * 1000,
        "leaderboard_made_cpu_ms": _making_cpu_ms(challenge),
        "scoring_cpu_s": scoring_cpu_s,
        "scoring_cpu_ratio": _bare_cpu_s(files[:scored], public, private) / scoring_cpu_s,
        "web_mb": web_mb,
    }


def _publish(place: Path, rows: int) -> tuple[Path, Path]:
    """Make a small dataset with so many queries and publish it."""
    queries = QuerySettings(pairs_per_sequence=10, queries_per_pair=rows // 100)
    config = GenerateConfig(
        tiers=("rope",), splits={"test": 10}, frames=4, width=64, height=48, style="raster",
        queries=queries, id="load",
    )  # fmt: skip
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
        file = {"file_name": "a.parquet", "file_bytes": 1, "check_only": False}
        same = {"phase": "test", "state": "scored", **file}
        scored = {"version_id": version.id, "figures": figures, "coverage": 1.0}
        scored["receipt"] = {"figures": figures}
        rows, scores = [], []
        for number in range(1, count + 1):
            own = {"id": number, "team_id": teams[number % len(teams)], "created_ms": number}
            own |= {"file_sha256": f"{number:064x}", "method": f"method {number}"}
            rows.append({**same, **own, "finished_ms": number})
            place = float(hash(str(number)) % 9999) / 100
            scores.append({**scored, "submission_id": number, "main": place, "scored_ms": number})
        session.execute(insert(Submission), rows)
        session.execute(insert(Score), scores)


def _answers(address: str, token: str) -> bool:
    """Return whether the service answers."""
    with suppress(CallError):
        return bool(Client(address, token)._call("challenge"))
    return False


def _timed_send(address: str, start: threading.Barrier, token: str, file: Path) -> float:
    """Send a file when all are ready; return the milliseconds."""
    client = Client(address, token)
    start.wait()
    begun = time.perf_counter()
    client.send(file)
    return (time.perf_counter() - begun) * 1000


def _making_cpu_ms(challenge: Challenge) -> float:
    with challenge.database.read() as session:
        version = session.scalars(select(Version)).one()
        spent = [cpu_s(lambda: leaderboard(session, version, "best")) for _ in range(9)]
    return 1e3 * statistics.median(spent)


def _service_cpu_s(challenge: Challenge, root: Path, count: int) -> float:
    """Return the CPU seconds per file of two workers, without their start."""
    workers = [subprocess.Popen([*PLIANT, "challenge", "work", str(root)]) for _ in range(CORES)]
    try:
        _wait(lambda: _done(challenge) >= CORES)
        first = _done(challenge)
        used = sum(_cpu_s(psutil.Process(each.pid)) for each in workers)
        _wait(lambda: _done(challenge) >= first + count)
        used = sum(_cpu_s(psutil.Process(each.pid)) for each in workers) - used
        return used / (_done(challenge) - first)
    finally:
        for worker in workers:
            worker.terminate()
            worker.wait()


def _done(challenge: Challenge) -> int:
    with challenge.database.read() as session:
        query = select(func.count()).select_from(Job).where(Job.state == "done")
        return session.scalar(query) or 0


def _cpu_s(process: psutil.Process) -> float:
    """Return the CPU time of a process and of its children that have ended."""
    return sum(process.cpu_times()[:4])


def _bare_cpu_s(files: list[Path], public: Path, private: Path) -> float:
    """Return the CPU seconds per file of processes that evaluate it, two at a time."""
    code = (
        "import sys; from pliant.evaluator import evaluate; "
        "evaluate(sys.argv[1], sys.argv[2], truth=sys.argv[3], hide_truth=True)"
    )

    def bare(file: Path) -> None:
        subprocess.run([sys.executable, "-c", code, file, public, private], check=True)

    used = _cpu_s(psutil.Process())
    with ThreadPoolExecutor(CORES) as pool:
        list(pool.map(bare, files))
    return (_cpu_s(psutil.Process()) - used) / len(files)


def _wait(ready: Callable[[], bool], seconds: float = 900) -> None:
    end = time.monotonic() + seconds
    while not ready():
        if time.monotonic() > end:
            raise TimeoutError("not ready")
        time.sleep(0.05)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main("service", measure, __doc__)
