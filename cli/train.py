"""`pliant train`: train a learned method."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from pliant.cli.generate import GenerationDisplay
from pliant.cli.options import PATH, data_option, json_option, out_option, path_option, set_option
from pliant.cli.terminal import (
    Bar,
    echo,
    echo_json,
    echo_result,
    progress_bar,
    terminated_like_interrupted,
    to_call,
)

if TYPE_CHECKING:
    from pliant.spec.dataset import Dataset

F = TypeVar("F", bound=Callable[..., None])


@click.group("train")
def command() -> None:
    """Train a learned method on a dataset, or export what was trained.

    A run is a folder; `pliant predict RUN` and `pliant match RUN` answer with it afterwards.
    """


def _run_options(function: F) -> F:
    """Add the options that every method's command has."""
    options = (
        data_option("Dataset folder, or a YAML file of pliant generate: frames are simulated."),
        out_option("RUN", "Folder of the run."),
        path_option(
            "--config", "FILE", "YAML file of settings; omitted settings keep their default."
        ),
        set_option("optimiser.learning_rate=1e-3"),
        click.option("--resume", is_flag=True, help="Continue from the run's newest checkpoint."),
        json_option,
    )
    for option in reversed(options):
        function = option(function)
    return function


@command.command("don")
@_run_options
def don(data: Path, out: Path, **given: Any) -> None:
    """Train a Dense Object Net: a descriptor for every pixel.

    Without --config, uses the shipped recipe for the tier's kind. The time left follows from the
    measured rate; in a log, a line is written every 30 s.
    Several processes: `torchrun --nproc-per-node N --no-python pliant train don …`.
    --resume without settings continues with the settings of the run.
    """
    from pliant.models.don.settings import DonSettings
    from pliant.models.don.trainer import shipped_recipe, train_don
    from pliant.spec.configuration import read_settings

    def recipe(dataset: Dataset) -> Path:
        tier = read_settings(DonSettings, None, given["overrides"]).tier
        return shipped_recipe(dataset, tier)

    _train(DonSettings, train_don, recipe, _don_figures, data=data, out=out, **given)


@command.command("timecycle")
@_run_options
def timecycle(data: Path, out: Path, **given: Any) -> None:
    """Train TimeCycle: descriptors from episodes without labels.

    Several processes: `torchrun --nproc-per-node N --no-python pliant train timecycle …`.
    --resume without settings continues with the settings of the run.
    """
    from pliant.models.timecycle.settings import TimeCycleSettings
    from pliant.models.timecycle.trainer import train_timecycle

    _train(
        TimeCycleSettings, train_timecycle, lambda dataset: None, _timecycle_figures,
        data=data, out=out, **given,
    )  # fmt: skip


@command.command("model")
@click.argument("recipe")
@out_option("DIR", "Folder for the data, the stages and the finished model.")
@set_option("optimiser.learning_rate=1e-3")
@click.option(
    "--sequences",
    type=click.IntRange(2),
    metavar="N",
    help="Maximum number of sequences per split.",
)
@click.option(
    "--workers", type=click.IntRange(1), metavar="N", help="Worker processes that generate data."
)
def model(
    recipe: str, out: Path, overrides: tuple[str, ...], sequences: int | None, workers: int | None
) -> None:
    """Train the stages of RECIPE from scratch and export the model.

    The data are generated first. RECIPE is the name of a shipped model, such as don-rope, or a
    YAML file. --set applies to all stages. Run the same command again to continue after
    an interruption.
    """
    from pliant.generator.config import GenerateConfig
    from pliant.generator.runner.run import generate
    from pliant.models.model_recipe import make_model
    from pliant.models.recipe_file import RECIPES, read_recipe
    from pliant.spec.configuration import settings_from
    from pliant.spec.constraints import did_you_mean
    from pliant.spec.cores import cpu_cores
    from pliant.spec.errors import CallError

    shipped = {path.stem: path for path in sorted(RECIPES.glob("*.yaml"))}
    path = shipped.get(recipe, Path(recipe))
    if not path.exists():
        raise CallError(
            "no such recipe",
            found=recipe,
            required=f"one of {', '.join(shipped)}, or a YAML file",
            fix=did_you_mean(recipe, shipped),
        )
    chosen = read_recipe(path, overrides, sequences)
    for name, config in chosen.sets.items():  # before the first one is generated
        settings_from(GenerateConfig, config, f"sets.{name}", path=path)
    count = workers or cpu_cores()

    def made_set(config: Mapping[str, Any], folder: Path) -> None:
        with progress_bar(f"Generating {folder.name}", "images") as bar:
            show = GenerationDisplay(bar, folder, count)
            settings = settings_from(GenerateConfig, config)
            generate(settings, folder, workers=count, progress=show)

    @contextmanager
    def watched(stage: str, steps: int) -> Iterator[_Progress]:
        with progress_bar(f"Training {stage}", "steps") as bar:
            yield _Progress(bar, steps)

    with terminated_like_interrupted("Interrupted: run the same command again to continue."):
        made = make_model(chosen, out, made_set, watched=watched)
    echo(f"Model: {made}")


