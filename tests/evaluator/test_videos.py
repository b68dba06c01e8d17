"""TAP-Vid over whole videos, against its published definition on dense arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.evaluator import evaluate_answers
from pliant.evaluator.metrics.auc import area_under_recall
from tests.evaluator.figures import figure
from tests.evaluator.published_tapvid import scored, video


def test_first_mode_leaves_out_earlier_frames(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    evaluate = scored([video(rng, 12)], "strided", tmp_path / "data")
    first, strided = evaluate("tapvid-first"), evaluate("tapvid-strided")
    assert figure(first, "oa") != figure(strided, "oa")


def test_the_error_over_time_by_hand(scene_maker: Any, tmp_path: Path) -> None:
    """Five pairs 1, 2, 3, 1 and 2 frames apart, with errors of 0 to 4 px."""
    scene = scene_maker(
        tmp_path / "data", tiers=("cloth",), sequences=1, frames=4, temporal=True, images=False,
        sources=2,
    )  # fmt: skip
    answers = scene.true_px + np.stack([scene.pair, np.zeros(scene.rows)], axis=1)
    scores = evaluate_answers(scene.root, scene.split, answers, protocol="track")
    curve = scores.document["curves"]["overall"]["rmse_over_time"]
    assert curve["frames"] == [1, 2, 3]
    assert curve["queries"] == [40, 40, 20]
    expected = np.sqrt([(0 + 9) / 2, (1 + 16) / 2, 4])
    assert curve["rmse_px"] == pytest.approx(expected.tolist(), abs=1e-5)
    assert figure(scores, "rmse_px_after_1") == pytest.approx(expected[0], abs=1e-5)
    assert scores.overall["rmse_px_after_5"] is None


def test_pairs_of_configurations_have_no_time(scene: Any) -> None:
    scores = evaluate_answers(scene.root, scene.split, scene.true_px, protocol="track")
    assert scores.overall["rmse_px_after_1"] is None
    assert "rmse_over_time" not in scores.document["curves"].get("overall", {})
    assert scores.document["notes"]["rmse_over_time"] == "no pair is in one episode"


def test_pairs_of_configurations_are_no_video(scene: Any) -> None:
    scores = evaluate_answers(scene.root, scene.split, scene.true_px, protocol="tapvid-first")
    assert scores.overall["aj"] is None
    assert "episode" in scores.document["notes"]["videos"]


@pytest.mark.parametrize(
    ("errors", "threshold", "area"),
    [
        ([0.0], 1, 1.0),  # recall jumps to 1 at 0
        ([5.0], 1, 0.0),
        ([1.0], 2, 0.75),  # rises to 1 at 1, stays: (0.5 + 1) / 2
        ([1.0, 3.0], 4, (0.25 + 1.5 + 1.0) / 4),
        ([1.0, np.inf], 2, (0.25 + 0.5) / 2),
        ([2.0], 2, 0.0),  # an error equal to the threshold is beyond it
    ],
)
def test_area_under_recall_by_hand(errors: list[float], threshold: float, area: float) -> None:
    assert area_under_recall(np.array(errors), threshold) == pytest.approx(area, abs=1e-12)
    assert np.isnan(area_under_recall(np.array([]), 1))


def test_spair_is_a_share_of_the_box(scene: Any) -> None:
    """Cloth boxes are 96 px, rope boxes 110: 10 px is within 0.1 of the rope's alone."""
    answers = scene.true_px + np.array([10.0, 0.0])
    scores = evaluate_answers(scene.root, scene.split, answers, protocol="spair")
    assert figure(scores, "pck_0.1box", "cloth") == 0
    assert figure(scores, "pck_0.1box_mean_over_pairs", "rope") == 1
