"""Recipes of the shipped models: readable, and each makes a model that answers, in a small form."""

from __future__ import annotations

import json
import shutil
from contextlib import nullcontext
from pathlib import Path
from typing import Literal

import pyarrow.parquet as pq
import pytest
import torch

from pliant.generator.config import GenerateConfig
from pliant.loaders import FrameStore
from pliant.models import load_matcher, model_recipe
from pliant.models.don.ball import BallNetwork
from pliant.models.don.settings import DonSettings
from pliant.models.model_recipe import _mean, _train_masks, make_model
from pliant.models.networks.mask_network import MASKS, MaskNetwork
from pliant.models.networks.print_network import PRINTS, PrintNetwork
from pliant.models.recipe_file import RECIPES, MaskStage, read_recipe
from pliant.models.shipped import FOLDER
from pliant.models.training.run_folder import BALL, write_settings
from pliant.spec.configuration import read_settings, settings_from
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError, TrainingError
from tests.conftest import Called
from tests.known import known
from tests.models.tiny_runs import DON, options

NAMES = sorted(path.stem for path in RECIPES.glob("*.yaml"))
SMALL = (
    "steps=2", "batch=1", "width=80", "height=60", "workers=0", "threads=1",
    "network={widths: [8, 16, 32], global_blocks: 1}",
    "validation={pairs: 3, queries: 8, calibration_pairs: 6, every: 2}", "optimiser.warmup=1",
)  # fmt: skip


def test_every_shipped_model_has_a_recipe() -> None:
    assert sorted(path.name for path in FOLDER.iterdir() if path.is_dir()) == NAMES
    for name in NAMES:
        recipe = read_recipe(RECIPES / f"{name}.yaml")
        assert recipe.name == name
        counts = {
            each: settings_from(GenerateConfig, config).counts
            for each, config in recipe.sets.items()
        }
        for stage in recipe.stages.values():
            assert all(counts[each].get("val", 60) >= 60 for each in stage.sets)
        # The last calibration is on pairs of every set of its stage.
        assert all(counts[each]["val"] >= 60 for each in list(recipe.stages.values())[-1].sets)
        if recipe.masks is not None:
            assert all(counts[each]["train"] >= 60 for each in recipe.masks.sets)


def test_steps_of_a_trial_are_those_of_the_small_networks_too() -> None:
    cloth = RECIPES / "don-cloth.yaml"
    assert known(read_recipe(cloth, ["steps=7"]).prints).steps == 7
    assert known(read_recipe(cloth).prints).steps > 1000
    recipe = read_recipe(RECIPES / "don-rope.yaml", ["steps=7", "batch=2"])
    assert known(recipe.masks).steps == 7
    assert known(recipe.masks).later == (7,) * 5
    assert recipe.stages["coarse"].settings["steps"] == 7
    assert read_recipe(RECIPES / "don-rope.yaml").masks.steps > 1000  # type: ignore[union-attr]


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_recipe_makes_a_model_that_answers_and_goes_on(
    name: str, tmp_path: Path, called: Called
) -> None:
    size = ("--sequences", "4", "--workers", "1", *options(*SMALL))
    code, _, shown = called("train", "model", name, "--out", tmp_path, *size)
    assert code == 0
    assert "sequences to make" in shown
    made = tmp_path / "models" / name
    assert load_matcher(made).name == name
    assert (made / "data.yaml").is_file()
    stages = read_recipe(RECIPES / f"{name}.yaml").stages
    last = tmp_path / "stages" / list(stages)[-1]
    facts = json.loads((last / "run.json").read_text())
    assert (made / "calibration.json").is_file()
    if stages[last.name].mean_of:
        assert facts["share_of_the_last"] in stages[last.name].shares
    before = (last / "best.safetensors").stat().st_mtime_ns
    again = called("train", "model", name, "--out", tmp_path, *size)
    assert again[0] == 0  # nothing is trained again
    assert (last / "best.safetensors").stat().st_mtime_ns == before


