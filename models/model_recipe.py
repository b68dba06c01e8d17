"""Trains a shipped model from scratch: data, training stages, averaging of weights, export.

A recipe is one YAML file (`models/configs/models/`). Everything is made in one folder: sets are
generated into `sets/`, every stage is a run in `stages/`, and the model is exported to `models/`.
A stage trains, from the weights of an earlier stage if it names one. Or it is the mean of two
stages' weights, parameter by parameter, with the shares that are best on the validation split.
Every stage ends with a calibration on the validation pairs of all its sets.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, Final

from pliant.loaders.frame_store import FrameStore
from pliant.models.don.ball_training import PICTURES, fit_ball
from pliant.models.don.loading import load_masks
from pliant.models.don.mask_training import SAMPLINGS, fit_masks
from pliant.models.don.print_training import fit_prints
from pliant.models.don.settings import DonSettings, FurtherSet
from pliant.models.don.trainer import DonTask, train_don, training_data
from pliant.models.export import RECIPE, export_run, portable
from pliant.models.networks.mask_network import MASKS
from pliant.models.networks.print_network import PRINTS
from pliant.models.recipe_file import MaskStage, ModelRecipe, PrintStage, Stage
from pliant.models.training.checkpoint import (
    BEST,
    Weights,
    latest_checkpoint,
    read_progress,
    read_weights_file,
    save_weights,
)
from pliant.models.training.loop import StepProgress
from pliant.models.training.processes import joined_processes
from pliant.models.training.run_folder import (
    BALL,
    CONFIG,
    RUN_FACTS,
    check_same_settings,
    data_digest,
    read_run_json,
    write_settings,
)
from pliant.spec.configuration import (
    merged,
    read_settings,
    settings_from,
    settings_to_dict,
)
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, TrainingError
from pliant.spec.frame import Frame
from pliant.spec.io.yamlfiles import yaml_text

Watched = Callable[[str, int], AbstractContextManager[StepProgress | None]]

_MOST_SHOWN: Final = 3  # draws per picture in the training for balls, on average


def make_model(
    recipe: ModelRecipe,
    out: Path,
    generate: Callable[[Mapping[str, Any], Path], object],
    watched: Watched = lambda stage, steps: nullcontext(),
) -> Path:
    """Make a model, or continue; finished stages are skipped.

    Args:
        recipe: How.
        out: The folder of sets, stages and the model.
        generate: Makes a dataset in a folder, or resumes it.
        watched: Name and number of steps of a stage -> what is called after each of them, while
            the stage is trained.

    Returns:
        The exported model's folder.

    Raises:
        TrainingError: A stage was begun with other settings or data.
    """
    for name, config in recipe.sets.items():
        generate(config, out / "sets" / name)
    for name, stage in recipe.stages.items():
        run = out / "stages" / name
        settings = _settings(recipe, stage, out)
        dataset = Dataset.open(out / "sets" / stage.sets[0])
        if facts := read_run_json(run / RUN_FACTS):
            _check_finished(run, stage, settings, dataset, facts)
            continue
        if stage.mean_of:
            _average(recipe, stage, out, run, settings)
        else:
            begun = latest_checkpoint(run) is not None
            with watched(name, settings.steps) as progress:
                train_don(dataset, run, settings, resume=begun, progress=progress)
    last = list(recipe.stages)[-1]
    if recipe.masks is not None:
        _train_masks(recipe.masks, out, out / "stages" / last, watched)
    if recipe.prints is not None and not (out / "stages" / last / PRINTS).is_file():
        _train_prints(recipe, recipe.prints, out, watched)
    text = yaml_text(settings_to_dict(recipe))
    (out / "stages" / last / RECIPE).write_text(text, encoding="utf-8")
    dataset = Dataset.open(out / "sets" / recipe.stages[last].sets[0])
    return export_run(out / "stages" / last, recipe.name, out / "models", dataset, replace=True)


def _check_finished(
    run: Path, stage: Stage, settings: DonSettings, dataset: Dataset, facts: Mapping[str, Any]
) -> None:
    """Refuse a finished stage that the recipe now describes otherwise."""
    fix = "Remove the folders of this stage and of those after it, or name another --out."
    if stage.mean_of != (mean_of := tuple(facts.get("mean_of", ()))):
        raise TrainingError(
            "the finished stage is the mean of others",
            path=run / RUN_FACTS,
            where="mean_of",
            found=mean_of,
            required=stage.mean_of,
            fix=fix,
        )
    begun = _portable(read_settings(DonSettings, run / CONFIG))
    check_same_settings(run, begun, _portable(settings), fix=fix)
    data = data_digest([of for of, _ in training_data(dataset, settings)])
    if read_progress(run).get("data", data) != data:  # a mean has no checkpoint
        raise TrainingError(
            "the stage was trained on other sequences than its sets have now", path=run, fix=fix
        )


def _portable(settings: DonSettings) -> dict[str, Any]:
    """Return settings as they are in any folder of sets and stages."""
    further = [Path(each.data).name for each in settings.further if each.data]
    return portable(settings_to_dict(settings), further)


def _train_masks(stage: MaskStage, out: Path, run: Path, watched: Watched) -> None:
    """Train what finds masks, and the ball of a rope, where the run does not have it yet."""

    def frames(names: Sequence[str]) -> list[Sequence[Frame]]:
        return [Dataset.open(out / "sets" / name).frames("train") for name in names]

    seed = read_settings(DonSettings, run / CONFIG).seed
    if not (run / MASKS).is_file():
        with watched("masks", stage.steps + sum(stage.later)) as progress:
            network = fit_masks(
                frames(stage.sets),
                steps=stage.steps,
                later=stage.later,
                later_sets=frames(stage.later_sets),
                widen=stage.widen,
                seed=seed,
                sampling=SAMPLINGS[stage.of],
                progress=progress,
            )
        save_weights(run / MASKS, network.state_dict())
    if stage.of == "rope" and not (run / BALL).is_file():
        masks, sets = load_masks(run / MASKS), frames((*stage.sets, *stage.ball_sets))
        pictures = min(PICTURES, _MOST_SHOWN * sum(map(len, sets)))
        with watched("ball", pictures) as progress:
            ball = fit_ball(masks, sets, pictures=pictures, seed=seed, progress=progress)
        if ball is not None:
            save_weights(run / BALL, ball.state_dict())


def _train_prints(recipe: ModelRecipe, stage: PrintStage, out: Path, watched: Watched) -> None:
    """Train what matches prints, at the size of the model's pictures."""
    run = out / "stages" / list(recipe.stages)[-1]
    settings = read_settings(DonSettings, run / CONFIG)
    size = settings.width, settings.height
    stores = [
        FrameStore(Dataset.open(out / "sets" / name), tier, "train", size)
        for name in stage.sets
        for tier in recipe.sets[name]["tiers"]
    ]
    with watched("prints", stage.steps) as progress:
        network = fit_prints(stores, steps=stage.steps, seed=settings.seed, progress=progress)
    save_weights(run / PRINTS, network.state_dict())


