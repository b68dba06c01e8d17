"""`pliant benchmark`: a reference benchmark from its config to its table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pliant.cli.options import (
    PATH,
    choice_option,
    json_option,
    out_option,
    set_option,
)
from pliant.cli.terminal import echo, echo_json, rich_progress, terminated_like_interrupted
from pliant.spec.cores import cpu_cores
from pliant.spec.extras import require_packages

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from pliant.benchmarks.suite.checksums import Differences
    from pliant.benchmarks.suite.config import BenchmarkConfig

_TITLES = {"generate": "Making sets", "train": "Training", "answer": "Answering and scoring"}


@click.command()
@click.argument("config_file", metavar="CONFIG", type=PATH)
@out_option("DIR", "Output folder.")
@set_option("common.style=fast")
@click.option("--resume", is_flag=True, help="Continue the benchmark in DIR.")
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    metavar="N",
    help="Processes at a time; default: one per GPU, without GPUs one per CPU core.",
)
@choice_option(
    "--until",
    list(_TITLES),
    "Last stage to run; the table contains what is scored by then.",
    "answer",
)
@click.option(
    "--test",
    "tests",
    multiple=True,
    metavar="NAME",
    help="Only this block of the table, with the sets and trainings it needs (repeatable).",
)
@json_option
def command(
    config_file: Path,
    out: Path,
    overrides: tuple[str, ...],
    resume: bool,
    workers: int | None,
    until: str,
    tests: tuple[str, ...],
    as_json: bool,
) -> int:
    """Make a reference benchmark: generate, train, answer, evaluate, and write the table.

    CONFIG is benchmarks/pliant-v3.yaml, benchmarks/pliant-v3-mini.yaml or a config of that form.
    Writes sets/, runs/, answers/, scores/, checksums.json, table.json, results.md and
    report/index.html into DIR. --resume continues an interrupted run. Exit code 1 if the test
    queries differ from the frozen ones.
    """
    require_packages(("numba", "cv2", "torch"), "a benchmark", "all")
    from pliant.benchmarks.suite.config_file import read_config

    config = read_config(config_file, overrides)
    if tests:
        config = config.only(tests)
    differing = run_with_progress(config, out, resume, workers or _default_workers(), until)
    from pliant.benchmarks.suite.page import write_results

    chosen = "".join(f" --test {name}" for name in config.part)
    called = f"pliant benchmark {config_file} --out DIR{chosen}"
    document = write_results(config, out, differing, called)
    if as_json:
        echo_json(document, sort_keys=True)
    else:
        echo(f"Table: {out / 'results.md'}")
        if not differing.frozen:
            echo("There are no frozen checksums to compare the test queries with.")
        elif not differing.sets:
            echo("The test queries are the frozen ones.")
    for name, what in differing.sets.items():
        echo(f"Not the frozen test queries: {name}, {what}", err=True)
    return 1 if differing.sets else 0


def run_with_progress(
    config: BenchmarkConfig, out: Path, resume: bool, workers: int, until: str = "answer"
) -> Differences:
    """Run a benchmark and show its progress; arguments and errors as `run_benchmark`."""
    from pliant.benchmarks.suite.run import run_benchmark

    message = "Interrupted: finished work is kept; the same command resumes (benchmark: --resume)."
    with terminated_like_interrupted(message), rich_progress(time_left=True) as bar:
        return run_benchmark(
            config, out, resume=resume, workers=workers, until=until, watcher=_Display(bar)
        )


def _default_workers() -> int:
    import torch

    return torch.cuda.device_count() or cpu_cores()


class _Display:
    """Shows progress on stderr: a bar for each running job, a line for each finished one."""

    def __init__(self, bar: Progress) -> None:
        self._bar = bar
        self._tasks: dict[str, TaskID] = {}
        self._stage: TaskID | None = None

    def _print(self, text: str) -> None:
        self._bar.console.print(text, highlight=False, soft_wrap=True)

    def begin(self, stage: str, jobs: int, finished: int) -> None:
        title = _TITLES[stage]
        there = f", {finished} of them there already" if finished else ""
        self._print(f"{title}: {jobs}{there}")
        if self._stage is not None:
            self._bar.remove_task(self._stage)
        self._stage = self._bar.add_task(title, total=jobs, completed=finished, facts="")

    def started(self, job: str) -> None:
        self._tasks[job] = self._bar.add_task(f"  {job}", total=None, facts="")

    def progress(self, job: str, done: int, total: int) -> None:
        if job in self._tasks:
            self._bar.update(self._tasks[job], completed=done, total=total)

    def ended(self, job: str, wall_s: float, cpu_s: float, error: str) -> None:
        self._bar.remove_task(self._tasks.pop(job))
        if self._stage is not None:
            self._bar.advance(self._stage)
        said = f"FAILED: {error}" if error else f"{wall_s / 60:.1f} min, {cpu_s / 60:.1f} CPU min"
        self._print(f"  {job}: {said}")
