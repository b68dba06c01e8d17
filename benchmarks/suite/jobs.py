"""What a process of the benchmark does: train one run, or answer and score one test."""

from __future__ import annotations

import os

# Waiting threads sleep: CPU time is then work, also where other processes run as well.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pliant.baselines.submission_file import Kind
from pliant.benchmarks.suite.work import Cost, Meter
from pliant.spec.dataset import Dataset
from pliant.spec.errors import PliantError
from pliant.spec.progress import Progress

"""Called with the work done and the total work."""


@dataclass(frozen=True)
class TrainingJob:
    """One training.

    Attributes:
        trainer: `don` or `timecycle`.
        settings: Its settings.
        data: The set's folder.
        run: The run's folder.
        after: Weights to start from, or None.
        threads: CPU threads, 0 for torch's own choice.
        cache: Folder of decoded frames, which trainings on the same set share.
    """

    trainer: str
    settings: Mapping[str, Any]
    data: Path
    run: Path
    after: Path | None
    threads: int
    cache: Path


@dataclass(frozen=True)
class AnswerJob:
    """One method on one test.

    Attributes:
        method: A key of `pliant.baselines.METHODS`, or a name for `run`.
        run: The run's folder of a learned method, or None.
        data: The set's folder.
        answers: Kind (`answers`, `matches`) -> submission to write.
        scores: Protocol -> folder of the report.
        threads: CPU threads.
        masks: Whether the method is given masks.
    """

    method: str
    run: Path | None
    data: Path
    answers: Mapping[Kind, Path]
    scores: Mapping[str, Path]
    threads: int
    masks: bool = True


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


def train(job: TrainingJob, tell: Progress) -> Outcome:
    """Train, going on where an earlier attempt stopped."""
    meter = Meter()
    try:
        facts = _trained(job, tell)
    except PliantError as error:
        return Outcome(meter.cost, {}, str(error))
    return Outcome(meter.cost, facts)


def _trained(job: TrainingJob, tell: Progress) -> dict[str, Any]:
    resume = any((job.run / "checkpoints").glob("*"))
    if job.run.exists() and not resume:
        shutil.rmtree(job.run)  # stopped before its first checkpoint
    dataset = Dataset.open(job.data)
    values = {**job.settings, "threads": job.threads, "cache_dir": str(job.cache)}

    def telling(steps: int) -> Callable[[int, Mapping[str, float]], None]:
        return lambda step, figures: tell(step, steps)

    from pliant.spec.configuration import settings_from

    if job.trainer == "timecycle":
        from pliant.models.timecycle.settings import TimeCycleSettings
        from pliant.models.timecycle.trainer import train_timecycle

        cycle = settings_from(TimeCycleSettings, values)
        told = telling(cycle.steps)
        facts = train_timecycle(dataset, job.run, cycle, resume=resume, progress=told)
        return {"steps": facts["steps"]}
    from pliant.models.don.settings import DonSettings
    from pliant.models.don.trainer import train_don

    if job.after is not None:
        values["network"] = {**values.get("network", {}), "pretrained": str(job.after)}
    don = settings_from(DonSettings, values)
    facts = train_don(dataset, job.run, don, resume=resume, progress=telling(don.steps))
    return {"steps": facts["steps"], "validation": facts.get("validation", {})}


def answer(job: AnswerJob, tell: Progress) -> Outcome:
    """Answer a test's queries and score the answers."""
    from pliant.baselines import METHODS, KeypointMatcher
    from pliant.baselines.predict import predict
    from pliant.evaluator import evaluate, read_protocol, write_report

    meter = Meter()
    try:
        dataset = Dataset.open(job.data)
        matcher: Any
        if job.run is None:
            matcher = METHODS[job.method]()
        else:
            import torch

            from pliant.models import load_matcher

            torch.set_num_threads(job.threads or torch.get_num_threads())
            matcher = load_matcher(job.run)
            matcher.name = job.method
        facts: dict[str, Any] = {}
        for kind, out in job.answers.items():
            if kind == "matches" and not isinstance(matcher, KeypointMatcher):
                continue
            out.parent.mkdir(parents=True, exist_ok=True)
            before_s = meter.cost.cpu_s
            prediction = predict(
                dataset, "test", matcher, out, kind, masks=job.masks, progress=tell
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
    except PliantError as error:
        return Outcome(meter.cost, {}, str(error))
    return Outcome(meter.cost, facts)


def run_all(
    jobs: Mapping[str, tuple[Callable[[Any, Progress], Outcome], Any, Sequence[str]]],
    workers: int,
    started: Callable[[str], None],
    tell: Callable[[str, int, int], None],
    ended: Callable[[str, Outcome], None],
    *,
    fresh: bool = True,
) -> None:
    """Run jobs in other processes, each as soon as those it needs have ended.

    Args:
        jobs: Name -> function, its job, and the names of jobs that must have ended before.
        workers: Processes at a time.
        started: Called when a job starts.
        tell: Called with the progress of a job.
        ended: Called with the result of a job. After one that failed, no other is started.
        fresh: Start a new process for each job, so that its memory is returned.
    """
    import multiprocessing
    from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait

    context = multiprocessing.get_context("spawn")
    news = context.SimpleQueue()
    waiting = dict(jobs)
    running: dict[Future[Outcome], str] = {}
    done: set[str] = set()
    failed = False
    with ProcessPoolExecutor(
        min(workers, max(1, len(jobs))),
        context,
        initializer=_connect,
        initargs=(news,),
        max_tasks_per_child=1 if fresh else None,
    ) as pool:
        while running or (waiting and not failed):
            for name in list(waiting):
                function, job, needs = waiting[name]
                if failed or len(running) >= workers or not set(needs) <= done:
                    continue
                del waiting[name]
                started(name)
                running[pool.submit(_reporting, function, job, name)] = name
            finished, _ = wait(running, timeout=0.5, return_when=FIRST_COMPLETED)
            while not news.empty():
                tell(*news.get())
            for future in finished:
                name = running.pop(future)
                outcome = future.result()
                ended(name, outcome)
                done.add(name)
                failed = failed or bool(outcome.error)


_NEWS: list[Any] = []
"""In a process of the pool: the queue to report to."""


def _connect(news: Any) -> None:
    _NEWS.append(news)


def _reporting(function: Callable[[Any, Progress], Outcome], job: Any, name: str) -> Outcome:
    last = [-1]

    def tell(done: int, total: int) -> None:
        share = done * 200 // max(total, 1)
        if share != last[0]:  # at most 200 messages a job
            last[0] = share
            _NEWS[0].put((name, done, total))

    return function(job, tell)
