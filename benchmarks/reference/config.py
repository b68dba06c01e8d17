"""What a reference benchmark is made of: its sets, its trainings, its tests, from one YAML file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from importlib.resources import files
from pathlib import Path
from typing import Any

from pliant.baselines import METHODS
from pliant.generator.config import GenerateConfig
from pliant.models.shipped import shipped_names
from pliant.spec.errors import CallError
from pliant.spec.yamlfiles import parse_yaml, read_yaml

TRAINERS = ("don", "timecycle")


@dataclass(frozen=True)
class Training:
    """One run of a trainer.

    Attributes:
        trainer: `don` or `timecycle`.
        label: The method's name in the table.
        set: Set it is trained on.
        settings: The trainer's settings, complete but for defaults.
        after: Run whose finished weights it starts from, or empty.
    """

    trainer: str
    label: str
    set: str
    settings: Mapping[str, Any]
    after: str = ""

    @property
    def input(self) -> str:
        """What the network sees: `rgb`, `depth` or `rgbd`."""
        return str(self.settings.get("pairs", {}).get("input", "rgb"))


@dataclass(frozen=True)
class Test:
    """One block of the table: a tier's test queries, what answers them, what the paper found.

    Attributes:
        tier: The tier.
        title: Heading of the block.
        variants: Name of the variant (`clean`, `noisy` …) -> set whose test split is asked.
        methods: Methods without training, keys of `pliant.baselines.METHODS`.
        runs: Names of trainings.
        shipped: Names of models that come with the package: the whole recipes, trained once.
        protocols: Protocols to score by, the table's first.
        paper_rmse_px: Label of a method -> RMSE in the paper.
    """

    __test__ = False

    tier: str
    title: str
    variants: Mapping[str, str]
    methods: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    shipped: tuple[str, ...] = ()
    protocols: tuple[str, ...] = ("standard", "paper")
    paper_rmse_px: Mapping[str, float] = field(default_factory=dict)

    @property
    def answering(self) -> tuple[str, ...]:
        """Everything that answers, in the table's order."""
        return (*self.methods, *self.runs, *self.shipped)


@dataclass(frozen=True)
class Comparison:
    """A paired difference that the page reports.

    Attributes:
        question: What it answers.
        set: Set whose test split both answered.
        method: The method judged.
        against: The method it is held against.
        metric: A metric of the block's first protocol.
    """

    question: str
    set: str
    method: str
    against: str
    metric: str


@dataclass(frozen=True)
class BenchmarkConfig:
    """A named, frozen benchmark.

    Attributes:
        name: Its name.
        version: Its version; what changes a query changes it.
        sets: Name -> config of a dataset.
        runs: Name -> training.
        tests: Name -> block of the table.
        comparisons: Paired differences to report.
        checksums: File of the test queries' checksums, or None.
        path: Where it was read from.
    """

    name: str
    version: str
    sets: Mapping[str, GenerateConfig]
    runs: Mapping[str, Training]
    tests: Mapping[str, Test]
    comparisons: tuple[Comparison, ...]
    checksums: Path | None
    path: Path


def read_config(path: Path) -> BenchmarkConfig:
    """Read a benchmark's YAML file.

    Args:
        path: The file.

    Raises:
        CallError: It cannot be read, or something in it is unknown, missing or impossible.
    """
    document = read_yaml(path)
    top = _checked(
        document,
        path,
        "",
        {"name", "version", "sets"},
        {"common", "runs", "tests", "comparisons", "checksums"},
    )
    name, version = str(top["name"]), str(top["version"])
    sets = {
        key: _set(name, version, key, top.get("common") or {}, values, path)
        for key, values in _mapping(top["sets"], path, "sets").items()
    }
    runs = {
        key: _training(key, values, path)
        for key, values in _mapping(top.get("runs") or {}, path, "runs").items()
    }
    tests = {
        key: _test(key, values, path)
        for key, values in _mapping(top.get("tests") or {}, path, "tests").items()
    }
    comparisons = tuple(
        Comparison(**_checked(each, path, f"comparisons.{index}", _names(Comparison), set()))
        for index, each in enumerate(top.get("comparisons") or [])
    )
    checksums = path.parent / str(top["checksums"]) if top.get("checksums") else None
    config = BenchmarkConfig(name, version, sets, runs, tests, comparisons, checksums, path)
    _check_references(config)
    return config


