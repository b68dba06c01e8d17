"""The folder a benchmark is made in: what is done already, and what it cost."""

from __future__ import annotations

import json
import platform
import resource
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from pliant.baselines.submission_file import Kind
from pliant.spec.cores import cpu_cores
from pliant.spec.errors import CallError
from pliant.spec.io.jsonfiles import write_json

_IDENTITY: Final = "benchmark.json"


@dataclass(frozen=True)
class Cost:
    """What a stage took.

    Attributes:
        wall_s: Seconds on the clock.
        cpu_s: Seconds of processors, all processes of the stage together.
    """

    wall_s: float = 0.0
    cpu_s: float = 0.0

    def __add__(self, other: Cost) -> Cost:
        return Cost(self.wall_s + other.wall_s, self.cpu_s + other.cpu_s)


class Meter:
    """Measures a block: this process, and the processes it started and waited for."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), _cpu_s()

    @property
    def cost(self) -> Cost:
        """What was spent since the meter was made."""
        return Cost(time.perf_counter() - self._wall, _cpu_s() - self._cpu)


def _cpu_s() -> float:
    own = resource.getrusage(resource.RUSAGE_SELF)
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


class Workspace:
    """A benchmark's folder: `sets/`, `runs/`, `answers/`, `scores/`, and a note per finished stage.

    Args:
        root: The folder.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def open(self, name: str, version: str, *, resume: bool) -> None:
        """Take a new or empty folder, or with `resume` one that was begun.

        Raises:
            CallError: It contains something else, or another benchmark.
        """
        begun = self.root / _IDENTITY
        if self.root.exists() and not self.root.is_dir():
            raise CallError("this is not a folder", path=self.root)
        if begun.is_file():
            found = json.loads(begun.read_text())
            if (found.get("name"), found.get("version")) != (name, version):
                raise CallError(
                    "the folder contains another benchmark",
                    path=self.root,
                    found=f"{found.get('name')} {found.get('version')}",
                    required=f"{name} {version}",
                )
            if not resume:
                raise CallError(
                    "this benchmark was begun already",
                    path=self.root,
                    fix="Go on with --resume, or give another folder",
                )
            return
        if self.root.is_dir() and any(self.root.iterdir()):
            raise CallError("the folder is not empty and contains no benchmark", path=self.root)
        self.root.mkdir(parents=True, exist_ok=True)
        (self.root / "stages").mkdir(exist_ok=True)
        write_json(begun, {"name": name, "version": version})

    def set_path(self, name: str) -> Path:
        """Return the folder of a dataset."""
        return self.root / "sets" / name

    def run_path(self, name: str) -> Path:
        """Return the folder of a training run."""
        return self.root / "runs" / name

    def answers_path(self, set_name: str, method: str, kind: Kind = "answers") -> Path:
        """Return the submission of a method on a set's test split."""
        name = method if kind == "answers" else f"{method}-{kind}"
        return self.root / "answers" / set_name / f"{name}.parquet"

    def scores_path(self, set_name: str, method: str, protocol: str) -> Path:
        """Return the folder of a submission's scores by a protocol."""
        return self.root / "scores" / set_name / method / protocol

    def _note(self, stage: str) -> Path:
        return self.root / "stages" / f"{stage.replace('/', '--')}.json"

    def _read(self, stage: str) -> dict[str, Any] | None:
        note = self._note(stage)
        found: dict[str, Any] | None = json.loads(note.read_text()) if note.is_file() else None
        return found

    def notes(self) -> dict[str, dict[str, Any]]:
        """Return the note of every stage that was begun, by stage, sorted."""
        return {
            path.stem.replace("--", "/", 1): json.loads(path.read_text())
            for path in sorted((self.root / "stages").glob("*.json"))
        }

    def finished(self, stage: str) -> dict[str, Any] | None:
        """Return the note of a finished stage: its digest and cost; None if it is not."""
        found = self._read(stage)
        return found if found is not None and found.get("finished") else None

    def is_current(self, stage: str, digest: str) -> bool:
        """Return whether a stage is finished, and was made from just this."""
        found = self.finished(stage)
        return found is not None and found["digest"] == digest

    def cost(self, stage: str) -> Cost:
        """Return what a stage has cost so far, interrupted attempts included."""
        found = self._read(stage)
        return Cost() if found is None else Cost(float(found["wall_s"]), float(found["cpu_s"]))

    def record(
        self,
        stage: str,
        digest: str,
        cost: Cost,
        *,
        finished: bool,
        facts: Mapping[str, Any] | None = None,
    ) -> None:
        """Note that a stage ended, or how far it came.

        Costs add up over interrupted attempts at the same; a stage that is made again from other
        things costs what that took.
        """
        before = self._read(stage)
        goes_on = before is not None and not before["finished"] and before["digest"] == digest
        total = self.cost(stage) + cost if goes_on else cost
        note = {"digest": digest, "finished": finished, **asdict(total)}
        note |= {"machine": processor_name(), "cores": cpu_cores(), "facts": dict(facts or {})}
        write_json(self._note(stage), note)

    @contextmanager
    def metered(self, stage: str, digest: str) -> Iterator[dict[str, Any]]:
        """Meter a block in this process and note its cost, whether it ends or is interrupted.

        Yields:
            A mapping to put facts of the stage in.
        """
        meter = Meter()
        facts: dict[str, Any] = {}
        try:
            yield facts
        except BaseException:
            self.record(stage, digest, meter.cost, finished=False, facts=facts)
            raise
        self.record(stage, digest, meter.cost, finished=True, facts=facts)


def processor_name() -> str:
    """Return the processor's model, as far as the system tells it."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"