def _train(
    settings: type[Any],
    train: Callable[..., dict[str, Any]],
    recipe: Callable[[Dataset], Path | None],
    show_figures: Callable[[Mapping[str, Any]], None],
    **given: Any,
) -> None:
    """Train with a bar, then print what came of it.

    Args:
        settings: The method's class of settings.
        train: Its trainer.
        recipe: Returns the settings file of a new run on a dataset without --config, or None for
            the defaults.
        show_figures: Prints the figures of a finished run.
        **given: Values of the options of `_run_options`.
    """
    from pliant.api import load
    from pliant.models.training.checkpoint import latest_checkpoint
    from pliant.models.training.run_folder import CONFIG, begun_settings
    from pliant.spec.configuration import read_settings

    data, out, resume = given["data"], given["out"], given["resume"]
    dataset = load(data)
    if resume:
        begun_settings(out, settings)  # before a setting of another run is asked for
    config = given["config"] or (out / CONFIG if resume else recipe(dataset))
    chosen = read_settings(settings, config, given["overrides"])
    first = os.environ.get("RANK", "0") == "0"
    try:
        with (
            terminated_like_interrupted(""),
            progress_bar("Training", "steps", hidden=not first) as bar,
        ):
            progress = _Progress(bar, chosen.steps)
            facts = train(dataset, out, chosen, resume=resume, progress=progress)
    except KeyboardInterrupt:
        if first and latest_checkpoint(out) is not None:
            echo(f"Interrupted: continue with {to_call('--resume', '--out', out)}", err=True)
        raise
    if not first:
        return
    if given["as_json"]:
        echo_json({"run": str(out), **facts}, sort_keys=True)
        return
    show_figures(facts)
    echo(f"Report: {out / 'report.html'}")
    asked = data if dataset.splits_with_queries() else "DATA"
    call = to_call(
        "pliant", "predict", out, "--data", asked, "--split", "test", "--out", "SUB.parquet"
    )
    echo(f"Answer with it: {call}")


def _don_figures(facts: Mapping[str, Any]) -> None:
    figures = facts.get("validation", {})
    rmse, mean, median = (
        figures.get(name, float("nan"))
        for name in ("rmse_px", "rmse_px_mean_over_pairs", "median_px")
    )
    echo(
        f"{facts['steps']} steps; validation RMSE {rmse:.1f} px pooled, {mean:.1f} px mean over "
        f"pairs, median {median:.1f} px"
    )
    if "network_rmse_px" in figures:
        echo(
            f"The network alone, without the traces of the masks: RMSE "
            f"{figures['network_rmse_px']:.1f} px pooled, median "
            f"{figures['network_median_px']:.1f} px"
        )


def _timecycle_figures(facts: Mapping[str, Any]) -> None:
    guard = facts.get("guard", {})
    for method, errors in guard.get("rmse_px_of_640", {}).items():
        listed = ", ".join(f"{value:.1f} after {frames}" for frames, value in errors.items())
        echo(f"{method:10} RMSE, px of 640, by frames since the query: {listed}")
    echo(guard.get("verdict", "The run has not been validated."))


class _Progress:
    """Shows the steps done, and the newest loss and validation error."""

    def __init__(self, bar: Bar, steps: int) -> None:
        self._bar, self._steps = bar, steps
        self._latest: dict[str, float] = {}

    def __call__(self, step: int, figures: Mapping[str, float]) -> None:
        self._latest.update(figures)
        texts = []
        if "loss" in self._latest:
            texts.append(f"loss {self._latest['loss']:.3f}")
        if "val/rmse_px" in self._latest:
            texts.append(f"val RMSE {self._latest['val/rmse_px']:.1f} px")
        if step == self._steps:
            texts.append("measuring the trained network")
        self._bar(step, self._steps, facts=", ".join(texts))


@command.command("export")
@click.argument("run", type=PATH)
@click.option("--name", required=True, help="Name of the model, such as don-rope.")
@data_option("Dataset that it was trained on, or the YAML file.")
@out_option("FOLDER", "Output folder; writes OUT/NAME.")
@path_option(
    "--scores",
    "REPORT",
    "A report of `pliant evaluate` for the card; may be given several times.",
    multiple=True,
)
@json_option
def export(
    run: Path, name: str, data: Path, out: Path, scores: tuple[Path, ...], as_json: bool
) -> None:
    """Export a finished run as a model with its model card.

    The folder can be used like the run: `pliant predict OUT/NAME`. A model in `models/shipped/`
    of the package is used by its name.
    """
    from pliant.api import load
    from pliant.evaluator.scores import SCORES_JSON, read_scores
    from pliant.models.export import export_run

    reports = [read_scores(path.parent if path.name == SCORES_JSON else path) for path in scores]
    folder = export_run(run, name, out, load(data), reports)
    size = sum(path.stat().st_size for path in folder.iterdir())
    text = f"{folder}: {size / 1e6:.1f} MB; read {folder / 'CARD.md'}"
    echo_result({"model": str(folder), "name": name, "bytes": size}, text, as_json=as_json)