@pytest.mark.parametrize(("of", "expected"), [("rope", [MASKS, BALL]), ("cloth", [MASKS])])
def test_small_networks_are_trained_once(
    of: Literal["rope", "cloth"],
    expected: list[str],
    sheet_dataset: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And the network for the ball only where there are ropes."""
    trained: list[str] = []

    def masks(*_: object, **__: object) -> MaskNetwork:
        trained.append(MASKS)
        return MaskNetwork()

    def ball(*_: object, pictures: int, **__: object) -> BallNetwork:
        assert pictures == 2 * 3 * len(sheet_dataset.frames("train"))
        trained.append(BALL)
        return BallNetwork()

    monkeypatch.setattr(model_recipe, "fit_masks", masks)
    monkeypatch.setattr(model_recipe, "fit_ball", ball)
    (tmp_path / "sets").mkdir()
    (tmp_path / "sets" / "x").symlink_to(sheet_dataset.root)
    run = tmp_path / "run"
    run.mkdir()
    write_settings(run, DonSettings())
    for _ in range(2):
        _train_masks(
            MaskStage(sets=("x",), steps=1, of=of, ball_sets=("x",)),
            tmp_path,
            run,
            lambda *_: nullcontext(),
        )
        assert trained == expected
        assert sorted(path.name for path in run.glob("*.safetensors")) == sorted(expected)


def test_the_network_for_prints_is_trained_at_the_size_of_the_model(
    sheet_dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[int, int]] = []

    def fit(stores: list[FrameStore], **_: object) -> PrintNetwork:
        seen.extend(store.size for store in stores)
        return PrintNetwork()

    monkeypatch.setattr(model_recipe, "fit_prints", fit)
    path = tmp_path / "recipe.yaml"
    path.write_text(
        "name: m\nsettings: {}\nsets: {x: {tiers: [sheet]}}\nstages: {a: {sets: [x]}}\n"
        "prints: {sets: [x], steps: 3}\n"
    )
    recipe = read_recipe(path, [*DON[2:], "steps=3", "width=48"])

    def copied(_: object, folder: Path) -> None:
        if not folder.exists():
            shutil.copytree(sheet_dataset.root, folder)

    for _ in range(2):  # the second time, it is there
        made = make_model(recipe, tmp_path / "out", copied)
        assert (made / PRINTS).is_file()
        assert [size[0] for size in seen] == [48]


def test_mean_of_weights() -> None:
    first = {"a": torch.tensor([1.0, 3.0]), "n": torch.tensor(3)}
    last = {"a": torch.tensor([5.0, -1.0]), "n": torch.tensor(7)}
    mean = _mean(first, last, 0.25)
    assert mean["a"].tolist() == [2.0, 2.0]
    assert int(mean["n"]) == 7


def test_a_changed_recipe_is_refused_for_finished_stages(
    sheet_dataset: Dataset, tmp_path: Path
) -> None:
    def make(
        out: Path, width: int = 40, mean_of: str = "[first, further]", more: str = "{batch: 2}"
    ) -> Path:
        path = tmp_path / "recipe.yaml"
        path.write_text(
            "name: m\nsettings: {}\nsets: {x: {tiers: [sheet]}}\nstages:\n"
            "  first: {sets: [x]}\n"
            f"  further: {{sets: [x], start: first, settings: {more}}}\n"
            f"  mean: {{sets: [x], mean_of: {mean_of}, shares: [0.5]}}\n"
        )
        return make_model(read_recipe(path, [*DON[2:], "steps=3", f"width={width}"]), out, copied)

    def copied(_: object, folder: Path) -> None:
        if not folder.exists():
            shutil.copytree(sheet_dataset.root, folder)

    made = make(tmp_path / "out")
    mean = read_settings(DonSettings, made / "config.yaml")
    assert mean.batch == 2  # as of the stage whose steps the card tells
    assert "pliant train model recipe.yaml --out DIR\n```" in (made / "CARD.md").read_text()
    assert read_recipe(made / "recipe.yaml") == read_recipe(
        tmp_path / "recipe.yaml", [*DON[2:], "steps=3", "width=40"]
    )
    moved = (tmp_path / "out").rename(tmp_path / "moved")
    assert make(moved).name == made.name
    with pytest.raises(TrainingError, match=r"stages/first/config\.yaml, width.*Remove the"):
        make(moved, width=48)
    with pytest.raises(TrainingError, match=r"stages/mean/run\.json, mean_of"):
        make(moved, mean_of="[further, first]")
    with pytest.raises(CallError, match="different networks"):
        make(tmp_path / "other", more="{pairs: {input: grey}}")
    state = next(moved.glob("stages/further/checkpoints/*/state.json"))
    state.write_text("{")
    with pytest.raises(SpecError, match=r"state\.json: this is not strict JSON"):
        make(moved)
    listed = moved / "sets" / "x" / "sequences.parquet"
    pq.write_table(pq.read_table(listed).slice(1), listed)
    with pytest.raises(TrainingError, match="stages/first: the stage was trained on other sequ"):
        make(moved)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stages: {a: {sets: [x], start: b}}", "stages.a: unknown name.*nothing: it is the first"),
        ("stages: {a: {sets: [y]}}", "stages.a.sets: unknown name.*one of x"),
        ("stages: {a: {sets: [x], mean_of: [b]}}", "two stages"),
        ("stages: {a: {sets: [x], begin: b}}", "unknown setting"),
        ("stages: {a: {sets: [x], settings: word}}", "stages.a.settings.*word"),
        (
            "stages: {a: {sets: [x], settings: {tier: rope}}}",
            "stages.a, tier: a recipe sets this itself",
        ),
        ("stages: {a: {sets: []}}", "stages.a.sets.*at least one set"),
        ("stages: {}", "at least one stage"),
        ("stages: [a]", "stages"),
        (
            "stages: {a: {sets: [x]}}\nmasks: {of: rope, sets: [], steps: 1}",
            "masks.sets.*at least one set",
        ),
        ("stages: {a: {sets: [x]}}\nprints: {sets: [], steps: 1}", "prints.sets.*at least one"),
        ("stages: {a: {sets: [x]}}\nprints: {sets: [y], steps: 1}", "prints.sets: unknown name"),
        ("sets: {z: {}}\nstages: {a: {sets: [z]}}", "sets.z.tiers: a set has"),
    ],
)
def test_wrong_recipe_is_one_sentence(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "recipe.yaml"
    sets = "" if text.startswith("sets:") else "sets: {x: {tiers: [rope], splits: {train: 2}}}\n"
    path.write_text(f"name: m\nsettings: {{}}\n{sets}{text}\n")
    with pytest.raises(CallError, match=message):
        read_recipe(path)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["don-rop"], "found don-rop; required: one of don-cloth, don-rope, don-towel"),
        (["don-rope", "--set", "stepz=3"], "--set, stepz: unknown setting. Did you mean 'steps'?"),
        (["RECIPE"], "recipe.yaml, sets.y.stepz: unknown setting"),
    ],
)
def test_nothing_is_generated_for_a_wrong_call(
    arguments: list[str], message: str, tmp_path: Path, called: Called
) -> None:
    recipe, out = tmp_path / "recipe.yaml", tmp_path / "out"
    recipe.write_text(
        "name: m\nsettings: {}\nstages: {a: {sets: [x]}}\n"
        "sets: {x: {tiers: [rope]}, y: {tiers: [rope], style: fast, stepz: 1}}\n"
    )
    arguments = [str(recipe) if each == "RECIPE" else each for each in arguments]
    code, _, error = called("train", "model", *arguments, "--sequences", "2", "--out", out)
    assert code == 2
    assert message in " ".join(error.split())
    assert not out.exists()
