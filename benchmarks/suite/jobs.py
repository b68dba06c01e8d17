"""What a process of the benchmark does: train one run, or answer and score one test."""

from __future__ import annotations

import os

# Waiting threads sleep: CPU time is then work, also where other processes run as well.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import multiprocessing
import shutil
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pliant.baselines import METHODS, KeypointMatcher
from pliant.baselines.conditions import with_inputs
from pliant.baselines.fused_tracker import PREFIX as FUSED
from pliant.baselines.fused_tracker import FusedTracker
from pliant.baselines.matcher import SplitMatcher
from pliant.baselines.predict import predict
from pliant.baselines.submission_file import Kind
from pliant.benchmarks.suite.config import TEST_SPLIT, Entry, trainer_of
from pliant.benchmarks.suite.work import Cost, Meter
from pliant.evaluator import evaluate, read_protocol, write_report
from pliant.spec.configuration import settings_from
from pliant.spec.dataset import Dataset
from pliant.spec.errors import PliantError
from pliant.spec.progress import Progress


@dataclass(frozen=True)
class TrainingJob:
    """One training.

    Attributes:
        trainer: `don` or `timecycle`.
        settings: Its settings.
        data: The set's folder.
        run: The run's folder.
        threads: CPU threads, 0 for torch's own choice.
        cache: Folder of decoded frames, which trainings on the same set share.
    """

    trainer: str
    settings: Mapping[str, Any]
    data: Path
    run: Path
    threads: int
    cache: Path


@dataclass(frozen=True)
class AnswerJob:
    """One method in one track, on one set.

    Attributes:
        entry: The method and its track.
        run: The run's folder of a learned method, or None.
        data: The set's folder.
        answers: Kind (`answers`, `matches`) -> submission to write.
        scores: Protocol -> folder of the report.
        threads: CPU threads.
        options: How a learned method answers, instead of what its config says.
    """

    entry: Entry
    run: Path | None
    data: Path
    answers: Mapping[Kind, Path]
    scores: Mapping[str, Path]
    threads: int
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """What became of a job.

    Attributes:
        cost: What it took.
        facts: What there is to note.
        error: The error's sentence, empty if it went well.
    """

    cost: Cost
    facts: Mapping[str, Any]
    error: str = ""


Job = TrainingJob | AnswerJob


def run_job(job: Job, progress: Progress) -> Outcome:
    """Train, going on where an earlier attempt stopped; or answer queries and score the answers."""
    meter = Meter()
    try:
        if isinstance(job, TrainingJob):
            facts = _train(job, progress)
        else:
            facts = _answer(job, meter, progress)
    except PliantError as error:
        return Outcome(meter.cost, {}, str(error))
    return Outcome(meter.cost, facts)


def _train(job: TrainingJob, progress: Progress) -> dict[str, Any]:
    resume = any((job.run / "checkpoints").glob("*"))
    if job.run.exists() and not resume:
        shutil.rmtree(job.run)  # stopped before its first checkpoint
    dataset = Dataset.open(job.data)
    values = {**job.settings, "threads": job.threads, "cache_dir": str(job.cache)}
    kind, train = trainer_of(job.trainer)
    chosen: Any = settings_from(kind, values)

    def reporting(step: int, figures: Mapping[str, float]) -> None:
        del figures
        progress(step, chosen.steps)

    facts = train(dataset, job.run, chosen, resume=resume, progress=reporting)
    return {"steps": facts["steps"], "validation": facts.get("validation", {})}


def _answer(job: AnswerJob, meter: Meter, progress: Progress) -> dict[str, Any]:
    dataset = Dataset.open(job.data)
    matcher: Any
    if job.run is None:
        matcher = METHODS[job.entry.method]()
    else:
        import torch

        from pliant.models import load_matcher
        from pliant.models.timecycle import CARRIED
        from pliant.models.timecycle.carried import CarriedPoints

        torch.set_num_threads(job.threads or torch.get_num_threads())
        matcher = load_matcher(job.run, **job.options)
        if job.entry.method.startswith(FUSED):
            matcher = FusedTracker(matcher)
        elif job.entry.method.startswith(CARRIED):
            matcher = CarriedPoints(matcher)
        matcher.name = job.entry.method
    if not isinstance(matcher, SplitMatcher):
        matcher = with_inputs(matcher, job.entry.track, is_blank=job.entry.is_blank)
    facts: dict[str, Any] = {}
    for kind, out in job.answers.items():
        if kind == "matches" and not isinstance(matcher, KeypointMatcher):
            continue
        out.parent.mkdir(parents=True, exist_ok=True)
        before_s = meter.cost.cpu_s
        masks = job.entry.track != "none"
        prediction = predict(
            dataset, TEST_SPLIT, matcher, out, kind, masks=masks, progress=progress
        )
        cpu_s = meter.cost.cpu_s - before_s
        if kind == "answers":
            facts = {"pairs": prediction.pairs, "rows": prediction.rows, "predict_cpu_s": cpu_s}
        for protocol, folder in job.scores.items():
            if read_protocol(protocol).kind == kind:
                shutil.rmtree(folder, ignore_errors=True)
                folder.parent.mkdir(parents=True, exist_ok=True)
                scores = evaluate(out, dataset, protocol=protocol)
                write_report(scores, folder, data=dataset)
    return facts


def run_all(
    jobs: Mapping[str, Job],
    workers: int,
    started: Callable[[str], None],
    progress: Callable[[str, int, int], None],
    ended: Callable[[str, Outcome], None],
    *,
    fresh: bool = True,
) -> None:
    """Run jobs in other processes, in order.

    Args:
        jobs: Name -> job.
        workers: Processes at a time.
        started: Called when a job starts.
        progress: Called with the progress of a job.
        ended: Called with the result of a job. After one that failed, no other is started.
        fresh: Start a new process for each job, so that its memory is returned.
    """
    context = multiprocessing.get_context("spawn")
    news = context.SimpleQueue()
    waiting = list(jobs)
    running: dict[Future[Outcome], str] = {}
    with ProcessPoolExecutor(
        min(workers, max(1, len(jobs))),
        context,
        initializer=_connect,
        initargs=(news,),
        max_tasks_per_child=1 if fresh else None,
    ) as pool:
        while running or waiting:
            while waiting and len(running) < workers:
                name = waiting.pop(0)
                started(name)
                running[pool.submit(_reporting, jobs[name], name)] = name
            finished, _ = wait(running, timeout=0.5, return_when=FIRST_COMPLETED)
            while not news.empty():
                progress(*news.get())
            for future in finished:
                outcome = future.result()
                ended(running.pop(future), outcome)
                if outcome.error:
                    waiting.clear()


_NEWS: list[Any] = []
"""In a process of the pool: the queue to report to."""


def _connect(news: Any) -> None:
    _NEWS.append(news)


def _reporting(job: Job, name: str) -> Outcome:
    last = [-1]

    def progress(done: int, total: int) -> None:
        share = done * 200 // max(total, 1)
        if share != last[0]:  # at most 200 messages a job
            last[0] = share
            _NEWS[0].put((name, done, total))

    return run_job(job, progress)
