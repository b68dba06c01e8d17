"""Reads the recipe of a model: its sets, its stages, and the small networks that come with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import model_validator

from pliant.models.don.settings import DonSettings
from pliant.spec.configuration import (
    Settings,
    merged,
    read_mapping,
    settings_from,
    with_overrides,
)
from pliant.spec.constraints import Count, Refused, Share
from pliant.spec.errors import CallError

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


class PrintStage(Settings):
    """The training of a network that matches the prints of cloths, see `print_training.py`.

    Attributes:
        sets: Names of the sets of blank cloths whose training splits it sees.
        steps: Steps.
    """

    sets: tuple[str, ...]
    steps: Count


class ModelRecipe(Settings):
    """How a model is made.

    Attributes:
        name: The model.
        sets: Name -> `pliant generate` config of a dataset; all of its tiers are trained on.
        settings: Settings of the runs of all stages.
        stages: Name -> stage, in order; the last one is the model.
        masks: How the networks that find masks and balls are trained, for a model with them.
        prints: How the network that matches prints is trained, for a model with one.
    """

    name: str
    sets: Mapping[str, Mapping[str, Any]]
    settings: Mapping[str, Any]
    stages: Mapping[str, Stage]
    masks: MaskStage | None = None
    prints: PrintStage | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.stages:
            raise Refused("at least one stage", "stages")
        for name in ("masks", "prints"):
            if (stage := getattr(self, name)) is not None and not stage.sets:
                raise Refused("at least one set", f"{name}.sets")
        return self


def read_recipe(
    path: Path, overrides: Sequence[str] = (), sequences: int | None = None
) -> ModelRecipe:
    """Read a recipe.

    Args:
        path: The file.
        overrides: `dotted.key=value` texts that change the runs of all stages; `steps` also those
            of the networks that find masks and match prints.
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
    if "steps" in (changed := with_overrides({}, overrides)):
        for each in (values.get("masks"), values.get("prints")):
            if isinstance(each, dict):
                each["steps"] = changed["steps"]
                if isinstance(later := each.get("later"), list):
                    each["later"] = [changed["steps"] for _ in later]
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
    if recipe.prints is not None:
        _check_known(set(recipe.prints.sets), set(recipe.sets), path, "prints.sets")
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
