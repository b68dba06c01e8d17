"""Reads the YAML file of a reference benchmark."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from pliant.baselines import METHODS
from pliant.benchmarks.suite.config import (
    PAPER_LOSSES,
    BenchmarkConfig,
    Training,
    check_known,
    model_of,
    trainer_of,
)
from pliant.evaluator.protocols.protocol import PROTOCOL_NAMES
from pliant.models.shipped import shipped_names
from pliant.spec.configuration import merged, read_mapping, settings_from, with_overrides
from pliant.spec.errors import CallError
from pliant.spec.extras import is_installed
from pliant.spec.io.yamlfiles import parse_yaml

RECIPES: Final = files("pliant.models") / "configs"
"""The settings of trainings that are shipped with the trainers."""


def read_config(path: Path, overrides: Sequence[str] = ()) -> BenchmarkConfig:
    """Read a benchmark's YAML file.

    Args:
        path: The file.
        overrides: `dotted.key=value` texts, such as `sets.rope.frames=3`.

    Raises:
        CallError: It cannot be read, or something in it is unknown, missing or impossible.
    """
    values = with_overrides(read_mapping(path), overrides)
    name, version, common = (values.get(key) for key in ("name", "version", "common"))
    for key, own in _mappings(values, "sets"):
        labels = {"id": f"{name}-{key}", "version": version, "title": f"{name}: {key}"}
        values["sets"][key] = {**labels, **(common or {}), **own}
    for key, run in _mappings(values, "runs"):
        recipe = _recipe(run["recipe"], path, f"runs.{key}.recipe") if "recipe" in run else {}
        values["runs"][key] = {**run, "settings": merged(recipe, run.get("settings") or {})}
    config = settings_from(BenchmarkConfig, values, path=path, overrides=overrides)
    if config.checksums is not None:
        config = config.replace(checksums=path.parent / config.checksums)
    _check_references(config, path)
    return _with_seeds(config)


def _with_seeds(config: BenchmarkConfig) -> BenchmarkConfig:
    """Return the config with a run for every random seed, also in the tests."""
    runs: dict[str, Training] = {}
    for key, run in config.runs.items():
        first = int(run.settings.get("seed", 0))
        for index in range(run.seeds):
            one = run.replace(settings={**run.settings, "seed": first + index}, seeds=1, arm=key)
            runs |= {f"{key}-{index}": one} if run.seeds > 1 else {key: run}
    expanded = config.replace(runs=runs)
    tests = {
        key: test.replace(runs=tuple(one for name in test.runs for one in expanded.members(name)))
        for key, test in config.tests.items()
    }
    return expanded.replace(tests=tests)


def _mappings(values: dict[str, Any], section: str) -> list[tuple[str, dict[str, Any]]]:
    """Return the mappings of a section, which is copied; anything else is refused later."""
    if not isinstance(values.get(section), dict):
        return []
    values[section] = dict(values[section])
    return [(key, each) for key, each in values[section].items() if isinstance(each, dict)]


def _recipe(name: str, path: Path, where: str) -> dict[str, Any]:
    shipped = sorted(each.name for each in RECIPES.iterdir() if each.name.endswith(".yaml"))
    check_known(name, shipped, path, where)
    values: dict[str, Any] = parse_yaml((RECIPES / name).read_text(encoding="utf-8"), name)
    return values


def _check_references(config: BenchmarkConfig, path: Path) -> None:
    def known(name: str, names: Collection[str], where: str) -> None:
        check_known(name, names, path, where)

    for key, run in config.runs.items():
        known(run.set, config.sets, f"runs.{key}.set")
        if is_installed("torch"):  # sets can be made without
            where = f"runs.{key}.settings"
            settings_from(trainer_of(run.trainer)[0], run.settings, where, path=path)
    for key, test in config.tests.items():
        for variant, name in test.variants.items():
            known(name, config.sets, f"tests.{key}.variants.{variant}")
            if name not in config.asked:
                raise CallError("the set has no test split", path=path, where=f"sets.{name}.splits")
            known(test.tier, config.sets[name].tiers, f"tests.{key}.tier")
        for name in test.runs:
            known(name, config.runs, f"tests.{key}.runs")
        for name in test.methods:
            known(name, METHODS, f"tests.{key}.methods")
        for name in test.shipped:
            known(model_of(name), shipped_names(), f"tests.{key}.shipped")
        if test.answer and is_installed("torch"):
            from pliant.models.don.settings import AnswerSettings

            settings_from(AnswerSettings, test.answer, f"tests.{key}.answer", path=path)
        for name in test.protocols:
            known(name, PROTOCOL_NAMES, f"tests.{key}.protocols")
        for name in test.figures:
            known(name, test.shown, f"tests.{key}.figures")
        for name in test.paper_rmse_px:
            known(name, (*METHODS, *test.shipped, *PAPER_LOSSES), f"tests.{key}.paper_rmse_px")
    for index, each in enumerate(config.comparisons):
        where = f"comparisons.{index}"
        known(each.set, config.sets, f"{where}.set")
        asked = [test for test in config.tests.values() if each.set in test.variants.values()]
        answers = [name for test in asked for name in test.answering]
        known(each.method, answers, f"{where}.method")
        known(each.against, answers, f"{where}.against")
        known(each.metric, asked[0].shown, f"{where}.metric")
