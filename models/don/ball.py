"""The ball at a rope's first end, in a mask that covers both or lacks it.

A ball is thicker than the rope, but so are crossings and knots; and a ball of the table's colour is
missing from the mask, and something may cover the rope next to it. So every thick place and every
end of the mask is a candidate, and every circle that edges of the picture form; a small network
says of each, from the picture and the mask around it, whether a ball is there, and where and how
large it is. Where the mask covers the likeliest one, it is cut out of it; otherwise a disc is drawn
where the network sees it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import torch
from scipy import ndimage
from torch import nn

from pliant.baselines.tracing.mask_shape import depth_in_mask, farthest_pixels, ridge
from pliant.models.networks.patches import judging_layers, normalised, patches
from pliant.spec.arrays import Float32Array, FloatArray, IntArray, Mask, RealArray
from pliant.spec.ball import thick_places

REACH: Final = 8.0
"""Half the side of a patch, in half widths of the rope."""

_USUAL_RADIUS: Final = 3.0  # of a ball, in half widths of the rope


def ball_patches(
    picture: Float32Array,
    objects: Mask,
    place_px: FloatArray,
    directions: FloatArray,
    half_px: float,
) -> torch.Tensor:
    """Sample the surroundings of places where a ball may be.

    Args:
        picture: float32 (H, W, 3), colours from 0 to 1.
        objects: bool (H, W), where the rope or its ball is seen.
        place_px: float64 (N, 2).
        directions: float64 (N, 2), unit vectors out of the rope.
        half_px: Half the rope's width.

    Returns:
        float32 (N, 4, PATCH, PATCH): colours, and 1 where the mask is set.
    """
    planes = np.concatenate([picture, objects[..., None].astype(np.float32)], axis=2)
    return patches(planes, place_px, directions, np.full(len(place_px), REACH * half_px))


class BallNetwork(nn.Module):
    """Log odds that a ball is at the middle of patches, or just outside of the rope's end there."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = judging_layers(3 + 1, 1 + 3)

    def forward(self, seen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Look at patches by `ball_patches`.

        Returns:
            Log odds, float (N,), and the ball if there is one, float (N, 3): how far its middle is
            ahead and aside of the patch's, and its radius, in half widths of the rope.
        """
        out: torch.Tensor = self.layers(torch.cat([normalised(seen[:, :3]), seen[:, 3:]], dim=1))
        return out[:, 0], torch.cat([out[:, 1:3], _USUAL_RADIUS * out[:, 3:].exp()], dim=1)


_ROUND: Final = 1.45  # area of a ball over that of the largest disc in it
# All in half widths of the rope.
_THICK: Final = 1.15  # a candidate's depth, unless it is an end
_LEAST_DEPTH: Final = 1.5  # of a ball that the mask covers
_NEAR: Final = 1.0  # from such a ball to where the network sees its middle
_AT_END: Final = 4.0  # radius in which the rope's direction at a candidate is measured
_RADII: Final = (1.0, 10.0)  # of circles

_SURE: Final = 1.0  # logarithm of the sum of the candidates' odds; of many it is above 0 by chance

# Of OpenCV's Hough transform, in pixels of a picture 320 pixels wide.
_LEAST_RADIUS_PX: Final = 3
_APART_PX: Final = 6
_CELL_PX: Final = 1.5
_EDGE: Final = 100  # of a gradient; a plane goes from 0 to 255
_LEAST_RANGE: Final = 10.0  # of a plane of CIELAB; a grey picture has noise in two of them
_ROUNDNESS: Final = 0.5


@dataclass(frozen=True)
class BallCandidates:
    """Where the ball of a rope may be.

    Attributes:
        objects: bool (H, W), the mask.
        depth_px: float64 (H, W), distance to its edge.
        half_px: Half of the rope's width.
        place: int64 (N, 2), (row, column).
        outward: float64 (N, 2), unit vectors (row, column) out of the rope; arbitrary where the
            rope continues on both sides.
    """

    objects: Mask
    depth_px: FloatArray
    half_px: float
    place: IntArray
    outward: FloatArray

    @classmethod
    def of(cls, objects: Mask, picture: Float32Array) -> BallCandidates | None:
        """Return the candidates in a picture, or None where its mask shows no rope.

        Args:
            objects: bool (H, W), where the rope or its ball is seen.
            picture: float32 (H, W, 3), colours from 0 to 1.
        """
        depth_px = depth_in_mask(objects, objects.shape[1])
        middle = ridge(depth_px, 1.0)
        if not middle.any():
            return None
        half_px = float(np.median(depth_px[middle]))
        circles = _circles(picture, half_px)
        place = np.array([*thick_places(depth_px, _THICK * half_px), *_ends(objects), *circles])
        rope = np.argwhere(objects)
        out = place - np.array([_middle_near(each, rope, _AT_END * half_px) for each in place])
        length = np.linalg.norm(out, axis=1, keepdims=True)
        outward = np.where(length > 0.5, out / np.maximum(length, 0.5), [0.0, 1.0])
        return cls(objects, depth_px, half_px, place, outward)

    def patches(self, picture: Float32Array) -> torch.Tensor:
        """Return the candidates' surroundings, for a `BallNetwork`.

        Args:
            picture: float32 (H, W, 3), colours from 0 to 1.
        """
        place_px, directions = self.place[:, ::-1] + 0.5, self.outward[:, ::-1]
        return ball_patches(picture, self.objects, place_px, directions, self.half_px)

    def relative_to_candidates(self, ball: Mask) -> FloatArray:
        """Return a ball as a `BallNetwork` puts it, seen from every candidate.

        Args:
            ball: bool (H, W), not empty.

        Returns:
            float64 (N, 3): how far its middle is ahead and aside, and its radius, half widths.
        """
        apart = np.argwhere(ball).mean(axis=0) - self.place
        ahead = (apart * self.outward).sum(axis=1)
        aside = apart[:, 0] * self.outward[:, 1] - apart[:, 1] * self.outward[:, 0]
        radius_px = np.full(len(apart), np.sqrt(ball.sum() / np.pi))
        return np.asarray(np.stack([ahead, aside, radius_px], axis=1) / self.half_px)

    def ball(self, number: int, ahead: float, aside: float, radius: float) -> Mask:
        """Return the ball that is seen from a candidate: a part of the mask, or a disc.

        Args:
            number: The candidate.
            ahead: How far the ball's middle is out of the rope, half widths.
            aside: How far it is to the right of that, half widths.
            radius: Of the ball, half widths.

        Returns:
            bool (H, W).
        """
        way = self.outward[number]
        right = np.array([way[1], -way[0]])
        middle = self.place[number] + self.half_px * (ahead * way + aside * right)
        apart_px = distances_px(middle, self.objects.shape)
        least_px = _LEAST_DEPTH * self.half_px
        cores, _ = ndimage.label(self.depth_px > least_px)
        to_core_px = np.where(cores > 0, apart_px, np.inf)
        disc = np.asarray(apart_px <= radius * self.half_px)
        if to_core_px.min() > _NEAR * self.half_px:
            return disc
        core = cores == cores.flat[to_core_px.argmin()]
        part = self.objects & (ndimage.distance_transform_edt(~core) <= least_px + 0.5)
        return part if is_round(part) else disc  # next to thin cables, a whole rope is thick


def ball_in(picture: Float32Array, objects: Mask, network: BallNetwork) -> Mask:
    """Return the ball of a rope, or nothing where the rope seems to have none.

    Args:
        picture: float32 (H, W, 3), colours from 0 to 1.
        objects: bool (H, W), where the rope or its ball is seen.
        network: Trained.

    Returns:
        bool (H, W), a part of `objects`, or a disc.
    """
    candidates = BallCandidates.of(objects, picture)
    if candidates is None:
        return np.zeros_like(objects)
    with torch.inference_mode():
        odds, balls = network(candidates.patches(picture))
    best = int(odds.argmax())
    if float(odds.logsumexp(dim=0)) <= _SURE:
        return np.zeros_like(objects)
    return candidates.ball(best, *balls[best].tolist())


def is_round(mask: Mask) -> bool:
    """Return whether a mask, bool (H, W), is not much more than the largest disc in it."""
    radius = float(ndimage.distance_transform_edt(np.pad(mask, 1)).max())
    return bool(mask.sum() <= _ROUND * np.pi * radius**2)


def distances_px(place: RealArray | IntArray, shape: tuple[int, ...]) -> FloatArray:
    """Return the distance of every pixel to a place (row, column), float64 of a shape (H, W)."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    return np.asarray(np.hypot(rows - place[0], columns - place[1]))


def _middle_near(place: IntArray, rope: IntArray, radius_px: float) -> FloatArray:
    """Return the middle of a rope's pixels (N, 2) within a radius of a place, or of the nearest."""
    away_px = np.hypot(*(rope - place).T)
    return np.asarray(rope[away_px < max(radius_px, away_px.min() + radius_px / 2)].mean(axis=0))


def _circles(picture: Float32Array, half_px: float) -> list[tuple[int, int]]:
    """Return the middles, (row, column), of circles that edges form in any plane of CIELAB.

    Args:
        picture: float32 (H, W, 3), colours from 0 to 1.
        half_px: Half of the rope's width.
    """
    places: list[tuple[int, int]] = []
    least_px, most_px = (max(_LEAST_RADIUS_PX, round(each * half_px)) for each in _RADII)
    for plane in np.moveaxis(cv2.cvtColor(picture, cv2.COLOR_RGB2LAB), 2, 0):
        smooth = cv2.GaussianBlur(plane, (0, 0), 1.0)
        grey = (smooth - smooth.min()) * (255 / max(float(np.ptp(smooth)), _LEAST_RANGE))
        found = cv2.HoughCircles(
            grey.astype(np.uint8),
            cv2.HOUGH_GRADIENT_ALT,
            dp=_CELL_PX,
            minDist=_APART_PX,
            param1=_EDGE,
            param2=_ROUNDNESS,
            minRadius=least_px,
            maxRadius=most_px,
        )
        for column, row in [] if found is None else found[0, :, :2].astype(int).tolist():
            if all(np.hypot(row - r, column - c) >= _APART_PX for r, c in places):
                places.append((row, column))
    return places


def _ends(objects: Mask) -> list[tuple[int, int]]:
    """Return both ends, (row, column), of each connected part."""
    parts, count = ndimage.label(objects, np.ones((3, 3)))
    return [place for part in range(1, count + 1) for place in farthest_pixels(parts == part)]