def _settings(recipe: ModelRecipe, stage: Stage, out: Path) -> DonSettings:
    parts = [(name, tier) for name in stage.sets for tier in recipe.sets[name]["tiers"]]
    (_, first), *more = parts
    own: dict[str, Any] = {
        "tier": first,
        "also": [str(FurtherSet(str(out / "sets" / name), tier)) for name, tier in more],
        "cache_dir": str(out / "cache"),
    }
    if stage.start:
        own["network"] = {"pretrained": str(out / "stages" / stage.start)}
    given = recipe.stages[stage.mean_of[-1]].settings if stage.mean_of else {}
    values = merged(merged(merged(recipe.settings, given), stage.settings), own)
    return settings_from(DonSettings, values)


def _average(
    recipe: ModelRecipe, stage: Stage, out: Path, run: Path, settings: DonSettings
) -> None:
    """Make a run of the mean of two runs' weights, with the best share on validation."""
    first, last = (out / "stages" / name for name in stage.mean_of)
    given, trained = (read_weights_file(each / BEST) for each in (first, last))
    if {k: v.shape for k, v in given.items()} != {k: v.shape for k, v in trained.items()}:
        raise CallError(
            "stages with different networks cannot be averaged",
            where="mean_of",
            found=", ".join(stage.mean_of),
            fix="Give both the same network, pairs and auxiliary losses.",
        )
    shutil.rmtree(run, ignore_errors=True)
    run.mkdir(parents=True)
    dataset = Dataset.open(out / "sets" / stage.sets[0])
    with joined_processes() as processes:
        task = DonTask(dataset, settings, run, processes)

        def error(share: float) -> float:
            task.network.load_state_dict(_mean(given, trained, share))
            task.network.eval()
            return task.validate()["criterion_px"]

        errors = {share: error(share) for share in stage.shares}
        share = min(errors, key=errors.__getitem__)
        mean = _mean(given, trained, share)
        task.network.load_state_dict(mean)
        save_weights(run / BEST, mean)
        write_settings(run, settings)
        facts = read_run_json(last / RUN_FACTS) | {
            "mean_of": list(stage.mean_of),
            "share_of_the_last": share,
            "validation_px_by_share": {str(key): value for key, value in errors.items()},
        }
        task.finish(run, read_progress(last).get("history", []), facts)


def _mean(first: Weights, last: Weights, share: float) -> Weights:
    """Return (1 - share) of the first and share of the last weights; integers are the last's."""
    return {
        name: first[name].lerp(tensor, share) if tensor.is_floating_point() else tensor
        for name, tensor in last.items()
    }
