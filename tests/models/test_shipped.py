"""The models of the package: they answer, and take options."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

import pliant
from pliant.baselines.predict import predict
from pliant.evaluator import evaluate
from pliant.models import shipped
from pliant.models.shipped import load_shipped, shipped_names
from pliant.spec.errors import CallError
from tests.evaluator.figures import figure
from tests.models.shipped_models import made_like_training_set, shipped_don


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name == "don-towel" else pytest.mark.long)
        for name in shipped_names()
    ],
)
def test_models_of_the_package_answer(name: str, tmp_path: Path) -> None:
    """On three test shapes that `data.yaml`, the config of the training set, generates again.

    The cards' median errors are 3 to 29 px; the control `centroid` has 80 and more, and a model
    that lost its weights, or sees its pictures otherwise, no less.
    """
    folder = shipped.FOLDER / name
    config = yaml.safe_load((folder / "config.yaml").read_text())
    assert sum(path.stat().st_size for path in folder.iterdir()) < 8_000_000
    card = (folder / "CARD.md").read_text()
    assert card.startswith(f"# {name}\n")
    assert f"`{config['tier']}`" in card
    assert "Protocol" in card, "the card has no scores"
    matcher = load_shipped(name)
    assert matcher.name == name
    dataset = made_like_training_set(name, tmp_path / "set", 3)
    predict(dataset, "test", matcher, tmp_path / "answers.parquet")
    scores = evaluate(tmp_path / "answers.parquet", dataset)
    assert figure(scores, "median_px") < 60
    assert figure(scores, "ece") < 0.2


def test_a_trained_model_takes_its_answer_settings_as_options() -> None:
    """The footer of a submission says them; a setting that does not exist is named."""
    turned = load_shipped("don-cloth", blank_square="any")
    assert turned.describe()["answer"]["blank_square"] == "any"
    assert load_shipped("don-cloth").describe()["answer"]["blank_square"] == "upright"
    assert shipped_don("don-rope", crossings=False).reader.crossings is None
    with pytest.raises(CallError, match="blank_sqare: unknown setting"):
        load_shipped("don-cloth", blank_sqare="any")
    with pytest.raises(CallError, match=r"answer\.crossings"):
        load_shipped("don-cloth", crossings=True)


@pytest.mark.parametrize("parameter", ["name", "folder", "run", "method"])
def test_no_option_is_taken_for_a_parameter(parameter: str) -> None:
    """Options come from `--set`, with any name."""
    with pytest.raises(CallError, match=f"{parameter}: unknown setting"):
        pliant.open_method("don-cloth", **{parameter: "x"})
    with pytest.raises(CallError, match=f"unexpected keyword argument '{parameter}'"):
        pliant.open_method("identity", **{parameter: "x"})