def digest(*parts: Any) -> str:
    """Return a SHA-256 of JSON values, the same for the same values."""
    text = json.dumps(parts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _set(name: str, version: str, key: str, common: Any, values: Any, path: Path) -> GenerateConfig:
    where = f"sets.{key}"
    labels = {"id": f"{name}-{key}", "version": version, "title": f"{name}: {key}"}
    merged = {
        **labels,
        **_mapping(common, path, "common"),
        **_mapping(values, path, where),
    }
    try:
        return GenerateConfig.from_dict(merged)
    except CallError as error:
        raise CallError(f"{error}", path=path, where=where) from error


def _training(key: str, values: Any, path: Path) -> Training:
    where = f"runs.{key}"
    given = _checked(
        values, path, where, {"set", "label"}, {"trainer", "recipe", "settings", "after"}
    )
    trainer = str(given.get("trainer", "don"))
    if trainer not in TRAINERS:
        raise CallError(
            "unknown trainer", path=path, where=f"{where}.trainer", found=trainer,
            required=" or ".join(TRAINERS),
        )  # fmt: skip
    settings = _recipe(str(given["recipe"]), path, f"{where}.recipe") if "recipe" in given else {}
    settings = _merged(settings, _mapping(given.get("settings") or {}, path, f"{where}.settings"))
    return Training(
        trainer, str(given["label"]), str(given["set"]), settings, str(given.get("after", ""))
    )


def _recipe(name: str, path: Path, where: str) -> dict[str, Any]:
    """Return the values of a recipe that is shipped with the trainers."""
    folder = files("pliant.models") / "configs"
    shipped = sorted(each.name for each in folder.iterdir() if each.name.endswith(".yaml"))
    if name not in shipped:
        raise CallError(
            "unknown recipe", path=path, where=where, found=name,
            required="one of " + ", ".join(shipped),
        )  # fmt: skip
    text = (folder / name).read_text(encoding="utf-8")
    return _mapping(parse_yaml(text, name), path, where)


def _test(key: str, values: Any, path: Path) -> Test:
    required = {"tier", "title", "variants"}
    given = dict(_checked(values, path, f"tests.{key}", required, _names(Test) - required))
    for name in ("methods", "runs", "shipped", "protocols"):
        if name in given:
            given[name] = tuple(given[name])
    return Test(**given)


def _check_references(config: BenchmarkConfig) -> None:
    def known(name: str, names: Mapping[str, Any], where: str) -> None:
        if name not in names:
            raise CallError(
                "unknown name", path=config.path, where=where, found=name,
                required="one of " + ", ".join(names),
            )  # fmt: skip

    for key, run in config.runs.items():
        known(run.set, config.sets, f"runs.{key}.set")
        if run.after:
            earlier = list(config.runs)[: list(config.runs).index(key)]
            known(run.after, dict.fromkeys(earlier), f"runs.{key}.after")
    for key, test in config.tests.items():
        for variant, name in test.variants.items():
            known(name, config.sets, f"tests.{key}.variants.{variant}")
        for name in test.runs:
            known(name, config.runs, f"tests.{key}.runs")
        for name in test.methods:
            known(name, dict.fromkeys(METHODS), f"tests.{key}.methods")
        for name in test.shipped:
            known(name, dict.fromkeys(shipped_names()), f"tests.{key}.shipped")
        for name in test.paper_rmse_px:
            answers = dict.fromkeys(test.answering)
            known(name, answers, f"tests.{key}.paper_rmse_px")
    for index, each in enumerate(config.comparisons):
        where = f"comparisons.{index}"
        known(each.set, config.sets, f"{where}.set")
        asked = [test for test in config.tests.values() if each.set in test.variants.values()]
        answers = {name: 0 for test in asked for name in test.answering}
        known(each.method, answers, f"{where}.method")
        known(each.against, answers, f"{where}.against")


def _names(cls: type[Any]) -> set[str]:
    return {each.name for each in fields(cls)}


def _checked(
    values: Any, path: Path, where: str, required: set[str], optional: set[str]
) -> dict[str, Any]:
    mapping = _mapping(values, path, where)
    for name in mapping:
        if name not in required | optional:
            raise CallError(
                "unknown setting", path=path, where=f"{where}.{name}".strip("."),
                required="one of " + ", ".join(sorted(required | optional)),
            )  # fmt: skip
    for name in sorted(required):
        if name not in mapping:
            raise CallError("a setting is missing", path=path, where=f"{where}.{name}".strip("."))
    return mapping


def _mapping(values: Any, path: Path, where: str) -> dict[str, Any]:
    if not isinstance(values, dict):
        raise CallError(
            "a mapping is required", path=path, where=where or None, found=repr(values)[:80]
        )
    return values


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        inner = merged.get(key)
        if isinstance(value, Mapping) and isinstance(inner, Mapping):
            value = _merged(inner, value)
        merged[key] = value
    return merged
