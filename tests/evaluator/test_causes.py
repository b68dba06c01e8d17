"""Causes of errors in the scores: of each tier, in the pair table, and adding up to the error."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.evaluator import write_report
from pliant.evaluator.scores import read_scores

NAMES = ("imprecision", "flip", "off_object", "layer", "across", "along", "missing", "hidden")


def test_an_error_gets_its_cause(scene: Any, tmp_path: Path) -> None:
    """One kind of error at a time, on pictures 160 px wide: 1 px is precise, 8 px is near."""
    true_px, visible = scene.true_px, scene.visible
    cloth = np.array(scene.queries["tier"].to_pylist()) == "cloth"
    alternatives = scene.truth["alternatives"].to_pylist()
    partner_px = np.array(
        [(each[0]["u"], each[0]["v"]) if each else (0, 0) for each in alternatives]
    )
    other_px = np.roll(true_px.reshape(-1, 20, 2), 1, axis=1).reshape(-1, 2)
    for cause, answer_px, of in (
        ("imprecision", true_px + 0.7, visible),
        ("flip", partner_px, cloth),
        ("off_object", np.ones_like(true_px), visible),
        ("along", other_px, ~cloth & (np.linalg.norm(other_px - true_px, axis=1) > 8)),
    ):
        wrong = visible & of & (np.linalg.norm(answer_px - true_px, axis=1) > 0.9)
        table = scene.table(np.where(wrong[:, None], answer_px, true_px))
        found = scene.score(tmp_path, table).document["causes"]["overall"]
        expected = Counter(imprecision=sum(visible & ~wrong), hidden=sum(~visible))
        expected[cause] += sum(wrong)
        assert min(sum(wrong), expected["hidden"]) > 20
        assert +Counter({name: found[name]["answers"] for name in NAMES}) == +expected


def test_the_shares_add_up_to_the_squared_error(scene: Any, tmp_path: Path) -> None:
    """Random answers: every visible point has one cause, in every tier and in the pair table."""
    rng = np.random.default_rng(3)
    uv = rng.uniform(0, (160, 120), (scene.rows, 2))
    near = rng.random(scene.rows) < 0.6
    uv[near] = (scene.true_px + rng.normal(0, 4, uv.shape))[near]
    scores = scene.score(tmp_path, scene.table(uv))
    document = scores.document["causes"]
    for group, found in (("overall", document["overall"]), *document["tiers"].items()):
        assert list(found) == list(NAMES)
        counted = [found[name] for name in NAMES if name != "hidden"]
        assert sum(each["squared_error_share"] for each in counted) == pytest.approx(1)
        assert sum(each["answers_share"] for each in counted) == pytest.approx(1)
        values = scores.overall if group == "overall" else scores.tiers[group]
        total = sum(each["answers"] * (each["rmse_px"] or 0) ** 2 for each in counted)
        answers = sum(each["answers"] for each in counted)
        assert np.sqrt(total / answers) == pytest.approx(values["rmse_px"])
    sums = [scores.per_pair[f"cause_{name}_px2"].to_numpy() for name in NAMES if name != "hidden"]
    whole = scores.per_pair["sum_squared_px2"].to_numpy()
    np.testing.assert_allclose(np.sum(sums, axis=0), whole, rtol=1e-9)
    write_report(scores, tmp_path / "report")
    assert read_scores(tmp_path / "report").document["causes"] == document


def test_without_surface_images_there_are_no_causes(
    scene_maker: Callable[..., Any], tmp_path: Path
) -> None:
    scene = scene_maker(tmp_path / "data", images=False)
    assert "causes" not in scene.score(tmp_path).document


def test_scores_for_participants_have_no_causes(scene: Any, tmp_path: Path) -> None:
    """Causes are found with the truth, so they would tell single answers."""
    assert "causes" in scene.score(tmp_path).document
    assert "causes" not in scene.score(tmp_path, hide_truth=True).document
