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
from typing import Any, Final, Literal, Self

from pydantic import model_validator

from pliant.models.don.ball_training import PICTURES, fit_ball
from pliant.models.don.loading import load_masks
from pliant.models.don.mask_training import SAMPLINGS, fit_masks
from pliant.models.don.settings import DonSettings, FurtherSet
from pliant.models.don.trainer import DonTask, train_don, training_data
from pliant.models.export import RECIPE, export_run, portable
from pliant.models.networks.mask_network import MASKS
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
    Settings,
    merged,
    read_mapping,
    read_settings,
    settings_from,
    settings_to_dict,
    with_overrides,
)
from pliant.spec.constraints import Count, Refused, Share
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, TrainingError
from pliant.spec.frame import Frame
from pliant.spec.io.yamlfiles import yaml_text

Watched = Callable[[str, int], AbstractContextManager[StepProgress | None]]

_MOST_SHOWN: Final = 3  # draws per picture in the training for balls, on average

RECIPES: Final = Path(__file__).parent / "configs" / "models"


class Stage(Settings):
    """A run on the way to a model.

    Attributes:
        sets: Names of the sets it trains on, its own first.
        start: The stage whose weights it begins with; empty for random weights.
        mean_of: Two stages of which it is the mean; it has the settings of the last one, where its
            own do not differ.
        shares: What is tried as the last one's share.
        settings: Settings of the run that differ from those of all stages.
    """

    sets: tuple[str, ...]
    start: str = ""
    mean_of: tuple[str, ...] = ()
    shares: tuple[Share, ...] = (0.0, 0.3, 0.5, 0.7, 1.0)
    settings: Mapping[str, Any] = {}

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.sets:
            raise Refused("at least one set", "sets")
        if len(self.mean_of) not in (0, 2):
            raise Refused("two stages", "mean_of")
        return self


class MaskStage(Settings):
    """The training of a network that finds masks, and of one that finds the ball of ropes.

    See `mask_training.py` and `ball_training.py`.

    Attributes:
        sets: Names of the sets whose training splits it sees.
        steps: Steps.
        of: What it finds.
        later: Steps of each cycle with pictures in other light and without colour.
        later_sets: Names of sets that only these cycles see.
        widen: Double the network's channels for the last cycle.
        ball_sets: Names of sets that only the network for the ball sees, next to `sets`.
    """

    sets: tuple[str, ...]
    steps: Count
    of: Literal["rope", "cloth"]
    later: tuple[Count, ...] = ()
    later_sets: tuple[str, ...] = ()
    widen: bool = False
    ball_sets: tuple[str, ...] = ()


class ModelRecipe(Settings):
    """How a model is made.

    Attributes:
        name: The model.
        sets: Name -> `pliant generate` config of a dataset; all of its tiers are trained on.
        settings: Settings of the runs of all stages.
        stages: Name -> stage, in order; the last one is the model.
        masks: How the networks that find masks and balls are trained, for a model with them.
    """

    name: str
    sets: Mapping[str, Mapping[str, Any]]
    settings: Mapping[str, Any]
    stages: Mapping[str, Stage]
    masks: MaskStage | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.stages:
            raise Refused("at least one stage", "stages")
        if self.masks is not None and not self.masks.sets:
            raise Refused("at least one set", "masks.sets")
        return self


def read_recipe(
    path: Path, overrides: Sequence[str] = (), sequences: int | None = None
) -> ModelRecipe:
    """Read a recipe.

    Args:
        path: The file.
        overrides: `dotted.key=value` texts that change the runs of all stages; `steps` also that
            of the network that finds masks.
        sequences: Sequences of every split at most, for a trial.

    Raises:
        CallError: It cannot be read, or something in it is unknown or impossible.
    """
    values = read_mapping(path)
    common = values.pop("common", None) or {}
    for name, own in _mappings(values, "sets"):
        labels = {"id": f"{values.get('name')}-{name}", "title": f"{values.get('name')}: {name}"}
        made: dict[str, Any] = merged({**labels, **common}, own)
        splits = made.get("splits")
        if sequences is not None and isinstance(splits, dict):
            made["splits"] = {split: min(sequences, count) for split, count in splits.items()}
        values["sets"][name] = made
    for _, stage in _mappings(values, "stages"):
        given = stage.get("settings") or {}
        if isinstance(given, dict):
            stage["settings"] = with_overrides(given, overrides)
    changed = with_overrides({}, overrides)
    if "steps" in changed and isinstance(masks := values.get("masks"), dict):
        values["masks"] = {**masks, "steps": changed["steps"]}
        if isinstance(later := masks.get("later"), list):
            values["masks"]["later"] = [changed["steps"] for _ in later]
    recipe = settings_from(ModelRecipe, values, path=path)
    for name, config in recipe.sets.items():
        tiers = config.get("tiers")
        if not isinstance(tiers, list) or not tiers:
            where = f"sets.{name}.tiers"
            raise CallError("a set has a list of tiers", path=path, where=where, found=tiers)
    earlier: set[str] = set()
    for name, each in recipe.stages.items():
        _check_known({each.start, *each.mean_of} - {""}, earlier, path, f"stages.{name}")
        _check_known(set(each.sets), set(recipe.sets), path, f"stages.{name}.sets")
        values = merged(recipe.settings, each.settings)
        settings_from(DonSettings, values, path=path, overrides=overrides)
        if decided := sorted({"tier", "also", "cache_dir"} & set(values)):
            raise CallError(
                "a recipe sets this itself, by the sets of the stage and --out",
                path=path,
                where=f"stages.{name}, {decided[0]}",
                found=values[decided[0]],
                fix="Leave it out.",
            )
        earlier.add(name)
    if recipe.masks is not None:
        for key in ("sets", "later_sets", "ball_sets"):
            _check_known(set(getattr(recipe.masks, key)), set(recipe.sets), path, f"masks.{key}")
    return recipe


def _mappings(values: Mapping[str, Any], section: str) -> list[tuple[str, dict[str, Any]]]:
    """Return the mappings of a section; anything else is refused by the settings."""
    found = values.get(section)
    entries = found.items() if isinstance(found, dict) else ()
    return [(key, each) for key, each in entries if isinstance(each, dict)]


def _check_known(named: set[str], known: set[str], path: Path, where: str) -> None:
    if unknown := sorted(named - known):
        required = "one of " + ", ".join(sorted(known)) if known else "nothing: it is the first"
        raise CallError("unknown name", path=path, where=where, found=unknown[0], required=required)


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
