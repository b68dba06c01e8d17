"""TAP-Vid over whole videos, against its published definition on dense arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow.parquet as pq
import pytest

from pliant.converters.clip import Clip
from pliant.converters.writer import ImportSettings, write_imported
from pliant.evaluator import evaluate_answers
from pliant.evaluator.metrics.auc import area_under_recall
from pliant.spec.dataset import Dataset
from tests.evaluator.figures import figure

Mode = Literal["first", "strided"]
WIDTH, HEIGHT, FRAMES = 64, 48, 12
THRESHOLDS = (1, 2, 4, 8, 16)


@dataclass(frozen=True)
class Video:
    """Tracks of points, and what a method says of each query (its frame and its point)."""

    tracks: np.ndarray  # (N, T, 2), px
    visible: np.ndarray  # (N, T)
    said_tracks: np.ndarray  # (T, N, T, 2): the query's frame first
    said_visible: np.ndarray  # (T, N, T), probabilities

    @property
    def clip(self) -> Clip:
        black = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        return Clip(
            "video", (WIDTH, HEIGHT), FRAMES, lambda _: black, self.tracks, self.visible, True
        )


def video(rng: np.random.Generator, points: int) -> Video:
    walk = rng.normal(0, 1.5, (points, FRAMES, 2)).cumsum(axis=1)
    tracks = (rng.uniform(10, 38, (points, 1, 2)) + walk).astype(np.float32).astype(float)
    inside = ((tracks >= 0) & (tracks < [WIDTH, HEIGHT])).all(axis=2)
    error = rng.normal(0, 1, (FRAMES, points, FRAMES, 2)) * rng.choice(
        [0.1, 1, 4], (FRAMES, 1, 1, 1)
    )
    said = (tracks + error).astype(np.float32)
    visible = inside & (rng.random((points, FRAMES)) < rng.uniform(0.3, 1, (1, FRAMES)))
    return Video(tracks, visible, said, rng.random((FRAMES, points, FRAMES)).astype(np.float32))


def published(videos: list[Video], mode: Mode) -> dict[str, float]:
    """Section 3 of the paper, a loop over points and frames of each video at a time."""
    every: list[dict[str, float]] = []
    for each in videos:
        points = each.visible.shape[0]
        if mode == "first":
            shown = [p for p in range(points) if each.visible[p].any()]
            queries = [(int(np.argmax(each.visible[p])), p) for p in shown]
        else:
            queries = [
                (f, p) for f in range(0, FRAMES, 5) for p in range(points) if each.visible[p, f]
            ]
        right = evaluated = seen = 0
        within = dict.fromkeys(THRESHOLDS, 0)
        true_positives = dict.fromkeys(THRESHOLDS, 0)
        false_positives = dict.fromkeys(THRESHOLDS, 0)
        for asked, point in queries:
            for frame in range(FRAMES):
                if frame <= asked if mode == "first" else frame == asked:
                    continue
                is_seen = bool(each.visible[point, frame])
                says_seen = bool(each.said_visible[asked, point, frame] >= 0.5)
                off = (
                    each.said_tracks[asked, point, frame].astype(float) - each.tracks[point, frame]
                )
                du, dv = off * [256 / WIDTH, 256 / HEIGHT]
                evaluated += 1
                right += is_seen == says_seen
                seen += is_seen
                for t in THRESHOLDS:
                    near = bool(du * du + dv * dv < t * t)
                    within[t] += near and is_seen
                    true_positives[t] += near and is_seen and says_seen
                    false_positives[t] += says_seen and not (near and is_seen)
        shares = {f"delta_{t}": within[t] / seen for t in THRESHOLDS}
        jaccards = {
            f"jaccard_{t}": true_positives[t] / (seen + false_positives[t]) for t in THRESHOLDS
        }
        every.append(
            {
                "oa": right / evaluated,
                **shares,
                **jaccards,
                "delta_avg": sum(shares.values()) / 5,
                "aj": sum(jaccards.values()) / 5,
            }
        )
    return {name: float(np.mean([each[name] for each in every])) for name in every[0]}


def scored(videos: list[Video], mode: Mode, root: Path) -> Any:
    settings = ImportSettings("videos", "cloth", queries=mode)
    done = write_imported([each.clip for each in videos], root, settings, {})
    dataset = Dataset.open(root)
    queries = dataset.queries("test").to_pydict()
    point = pq.read_table(done.truth)["point"].to_numpy()
    names = [each.id for each in dataset.sequences]
    index = np.array([names.index(name) for name in queries["sequence_b"]])
    a, b = np.array(queries["frame_a"]), np.array(queries["frame_b"])
    said = [(videos[i].said_tracks[f, p, g], videos[i].said_visible[f, p, g])
            for i, f, p, g in zip(index, a, point, b, strict=True)]  # fmt: skip
    uv = np.stack([each[0] for each in said])
    answers = {"u": uv[:, 0], "v": uv[:, 1], "visible": np.array([each[1] for each in said])}
    return lambda protocol: evaluate_answers(
        dataset, "test", answers, truth=done.truth, protocol=protocol
    )


@pytest.mark.parametrize("mode", ["first", "strided"])
def test_parity_with_the_published_definition(mode: Mode, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    videos = [video(rng, points) for points in (7, 15, 30)]
    evaluate: Callable[[str], Any] = scored(videos, mode, tmp_path / "data")
    scores = evaluate(f"tapvid-{mode}")
    expected = published(videos, mode)
    assert set(expected) <= set(scores.overall)
    for name, value in expected.items():
        assert abs(figure(scores, name) - value) <= 1e-9, name
        assert 0.02 < value < 0.98
    low, high = scores.document["intervals"]["overall"]["aj"]
    assert low < expected["aj"] < high
    by_pair = figure(evaluate("tapvid"), "aj")
    assert abs(by_pair - expected["aj"]) > 1e-4  # averages per frame are another figure


def test_first_mode_leaves_out_earlier_frames(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    evaluate = scored([video(rng, 12)], "strided", tmp_path / "data")
    first, strided = evaluate("tapvid-first"), evaluate("tapvid-strided")
    assert figure(first, "oa") != figure(strided, "oa")


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


def test_auc_of_pairs_and_queries(scene: Any) -> None:
    off = np.where(scene.pair % 2, 0.0, 2.0)[:, None] * [1.0, 0.0]
    scores = evaluate_answers(scene.root, scene.split, scene.true_px + off, protocol="auc")
    seen = scene.visible
    rows = np.abs(off[seen, 0])
    pairs = np.array([rows[scene.pair[seen] == p].mean() for p in np.unique(scene.pair[seen])])
    for t in (1, 3, 5, 10):
        found = figure(scores, f"auc_{t}px"), figure(scores, f"auc_{t}px_queries")
        assert found == pytest.approx(
            (area_under_recall(pairs, t), area_under_recall(rows, t)), abs=1e-6
        )


def test_spair_is_a_share_of_the_box(scene: Any) -> None:
    """Cloth boxes are 96 px, rope boxes 110: 10 px is within 0.1 of the rope's alone."""
    answers = scene.true_px + np.array([10.0, 0.0])
    scores = evaluate_answers(scene.root, scene.split, answers, protocol="spair")
    assert figure(scores, "pck_0.1box", "cloth") == 0
    assert figure(scores, "pck_0.1box_mean_over_pairs", "rope") == 1
