"""Settings refuse what is wrong in one sentence per problem, and read back what they write."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

import pytest
from pydantic import ValidationError, model_validator

from pliant.cli.main import run
from pliant.spec.configuration import (
    Settings,
    SettingsError,
    read_settings,
    settings_from,
    settings_to_dict,
    with_overrides,
)
from pliant.spec.constraints import Bounds, Count, OneOf, Range, Refused, Weights
from pliant.spec.errors import CallError
from pliant.spec.io.yamlfiles import read_yaml, yaml_text


class LensSettings(Settings):
    """A lens.

    Attributes:
        focal_m: Distance of the sharp image
            behind the lens.
        turns_deg: Angles it turns by.
    """

    focal_m: Annotated[float, Bounds(0, 2, above=True)] = 0.05
    turns_deg: Annotated[Range, Bounds(-90, 90)] = (-10.0, 10.0)


class RigSettings(Settings):
    """A rig of cameras."""

    kind: Annotated[str, OneOf(("stereo", "single"))] = "single"
    cameras: Count = 1
    lens: LensSettings = LensSettings()
    spare: LensSettings | None = None
    colours: Annotated[Mapping[str, float], Weights(("red", "blue"))] = {"red": 1.0}

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.kind == "stereo" and self.cameras < 2:
            raise Refused(">= 2 for a stereo rig", "cameras", "Add --set cameras=2")
        return self


REFUSED = read_yaml(Path(__file__).with_name("settings_refused.yaml"))


@pytest.mark.parametrize("case", REFUSED, ids=lambda case: str(case["values"]))
def test_a_wrong_value_is_one_sentence(case: dict[str, Any]) -> None:
    values, sentence = case["values"], case["sentence"]
    with pytest.raises(SettingsError) as caught:
        settings_from(RigSettings, values)
    assert str(caught.value) == sentence
    assert caught.value.exit_code == 2


def test_every_problem_is_reported_with_its_source(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text("cameras: 0\nlens: {focl_m: 1}\n")
    with pytest.raises(SettingsError) as caught:
        read_settings(RigSettings, path, ["kind=sngle", "lense.focal_m=1"])
    problems = {each.where: each.path for each in caught.value.problems}
    assert problems == {
        "cameras": str(path), "lens.focl_m": str(path), "kind": "--set", "lense": "--set",
    }  # fmt: skip
    assert len(str(caught.value).splitlines()) == 4
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_values_from_a_constructor_and_from_replace_are_checked() -> None:
    with pytest.raises(SettingsError, match=r"^focal_m: .*; found -1; required: above 0 to 2 m$"):
        LensSettings(focal_m=-1)
    with pytest.raises(SettingsError, match=r"^cameras: .*required: >= 2 for a stereo rig"):
        RigSettings(kind="stereo")
    with pytest.raises(SettingsError, match=r"cameras: .*required: >= 1"):
        RigSettings().replace(cameras=0)
    changed = RigSettings(cameras=3).replace(lens={"focal_m": 1})
    assert (changed.cameras, changed.lens) == (3, LensSettings(focal_m=1.0))


def test_settings_are_frozen_hashable_and_can_be_pickled() -> None:
    lens = LensSettings(turns_deg=(1, 2))
    assert lens.turns_deg == (1.0, 2.0)
    assert isinstance(lens.turns_deg[0], float)
    assert hash(lens) == hash(LensSettings(turns_deg=(1.0, 2.0)))
    assert pickle.loads(pickle.dumps(lens)) == lens
    with pytest.raises(ValidationError, match="frozen"):
        lens.focal_m = 1.0


def test_yaml_to_settings_and_back_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    settings = RigSettings(
        kind="stereo", cameras=3, lens=LensSettings(focal_m=1e-3), spare=LensSettings()
    )
    path.write_text(yaml_text(settings_to_dict(settings)))
    assert read_settings(RigSettings, path) == settings
    assert read_yaml(path) == settings_to_dict(read_settings(RigSettings, path))


def test_set_changes_what_it_names_and_nothing_else() -> None:
    values = {"lens": {"focal_m": 1}, "spare": None}
    changed = with_overrides(values, ["lens.turns_deg=[1, 2]", "spare.focal_m=1e-3"])
    assert changed == {
        "lens": {"focal_m": 1, "turns_deg": [1, 2]}, "spare": {"focal_m": 0.001},
    }  # fmt: skip
    assert values == {"lens": {"focal_m": 1}, "spare": None}
    with pytest.raises(CallError, match=r"--set lens\.focal_m\.x: .*found lens\.focal_m = 1"):
        with_overrides(values, ["lens.focal_m.x=1"])
    for wrong in ("lens", "=3", "lens={"):
        with pytest.raises(CallError, match="--set"):
            with_overrides(values, [wrong])


def shipped() -> list[tuple[str, Path]]:
    root = Path(__file__).parents[2]
    benchmarks = [("benchmark", p) for p in sorted((root / "benchmarks").glob("pliant-v*.yaml"))]
    data = [("generate", p) for p in sorted((root / "models" / "shipped").glob("*/data.yaml"))]
    recipes = [
        ("don" if p.name.startswith("don") else "timecycle", p)
        for p in sorted((root / "models" / "configs").glob("*.yaml"))
    ]
    assert benchmarks
    assert data
    assert recipes
    return [*benchmarks, *data, *recipes]


@pytest.mark.parametrize(("kind", "path"), shipped(), ids=lambda each: str(each)[-40:])
def test_shipped_files_are_accepted_and_a_misspelt_key_is_refused(kind: str, path: Path) -> None:
    from pliant.benchmarks.suite.config import BenchmarkConfig
    from pliant.benchmarks.suite.config_file import read_config
    from pliant.generator.config import GenerateConfig
    from pliant.models.don.settings import DonSettings
    from pliant.models.timecycle.settings import TimeCycleSettings

    classes: dict[str, type[Settings]] = {
        "benchmark": BenchmarkConfig, "generate": GenerateConfig, "don": DonSettings,
        "timecycle": TimeCycleSettings,
    }  # fmt: skip
    document = read_yaml(path)
    if kind == "benchmark":
        read_config(path)
    else:
        settings_from(classes[kind], document)
    with pytest.raises(SettingsError, match="misspelt"):
        settings_from(classes[kind], {**document, "misspelt": 1})


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["generate", "rope", "--out", "OUT", "--set", "look.specular=[0, 3]"],
            "--set, look.specular: invalid setting; found [0, 3]; required: 0 to 1",
        ),
        (
            ["train", "don", "--data", "DATA", "--out", "OUT", "--set", "augment.rotate_degree=3"],
            "--set, augment.rotate_degree: unknown setting. Did you mean 'rotate_deg'?",
        ),
        (
            ["benchmark", "BENCHMARK", "--out", "OUT", "--set", "sets.rope.tiers=[ropes]"],
            '--set, sets.rope.tiers.0: invalid setting; found "ropes"; '
            "required: one of rope, cloth-1, cloth-2, cloth-3, towel. Did you mean 'rope'?",
        ),
    ],
    ids=lambda each: each[0] if isinstance(each, list) else "",
)
def test_set_is_the_same_in_every_command(
    arguments: list[str],
    sentence: str,
    tiny_dataset: Path,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    benchmark = Path(__file__).parents[2] / "benchmarks" / "pliant-v3-mini.yaml"
    places = {"OUT": tmp_path / "out", "DATA": tiny_dataset, "BENCHMARK": benchmark}
    assert run([str(places.get(each, each)) for each in arguments]) == 2
    assert sentence in capfd.readouterr().err
    assert not (tmp_path / "out").exists()
