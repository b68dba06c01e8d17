"""Protocols are frozen: their bytes, and the scores they give to a committed submission."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.evaluator import (
    PROTOCOL_NAMES,
    Scores,
    evaluate,
    evaluate_answers,
    read_protocol,
    write_report,
)
from pliant.evaluator.protocols.protocol import metric_class
from pliant.evaluator.scores import check_document
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError, SubmissionError
from tests.evaluator.figures import assert_same, figure

TINY = Path(__file__).parents[1] / "data" / "tiny-submission"

# A change of a protocol is a new version of it, and makes old scores incomparable: the new sha256
# stands here with the reason.
# 1.1: a missing answer is the worst value in every metric; of several keypoint matches from one
# source pixel only the best counts. Scores of whole answers are those of 1.0.
# standard 1.2: figures of points with an equal partner (`orbit`); all others are those of 1.1.
# tapvid, track 1.2: figures and slices of the points that move, and the error after 15 frames;
# all others are those of 1.1.
# track 1.4: points that were hidden before (`aj_redetected`); all other figures are those of 1.3.
# The next minor version of every protocol: intervals resample both sequences of a pair, and those
# of figures with a unit are symmetric in the logarithm. No figure changes.
FROZEN: dict[str, str] = {
    "paper": "b02f2079a46f5c190cdbd4223552e9d5f76a3ba9987c541bb1a63a823df20464",
    "standard": "0e919a902fa83ed686fbe914660875753ec84570b37a4de4b97e46e04e4aa9c2",
    "tapvid": "c8ee8c33af139ea12853ec6b47a244f76182be166ef3684dd2543e1123612f0e",
    "track": "de153f0e45122b701a245ea84f1c4c362f1eb7372e6570efc8c88253505691f8",
    "tapvid-first": "ffc8e7466a9b102e5643fed0d80742f312b07d11f418bd5b4aecf2dcd76bd6b9",
    "tapvid-strided": "4385acabe4c2c7695606afa3988a17a0588f66d44db178548000a13a7a122f7d",
    "auc": "eec827344c0fc88c8ba2f8e84e5934baec2a8d4224150037138fbbfc1d34d9dc",
    "spair": "33ec491cd213be186ead62d1f7d33390f89c2d2de3e343a1819d7c53c81d9c6e",
    "matches": "47909624e71342c0983118f30977183c012be6e57a2e245629fb8b6552f54a85",
}


@pytest.mark.parametrize("name", PROTOCOL_NAMES)
def test_a_protocol_is_frozen(name: str) -> None:
    protocol = read_protocol(name)
    assert protocol.sha256 == FROZEN[name]
    assert protocol.name == name


@pytest.mark.parametrize("name", PROTOCOL_NAMES)
def test_a_headline_is_of_metrics_that_the_protocol_gives(
    name: str, scene: Any, tmp_path: Path
) -> None:
    protocol = read_protocol(name)
    families = [metric_class(name).figures(each) for name, each in protocol.settings.items()]
    assert sum(map(len, families)) == len(protocol.figures), "two metrics share a name"
    if name in ("tapvid-first", "tapvid-strided"):
        with pytest.raises(CallError, match=f"{name} scores points .*; found no image pair"):
            scene.score(tmp_path, protocol=name)
    elif protocol.kind == "answers":
        assert set(protocol.headline) <= set(scene.score(tmp_path, protocol=name).overall)


def test_the_committed_submission_keeps_its_score() -> None:
    golden = json.loads((TINY / "golden.json").read_text())
    found = evaluate(TINY / "submission.parquet", TINY / "dataset").document
    for name, value in golden.items():
        assert_same(found[name], value, name, 1e-9)


def tiny_errors(*, moving: bool = False) -> np.ndarray:
    """Return the errors of the committed submission at visible points, or at those that move.

    They are 0, 5, 10 and 0 px in turn, so everything follows from counting.
    """
    dataset = Dataset.open(TINY / "dataset")
    truth, queries = dataset.truth("test").to_pylist(), dataset.queries("test").to_pylist()
    return np.array([
        (0.0, 5.0, 10.0, 0.0)[row["query_id"] % 4]
        for row, asked in zip(truth, queries, strict=True)
        if row["visibility_b"] == "visible"
        and (not moving or math.dist((row["u_b"], row["v_b"]), (asked["u_a"], asked["v_a"])) > 4)
    ])  # fmt: skip


def test_the_golden_score_is_what_its_offsets_say() -> None:
    seen = tiny_errors()
    golden = json.loads((TINY / "golden.json").read_text())["overall"]
    assert golden["rmse_px"] == pytest.approx(np.sqrt(np.mean(seen**2)), abs=1e-5)
    assert golden["mean_px"] == pytest.approx(np.mean(seen), abs=1e-5)
    assert golden["pck_4px"] == np.mean(seen < 1)
    assert golden["pck_8px"] == np.mean(seen < 6)
    assert golden["pck_16px"] == 1


@pytest.mark.parametrize("name", ["tapvid", "track"])
def test_points_that_move_are_scored_beside_all(name: str) -> None:
    scores = evaluate(TINY / "submission.parquet", TINY / "dataset", protocol=name)
    moving = tiny_errors(moving=True)
    assert 0 < len(moving) <= len(tiny_errors())
    assert scores.overall["rmse_px_moving"] == pytest.approx(np.sqrt(np.mean(moving**2)), abs=1e-5)
    assert scores.overall["pck_8px_moving"] == np.mean(moving < 8)
    slices = scores.document["slices"]["displacement"]
    far = [row for row in slices if row["slice"] not in ("below 1 px", "1 to 4 px")]
    assert sum(row["queries"] for row in far) == len(moving)


@pytest.mark.parametrize("name", ["paper", "standard", "tapvid", "auc", "spair"])
def test_the_truth_scores_perfectly_in_every_tier(name: str, scene: Any, tmp_path: Path) -> None:
    table = scene.table(
        visible=scene.visible.astype(np.float32), sigma=np.full(scene.rows, 0.5, np.float32)
    )
    scores = scene.score(tmp_path, table, protocol=name)
    check_document(scores.document)
    perfect = {
        **dict.fromkeys(("rmse_px", "rmse_px_mean_over_pairs", "mean_px", "p95_px"), 0),
        **dict.fromkeys(("symmetric_rmse_px", "jump_rate", "ece", "ause", "off_object_rate"), 0),
        **dict.fromkeys(("pck_1px", "pck_0.05box", "pck_0.1box", "auc_1px", "auc_5px_queries"), 1),
        **dict.fromkeys(("aj", "oa", "delta_avg", "coverage_50"), 1),
    }
    for tier, found in [("overall", scores.overall), *scores.tiers.items()]:
        common = perfect.keys() & found.keys()
        assert len(common) >= 2
        for metric in common:
            assert found[metric] == perfect[metric], (tier, metric)


def test_a_missing_answer_is_an_error_unless_allowed_and_then_a_failure(
    scene: Any, tmp_path: Path
) -> None:
    seen = np.flatnonzero(scene.visible)
    keep = np.delete(np.arange(scene.rows), seen[:3])
    path = scene.submit(tmp_path / "s.parquet", scene.table().take(keep))
    with pytest.raises(SubmissionError, match="3 problems") as caught:
        evaluate(path, scene.root)
    assert {issue.code for issue in caught.value.issues} == {"ROW_MISSING"}
    assert "pair 0, query" in str(caught.value)
    scores = evaluate(path, scene.root, allow_missing=True)
    assert scores.document["coverage"] == (scene.rows - 3) / scene.rows
    assert scores.overall["rmse_px"] == pytest.approx(np.sqrt(3 * 200**2 / len(seen)))
    assert scores.overall["pck_32px"] == pytest.approx(1 - 3 / len(seen))
    assert figure(scores, "delta_avg") < 1
    assert figure(scores, "oa") < 1


def test_a_foreign_truth_is_the_datasets_fault(
    scene: Any, scene_maker: Any, tmp_path: Path
) -> None:
    path = scene.submit(tmp_path / "s.parquet")
    other = scene_maker(tmp_path / "other", seed=5, images=False)
    with pytest.raises(SpecError, match="these queries; found queries_sha256"):
        evaluate(path, scene.root, truth=other.root / "truth" / "test.parquet")
    queries = scene.root / "queries" / "test.parquet"
    with pytest.raises(SpecError, match="found table 'queries'; required: table 'truth'"):
        evaluate(path, scene.root, truth=queries)
    own = scene.root / "truth" / "test.parquet"
    elsewhere = tmp_path / "answers" / "test.parquet"
    elsewhere.parent.mkdir()
    elsewhere.write_bytes(own.read_bytes())
    for truth in (elsewhere, elsewhere.parent):
        assert evaluate(path, scene.root, truth=truth).overall["rmse_px"] == 0


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
