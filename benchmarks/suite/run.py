"""A benchmark from its config to its table: sets, trainings, answers, scores, pages."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol, get_args

from pliant.baselines.submission_file import Kind, check_split
from pliant.benchmarks.suite.checksums import Differences, compare_checksums, read_frozen
from pliant.benchmarks.suite.config import (
    TEST_SPLIT,
    BenchmarkConfig,
    PlannedAnswers,
    Test,
    digest,
    model_of,
)
from pliant.benchmarks.suite.jobs import AnswerJob, Job, Outcome, TrainingJob, run_all
from pliant.benchmarks.suite.work import Workspace
from pliant.evaluator import read_protocol
from pliant.generator.runner.run import generate
from pliant.models import CARD
from pliant.models.shipped import FOLDER
from pliant.spec.cores import cpu_cores
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, GenerationError, SpecError, TrainingError
from pliant.spec.io.reading import sha256_file
from pliant.spec.validation.validate import validate


class Watcher(Protocol):
    """Receives progress messages."""

    def begin(self, stage: str, jobs: int, finished: int) -> None:
        """Take note that a stage begins, with so many jobs, some finished by an earlier call."""

    def started(self, job: str) -> None:
        """Take note that a job starts."""

    def progress(self, job: str, done: int, total: int) -> None:
        """Take note of how far a job is."""

    def ended(self, job: str, wall_s: float, cpu_s: float, error: str) -> None:
        """Take note that a job ended, and of its error, if any."""


def run_benchmark(
    config: BenchmarkConfig,
    out: Path,
    *,
    resume: bool = False,
    workers: int = 2,
    until: str = "answer",
    watcher: Watcher,
) -> Differences:
    """Make what is missing of a benchmark, stage by stage.

    Args:
        config: The benchmark.
        out: Its folder: new or empty, or with `resume` one that was begun.
        resume: Go on.
        workers: Processes at a time; each training takes its share of the cores.
        until: Last stage to do: `generate`, `train` or `answer`.
        watcher: Receives progress messages.

    Returns:
        How the test queries differ from the frozen ones.

    Raises:
        CallError: The folder or the config cannot be used.
        GenerationError: A sequence could not be made.
        TrainingError: A training or an answer failed; what was finished is kept.
    """
    read_frozen(config)  # what is wrong with it is said before the work
    work = Workspace(out)
    work.open(config.name, config.version, resume=resume)
    _generate(config, work, workers, watcher)
    differences = compare_checksums(config, work)
    if until == "generate":
        return differences
    if config.runs:
        _train(config, work, workers, watcher)
    if until == "train":
        return differences
    _answer(config, work, workers, watcher)
    return differences


def set_digest(config: BenchmarkConfig, name: str) -> str:
    """Return what identifies a set."""
    return digest(config.sets[name].resolved())


def run_digest(config: BenchmarkConfig, name: str) -> str:
    """Return what identifies a training: its settings and its set."""
    run = config.runs[name]
    return digest(run.trainer, run.settings, set_digest(config, run.set))


def _generate(config: BenchmarkConfig, work: Workspace, workers: int, watcher: Watcher) -> None:
    identities = {name: set_digest(config, name) for name in config.sets}
    missing = {
        name: each for name, each in identities.items() if not work.is_current(f"set/{name}", each)
    }
    watcher.begin("generate", len(identities), len(identities) - len(missing))
    for name, identity in missing.items():
        watcher.started(name)
        stage = f"set/{name}"
        with work.metered(stage, identity) as facts:
            summary = generate(
                config.sets[name],
                work.set_path(name),
                workers=workers,
                progress=lambda state, name=name: watcher.progress(  # type: ignore[misc]
                    name, state.frames, state.frames_wanted
                ),
            )
            facts |= {"sequences": summary.sequences, "frames": summary.frames}
            if summary.failed:
                first = summary.failed[0]
                raise GenerationError(
                    "sequences could not be made",
                    path=work.set_path(name),
                    where=first.id,
                    found=first.error.splitlines()[-1],
                    fix="Run the same command again to retry them",
                )
            if name in config.asked:
                check_split(Dataset.open(work.set_path(name)), TEST_SPLIT)
            if config.validated:
                _validate(work.set_path(name), workers)
        cost = work.cost(stage)
        watcher.ended(name, cost.wall_s, cost.cpu_s, "")


def _validate(root: Path, workers: int) -> None:
    report = validate(root, workers=workers)
    if report.errors:
        raise SpecError(
            f"the generated dataset violates the specification {report.errors} times",
            path=root,
            found=str(report.issues[0]),
            fix=f"List all violations with: pliant validate {shlex.quote(str(root))}",
        )


def _train(config: BenchmarkConfig, work: Workspace, workers: int, watcher: Watcher) -> None:
    threads = max(1, cpu_cores() // workers)
    cache = (work.root / "cache").resolve()
    jobs: dict[str, Job] = {}
    for name, run in config.runs.items():
        note = work.finished(f"run/{name}")
        if note is None:
            data, folder = work.set_path(run.set), work.run_path(name)
            jobs[name] = TrainingJob(run.trainer, run.settings, data, folder, threads, cache)
        elif note["digest"] != run_digest(config, name):
            raise CallError(
                "this training was made with other settings",
                path=work.run_path(name),
                fix="Remove it and its note in stages/ to train it again, or give another folder",
            )
    watcher.begin("train", len(config.runs), len(config.runs) - len(jobs))
    identities = {f"run/{name}": run_digest(config, name) for name in jobs}
    _run(jobs, "run", identities, work, workers, watcher)


def _answer(config: BenchmarkConfig, work: Workspace, workers: int, watcher: Watcher) -> None:
    threads = max(1, cpu_cores() // workers)
    every: dict[str, AnswerJob] = {}
    identities: dict[str, str] = {}
    for asked in sorted(config.answers, key=_turn):
        test, entry = asked.test, asked.entry
        identities[asked.stage] = digest(
            set_digest(config, asked.set),
            _method_digest(config, test, entry.method),
            [read_protocol(name).sha256 for name in test.protocols],
        )
        scores = {p: work.scores_path(asked.set, entry.stored, p) for p in test.protocols}
        answers = {
            kind: work.answers_path(asked.set, entry.stored, kind)
            for kind in get_args(Kind)
            if any(read_protocol(protocol).kind == kind for protocol in test.protocols)
        }
        run = _run_folder(work, test, entry.method)
        data = work.set_path(asked.set)
        options = test.answer if entry.method in test.shipped else {}
        every[asked.stage] = AnswerJob(entry, run, data, answers, scores, threads, options)
    jobs: dict[str, Job] = {
        stage.removeprefix("answer/"): job
        for stage, job in every.items()
        if not work.is_current(stage, identities[stage])
    }
    watcher.begin("answer", len(every), len(every) - len(jobs))
    _run(jobs, "answer", identities, work, workers, watcher)


def _turn(asked: PlannedAnswers) -> tuple[int, int]:
    """Return when it is its turn: the first variants and tracks come first."""
    return [*asked.test.variants].index(asked.variant), asked.test.tracks.index(asked.entry.track)


def _run_folder(work: Workspace, test: Test, method: str) -> Path | None:
    """Return the folder of what was trained, None for a method without training."""
    if method in test.shipped:
        return FOLDER / model_of(method)
    return work.run_path(method) if method in test.runs else None


def _method_digest(config: BenchmarkConfig, test: Test, method: str) -> str:
    if method in test.runs:
        return run_digest(config, method)
    if method in test.shipped:
        folder = FOLDER / model_of(method)
        files = sorted(path for path in folder.iterdir() if path.name != CARD)
        return digest([sha256_file(path) for path in files], test.answer)
    return method


def _run(
    jobs: Mapping[str, Job],
    kind: str,
    identities: Mapping[str, str],
    work: Workspace,
    workers: int,
    watcher: Watcher,
) -> None:
    failures: list[str] = []

    def ended(name: str, outcome: Outcome) -> None:
        stage = f"{kind}/{name}"
        finished = not outcome.error
        work.record(stage, identities[stage], outcome.cost, finished=finished, facts=outcome.facts)
        cost = work.cost(stage)
        watcher.ended(name, cost.wall_s, cost.cpu_s, outcome.error)
        if outcome.error:
            failures.append(f"{name}: {outcome.error}")

    fresh = kind == "run"  # a training takes much memory and its cost is published
    run_all(jobs, workers, watcher.started, watcher.progress, ended, fresh=fresh)
    if failures:
        raise TrainingError(
            failures[0], path=work.root, fix="What was finished is kept; go on with --resume"
        )
