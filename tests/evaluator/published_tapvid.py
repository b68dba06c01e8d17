"""TAP-Vid's published figures over whole videos, from section 3 of the paper, and drawn videos."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow.parquet as pq

from pliant.converters.clip import Clip
from pliant.converters.import_settings import ImportSettings
from pliant.converters.writer import write_imported
from pliant.evaluator import Scores, evaluate_answers
from pliant.spec.dataset import Dataset

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


def scored(videos: list[Video], mode: Mode, root: Path) -> Scores:
    """Write a dataset of the videos, and score the answers to it."""
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
    return evaluate_answers(dataset, "test", answers, truth=done.truth, protocol=f"tapvid-{mode}")
