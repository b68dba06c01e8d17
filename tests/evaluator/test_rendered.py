"""The truth of really generated data scores perfectly in every tier, and a drift as what it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.evaluator import Scores, evaluate_answers, write_report
from pliant.spec.dataset import Dataset
from tests.evaluator.figures import figure


def score_truth(root: Path, *, drift_px: float = 0.0, protocol: str = "standard") -> Scores:
    """Score the truth, moved by so much to the right for each frame since the query."""
    dataset = Dataset.open(root)
    truth, queries = dataset.truth("test"), dataset.queries("test")
    elapsed = np.abs(queries["frame_b"].to_numpy() - queries["frame_a"].to_numpy())
    visible = np.array([state == "visible" for state in truth["visibility_b"].to_pylist()])
    answers = {
        "u": (truth["u_b"].to_numpy() + drift_px * elapsed).astype(np.float32),
        "v": truth["v_b"],
        "visible": visible.astype(np.float32),
        "sigma": np.full(len(visible), 0.5, np.float32),
    }
    return evaluate_answers(dataset, "test", answers, protocol=protocol)


@pytest.mark.slow
def test_the_truth_of_rendered_tiers_is_perfect(tiny_dataset: Path) -> None:
    scores = score_truth(tiny_dataset)
    assert set(scores.tiers) == {"rope", "cloth-1", "cloth-3"}
    for tier, found in scores.tiers.items():
        for metric in ("rmse_px", "p95_px", "ece", "ause", "jump_rate"):
            assert found[metric] == 0, (tier, metric)
        for metric in ("pck_1px", "pck_0.05box", "aj", "oa", "delta_avg"):
            assert found[metric] == 1, (tier, metric)
        assert figure(scores, "off_object_rate", tier) < 0.01
        # Half a pixel of material, save at folds, where a pixel shows another layer.
        assert figure(scores, "geodesic_mean_m", tier) < 0.02


@pytest.mark.slow
def test_a_drift_shows_over_the_time_since_the_query(tiny_episode: Path, tmp_path: Path) -> None:
    """An answer that strays by 3 px a frame is 3 k px off after k frames, and so its RMSE."""
    scores = score_truth(tiny_episode, drift_px=3.0, protocol="track")
    curve = scores.document["curves"]["overall"]["rmse_over_time"]
    queries = Dataset.open(tiny_episode).queries("test")
    elapsed = np.abs(queries["frame_b"].to_numpy() - queries["frame_a"].to_numpy())
    assert set(curve["frames"]) <= set(elapsed.tolist())
    assert len(curve["frames"]) > 1
    np.testing.assert_allclose(curve["rmse_px"], 3.0 * np.array(curve["frames"]), rtol=1e-4)
    assert sum(curve["queries"]) == scores.document["counts"]["counted"]
    for frames in (1, 5, 10, 20, 40, 80):
        value = scores.overall[f"rmse_px_after_{frames}"]
        assert value is None or value == pytest.approx(3.0 * frames, rel=1e-4)
        assert (value is None) == (frames not in curve["frames"])
    write_report(scores, tmp_path / "report", data=tiny_episode)
    page = (tmp_path / "report" / "report.html").read_text()
    assert "RMSE since the query" in page
    assert "RMSE after 10 frames" in page
