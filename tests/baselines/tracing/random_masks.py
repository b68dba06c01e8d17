"""Masks as a careless user draws them: ropes with faults, and things that are no rope."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from pliant.spec.arrays import Mask

KINDS = ("thin", "thick", "holed", "fragmented", "pixel", "full", "figure eight", "noise", "edge")


def random_masks(rng: np.random.Generator) -> tuple[Mask, Mask]:
    """Return the masks of a rope and of the rope with its ball, if it has one: bool (H, W)."""
    height, width = (int(side) for side in rng.integers(8, 49, 2))
    kind = KINDS[int(rng.integers(len(KINDS)))]
    mask = np.zeros((height, width), np.bool_)
    start = (int(rng.integers(height)), int(rng.integers(width)))
    if kind == "full":
        mask[:] = True
    elif kind == "pixel":
        mask[start] = True
    elif kind == "noise":
        mask = rng.random(mask.shape) < rng.uniform(0.02, 0.98)
    elif kind == "edge":  # a rope that the picture cuts along its side
        mask[:, : int(rng.integers(1, 4))] = True
    else:
        line = _figure_eight(rng) if kind == "figure eight" else _random_line(rng)
        radius = {"thin": 0.5, "thick": 6.0}.get(kind, rng.uniform(0.5, 4.0))
        mask = _painted(line * [height - 1, width - 1], mask.shape, radius)
        if kind == "holed":
            mask &= rng.random(mask.shape) > rng.uniform(0.02, 0.5)
        if kind == "fragmented":
            mask &= ndimage.zoom(rng.random((5, 5)), np.array(mask.shape) / 5, order=0) > 0.4
        start = (int(line[0, 0] * (height - 1)), int(line[0, 1] * (width - 1)))
    if rng.random() < 0.5:
        return mask, mask
    rows, columns = np.indices(mask.shape)
    ball = np.hypot(rows - start[0], columns - start[1]) <= rng.uniform(0.4, 8.0)
    return mask & ~ball, mask | ball


def _random_line(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Return a smooth line that may cross itself, float64 (N, 2), 0 to 1."""
    corners = rng.random((int(rng.integers(2, 9)), 2))
    at = np.linspace(0, len(corners) - 1, 400)
    line = np.stack([np.interp(at, np.arange(len(corners)), c) for c in corners.T], axis=1)
    return np.asarray(ndimage.gaussian_filter1d(line, 15, axis=0, mode="nearest"))


def _figure_eight(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    turn = np.linspace(0, 2 * np.pi * rng.uniform(0.7, 1.0), 400)
    return 0.5 + 0.45 * np.stack([np.sin(2 * turn), np.sin(turn)], axis=1)


def _painted(line: npt.NDArray[np.float64], shape: tuple[int, ...], radius: float) -> Mask:
    mask = np.ones(shape, np.bool_)
    mask[tuple(np.rint(line).astype(int).T)] = False
    return np.asarray(ndimage.distance_transform_edt(mask) <= radius)
