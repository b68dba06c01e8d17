"""Where on a rope answers go wrong: along it, or across it; and what no answer could know.

Splits the error of answers on pairs of unseen ropes into the part along the centre line at the true
place and the part across it. For comparison, two oracles that know the true place along the
rope: `centre` answers the middle of the rope there, `side` keeps as far to the left or right of the
middle as the query is in the source. What `side` misses is how the rope is rolled in each frame,
and perspective.

PLIANT_DON_DATA names a dataset with a rope tier (such as DIR/sets/rope of `pliant benchmark`;
without it one is made), PLIANT_DON_RUN a finished run on it (don-rope as shipped without it).

median_px, rmse_px    of the answers, 640x480 px
near_share            share of answers within 30 px
along_px, across_px   median of the two parts among those
centre_median_px      median error of the oracle that answers the middle
side_median_px        median error of the oracle that keeps the side
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt
from record import Value, main

from pliant.benchmarks.suite.config import read_config
from pliant.generator.runner.run import generate
from pliant.loaders.frame_store import FrameStore
from pliant.models import load_matcher
from pliant.models.don.validation import ValidationPair, draw_validation_pairs
from pliant.models.shipped import FOLDER
from pliant.spec.dataset import Dataset

Points = npt.NDArray[np.float64]

REFERENCE = Path(__file__).with_name("pliant-v1-mini.yaml")
NEAR_PX = 30.0


class Centreline:
    """A rope's middle in one frame, a point for each ring of tabulated points.

    Args:
        uv_px: float (P, 2), every tabulated point in the frame.
        ring: intp (P,), the ring each belongs to.
    """

    def __init__(self, uv_px: npt.NDArray[np.float32], ring: npt.NDArray[np.intp]) -> None:
        self.middle = np.stack([uv_px[ring == k].mean(axis=0) for k in range(ring.max() + 1)])
        slope = np.gradient(self.middle.astype(np.float64), axis=0)
        self.along = slope / np.linalg.norm(slope, axis=1, keepdims=True).clip(1e-9)
        self.across = np.stack([-self.along[:, 1], self.along[:, 0]], axis=1)


def oracles(
    store: FrameStore, ring: npt.NDArray[np.intp], pair: ValidationPair, frames: dict[str, int]
) -> tuple[Points, Points, Centreline, npt.NDArray[np.intp]]:
    """Return the two oracles' answers, the target's centre line and the queries' rings."""
    view = store.view(frames[pair.source.key])
    distance = np.square(view.uv_px[None] - pair.uv_a_px[:, None]).sum(axis=2)
    point = np.where(view.visible, distance, np.inf).argmin(axis=1)  # queries are points
    rings = ring[point]
    source = Centreline(view.uv_px, ring)
    target = Centreline(store.view(frames[pair.target.key]).uv_px, ring)
    offset = ((pair.uv_a_px - source.middle[rings]) * source.across[rings]).sum(axis=1)
    middle = target.middle[rings]
    return middle, middle + offset[:, None] * target.across[rings], target, rings


def measure(quick: bool) -> dict[str, Value]:
    """Answer, split, compare."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        data = os.environ.get("PLIANT_DON_DATA")
        if data is None:
            config = read_config(REFERENCE).sets["rope"]
            splits = {"test": 6 if quick else config.counts["test"]}
            config = config.replace(splits=splits, sequences=None)
            generate(config, scratch / "set", workers=1 if quick else 2)
            data = str(scratch / "set")
        dataset = Dataset.open(data)
        matcher = load_matcher(os.environ.get("PLIANT_DON_RUN", FOLDER / "don-rope"))
        store = FrameStore(dataset, "rope", "test", matcher.size, cache=scratch / "cache")
        scale = np.array(dataset.size) / np.array(matcher.size)
        ring = np.unique(store.material[:, 0], return_inverse=True)[1]
        frames = {frame.key: number for number, frame in enumerate(store.frames)}
        errors, middle_errors, side_errors = [], [], []
        for pair in draw_validation_pairs(store, 12 if quick else 200, 48, seed=1):
            seen = pair.visible[:, 0]
            truth = pair.uv_b_px[:, 0]
            middle, side, target, rings = oracles(store, ring, pair, frames)
            answers = matcher.answer(pair)
            error = (answers.uv_px - truth)[seen] * scale
            along, across = target.along[rings[seen]], target.across[rings[seen]]
            parts = [(error * along).sum(axis=1), (error * across).sum(axis=1)]
            errors.append(np.stack([np.linalg.norm(error, axis=1), *np.abs(parts)], axis=1))
            middle_errors.append(np.linalg.norm((middle - truth)[seen] * scale, axis=1))
            side_errors.append(np.linalg.norm((side - truth)[seen] * scale, axis=1))
    pooled = np.concatenate(errors)
    near = pooled[:, 0] <= NEAR_PX
    return {
        "queries": len(pooled),
        "median_px": float(np.median(pooled[:, 0])),
        "rmse_px": float(np.sqrt(np.mean(pooled[:, 0] ** 2))),
        "near_share": float(near.mean()),
        "along_px": float(np.median(pooled[near, 1])),
        "across_px": float(np.median(pooled[near, 2])),
        "centre_median_px": float(np.median(np.concatenate(middle_errors))),
        "side_median_px": float(np.median(np.concatenate(side_errors))),
    }


if __name__ == "__main__":
    main("rope_sides", measure, __doc__)
