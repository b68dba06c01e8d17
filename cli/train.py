"""`pliant train`: train a learned method."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pliant.cli.interrupts import terminated_like_interrupted
from pliant.cli.options import set_option
from pliant.cli.terminal import echo
from pliant.spec.errors import MissingExtraError

if TYPE_CHECKING:
    from pliant.models.training.loop import Progress


@click.group("train")
def command() -> None:
    """Train a learned method on a dataset.

    A run is a folder; `pliant predict RUN` and `pliant match RUN` answer with it afterwards.
    """


def _run_options(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options that every method's command has."""
    options = (
        click.option(
            "--data", required=True, type=click.Path(path_type=Path), help="Dataset folder."
        ),
        click.option(
            "--out", required=True, type=click.Path(path_type=Path), help="Folder of the run."
        ),
        click.option(
            "--config",
            "config_file",
            type=click.Path(path_type=Path),
            help="YAML file of settings; what it leaves out keeps its default.",
        ),
        set_option,
        click.option("--resume", is_flag=True, help="Go on from the run's newest checkpoint."),
        click.option(
            "--json", "as_json", is_flag=True, help="Report as one JSON document on stdout."
        ),
    )
    for option in reversed(options):
        function = option(function)
    return function


@command.command("don")
@_run_options
def don(
    data: Path,
    out: Path,
    config_file: Path | None,
    overrides: tuple[str, ...],
    resume: bool,
    as_json: bool,
) -> None:
    """Train Dense Object Nets: a descriptor at every pixel, the same for the same point.

    Without --config, the recipe shipped for the tier's kind is taken: two CPU cores, an hour or so.
    Several processes: `torchrun --nproc-per-node N --no-python pliant train don …`.
    With --resume and no settings of its own, a run goes on with those it began with.
    """
    try:
        from pliant.models.don.trainer import shipped_recipe, train_don
        from pliant.models.settings import DonSettings
        from pliant.spec.configuration import read_settings
    except ImportError as error:
        raise MissingExtraError("training", "train") from error
    from pliant.spec.dataset import Dataset

    dataset = Dataset.open(data)
    config_file = config_file or _begun_config(out, resume)
    if config_file is None:
        tier = read_settings(DonSettings, None, overrides).tier
        config_file = shipped_recipe(dataset, tier)
    settings = read_settings(DonSettings, config_file, overrides)
    _train(
        partial(train_don, dataset, out, settings, resume=resume),
        settings.steps,
        data,
        out,
        _don_figures if not as_json else None,
    )


@command.command("timecycle")
@_run_options
def timecycle(
    data: Path,
    out: Path,
    config_file: Path | None,
    overrides: tuple[str, ...],
    resume: bool,
    as_json: bool,
) -> None:
    """Train TimeCycle: descriptors from episodes alone, by tracking back and forth in time.

    Several processes: `torchrun --nproc-per-node N --no-python pliant train timecycle …`.
    With --resume and no settings of its own, a run goes on with those it began with.
    """
    try:
        from pliant.models.timecycle.settings import TimeCycleSettings
        from pliant.models.timecycle.trainer import train_timecycle
        from pliant.spec.configuration import read_settings
    except ImportError as error:
        raise MissingExtraError("training", "train") from error
    from pliant.spec.dataset import Dataset

    dataset = Dataset.open(data)
    config_file = config_file or _begun_config(out, resume)
    settings = read_settings(TimeCycleSettings, config_file, overrides)
    _train(
        partial(train_timecycle, dataset, out, settings, resume=resume),
        settings.steps,
        data,
        out,
        _timecycle_figures if not as_json else None,
    )


def _begun_config(out: Path, resume: bool) -> Path | None:
    """Return the config that a run to resume began with, or None."""
    begun = out / "config.yaml"
    return begun if resume and begun.is_file() else None


def _train(
    train: Callable[..., dict[str, Any]],
    steps: int,
    data: Path,
    out: Path,
    tell: Callable[[Mapping[str, Any]], None] | None,
) -> None:
    """Train with a bar, then say what came of it: with `tell`, or all facts as JSON without."""
    first = os.environ.get("RANK", "0") == "0"
    said = f"Interrupted: go on with --resume --out {out}" if first else ""
    with terminated_like_interrupted(said), _bar(steps, shown=first) as progress:
        facts = train(progress=progress)
    if not first:
        return
    if tell is None:
        echo(json.dumps({"run": str(out), **facts}, indent=1, sort_keys=True))
        return
    tell(facts)
    echo(f"Report: {out / 'report.html'}")
    echo(f"Answer with it: pliant predict {out} --data {data} --split test --out SUB.parquet")


def _don_figures(facts: Mapping[str, Any]) -> None:
    figures = facts.get("validation", {})
    echo(
        f"{facts['steps']} steps; validation RMSE {figures.get('rmse_px', float('nan')):.1f} px "
        f"pooled, {figures.get('rmse_px_mean_over_pairs', float('nan')):.1f} px mean over pairs, "
        f"median {figures.get('median_px', float('nan')):.1f} px"
    )


def _timecycle_figures(facts: Mapping[str, Any]) -> None:
    guard = facts.get("guard", {})
    for method, errors in guard.get("rmse_px_of_640", {}).items():
        listed = ", ".join(f"{value:.1f} after {frames}" for frames, value in errors.items())
        echo(f"{method:10} RMSE, px of 640, by frames since the query: {listed}")
    echo(guard.get("verdict", "The run has not been validated."))


@contextmanager
def _bar(steps: int, *, shown: bool) -> Iterator[Progress]:
    """Yield a progress callback that draws on stderr."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns: list[Any] = [
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]} steps/s"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[figures]}"),
    ]
    with Progress(*columns, console=Console(stderr=True), disable=not shown) as bar:
        task = bar.add_task("Training", total=steps, rate="…", figures="")
        latest: dict[str, float] = {}

        def show(step: int, figures: Mapping[str, float]) -> None:
            latest.update(figures)
            texts = []
            if "loss" in latest:
                texts.append(f"loss {latest['loss']:.3f}")
            if "val/rmse_px" in latest:
                texts.append(f"val RMSE {latest['val/rmse_px']:.1f} px")
            speed = bar.tasks[0].speed
            bar.update(
                task,
                completed=step,
                rate="…" if speed is None else f"{speed:.1f}",
                figures=", ".join(texts),
            )

        yield show
