"""Which side of a cloth a pair shows: decided once for the pair, not point by point.

The network's p for a point of a cloth often has a mode on each of two sides that look alike.
Points answered one by one then end on both sides of one cloth. Here a regular grid of points of the
source, whatever is asked, is mapped to the target by the one smooth map that most of their p agrees
with: an affine map found by consensus (RANSAC, Fischler and Bolles 1981), then affine maps that
change from place to place, fitted to the modes near them by expectation maximisation. A query's p
is weighed by the distance to where that map takes it. Where nearly all of p is near the map, the
network has decided on one side, and p is not changed.

Lengths are in pixels of a network 240 pixels wide, in proportion for others. They were chosen on
60 validation pairs each of `cloth-1`, `cloth-2` and `cloth-3`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import torch

from pliant.baselines.pixels import pixel_centres
from pliant.models.don.certainty import Widths, mixture_of_modes
from pliant.spec.arrays import FloatArray, Mask

GRID_EVERY_PX: Final = 3
"""Of the target, this share of rows and columns is enough to tell sides apart."""

_GRID_POINTS: Final = 55
_WIDTH: Final = 240.0
_MODE_RADIUS: Final = 9.0
_AGREES: Final = 17.0  # standard deviation of a place that supports a map
_REACH: Final = 37.5  # standard deviation of the neighbourhood that one affine map is fitted to
_NEAR: Final = 37.5  # what is this near to the map is on its side
_TORN_BELOW: Final = 0.9  # share of p near the map from which nothing is weighed
_PLACE: Final = 22.5  # standard deviation of a query's place around the map
_ELSEWHERE: Final = 0.02  # weight of any other place
_TRIES: Final = 300
_ROUNDS: Final = 6
_STRETCH: Final = (0.25, 2.2)  # of the affine maps that are tried
_UNSURE: Final = 0.02  # support of a place that counts half


def grid_of(mask: Mask, points: int = _GRID_POINTS) -> FloatArray:
    """Return points on a mask in rows and columns, float64 (G, 2), its pixels.

    Args:
        mask: bool (h, w).
        points: About how many.
    """
    step = max(1, int(np.sqrt(mask.sum() / points)))
    return pixel_centres(mask, step).astype(np.float64)


@dataclass(frozen=True)
class SideMap:
    """A map of the source into the target, affine around each place.

    Attributes:
        points_px: float64 (G, 2), of the source, in pixels of the network.
        places_px: float64 (G, 2), where p has them, near the map.
        weights: float64 (G,), how much of it.
        unit: Pixels of the network per pixel of one 240 wide.
    """

    points_px: FloatArray
    places_px: FloatArray
    weights: FloatArray
    unit: float

    def at(self, uv_px: FloatArray) -> FloatArray:
        """Return where the map takes pixels of the source, float64 (N, 2).

        Args:
            uv_px: float64 (N, 2).
        """
        apart = self.points_px - uv_px[:, None]  # (N, G, 2)
        reach = self.unit * _REACH
        near = np.exp(-np.square(apart).sum(axis=2) / (2 * reach**2)) * self.weights + 1e-9
        design = _with_one(apart)
        weighed = (near[..., None] * design).transpose(0, 2, 1)  # (N, 3, G)
        normal = weighed @ design + np.eye(3) * [1e-6, 1e-6, 0.0]
        return np.linalg.solve(normal, weighed @ self.places_px)[:, 2]

    def log_weight(self, uv_px: FloatArray, candidates_px: torch.Tensor) -> torch.Tensor:
        """Return the logarithm of each candidate's weight for each query, float32 (N, M).

        Args:
            uv_px: float64 (N, 2), queries in the source.
            candidates_px: float32 (M, 2), places in the target.
        """
        expected = torch.from_numpy(self.at(uv_px)).float()
        gap = torch.cdist(expected, candidates_px) / (self.unit * _PLACE)
        return ((-gap.square() / 2).exp() + _ELSEWHERE).log()


def side_of(
    points_px: FloatArray, log_p: torch.Tensor, candidates_px: torch.Tensor, width: int
) -> SideMap | None:
    """Return the map that most of p agrees with, or None where the network is not torn.

    Args:
        points_px: float64 (G, 2), of the source, in pixels of the network.
        log_p: float32 (G, M), where they are in the target.
        candidates_px: float32 (M, 2), in pixels of the network.
        width: Of the network's images.
    """
    if len(points_px) < 3:
        return None
    unit = width / _WIDTH
    modes, used = mixture_of_modes(log_p, candidates_px, Widths(1.0), unit * _MODE_RADIUS)
    places = modes[..., :2].double().numpy()  # (G, K, 2)
    share = (modes[..., 3] * used).double().numpy()  # (G, K)
    affine = _consensus(points_px, places, share, unit)
    if affine is None:
        return None
    expected = _with_one(points_px) @ affine
    for _ in range(_ROUNDS):
        near = _support(places, share, expected, unit)
        total = near.sum(axis=1)
        mean = (near[..., None] * places).sum(axis=1) / np.maximum(total, 1e-12)[:, None]
        found = SideMap(points_px, mean, total / (total + _UNSURE), unit)
        expected = found.at(points_px)
    gap = np.linalg.norm(places - expected[:, None], axis=2)
    agreed = (share * (gap < unit * _NEAR)).sum() / len(points_px)
    return found if agreed < _TORN_BELOW else None


def _with_one(points_px: FloatArray) -> FloatArray:
    return np.concatenate([points_px, np.ones_like(points_px[..., :1])], axis=-1)


def _consensus(
    points_px: FloatArray, places: FloatArray, share: FloatArray, unit: float
) -> FloatArray | None:
    """Return the affine map with the largest support, float64 (3, 2), or None if none is possible.

    Each is of three points, to one mode of each, drawn by its share; no draw depends on anything
    but the number of points.
    """
    random = np.random.default_rng(0)
    chosen = random.random((_TRIES, len(points_px))).argpartition(2, axis=1)[:, :3]
    reached = share.cumsum(axis=1)[chosen]  # (T, 3, K)
    drawn = random.random((_TRIES, 3, 1)) * reached[..., -1:]
    mode = (drawn > reached).sum(axis=2).clip(max=share.shape[1] - 1)
    corners = _with_one(points_px[chosen])  # (T, 3, 3)
    area = np.abs(np.linalg.det(corners))
    wide = area >= max(float(np.median(area)) / 2, 1e-9)
    maps = np.linalg.solve(corners[wide], places[chosen, mode][wide])  # (t, 3, 2)
    stretch = np.linalg.svd(maps[:, :2], compute_uv=False)
    maps = maps[(stretch[:, 1] > _STRETCH[0]) & (stretch[:, 0] < _STRETCH[1])]
    if len(maps) == 0:
        return None
    expected = _with_one(points_px) @ maps  # (t, G, 2)
    support = _support(places, share, expected, unit).sum(axis=(1, 2))
    best: FloatArray = maps[support.argmax()]
    return best


def _support(
    places: FloatArray, share: FloatArray, expected: FloatArray, unit: float
) -> FloatArray:
    """Return how much of p at each mode agrees with maps, float64 (..., G, K).

    Args:
        places: float64 (G, K, 2), the modes.
        share: float64 (G, K), how much of p each has.
        expected: float64 (..., G, 2), where the maps take the points.
        unit: Pixels of the network per pixel of one 240 wide.
    """
    squares = np.square(places - expected[..., None, :]).sum(axis=-1)
    return np.asarray(share * np.exp(-squares / (2 * (unit * _AGREES) ** 2)))
