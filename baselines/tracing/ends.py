"""Where a rope ends: at the edge of its mask, or at its ball.

A walk along a mask ends some pixels too early or too late, and everything along the trace is off
by a share of that. The edge of the mask ahead, and the circle about the ball on which the rope
leaves it, are the same places of the rope in every image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.baselines.pixels import lies_on
from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import FloatArray, Mask


@dataclass(frozen=True)
class Ball:
    """A ball in an image.

    Attributes:
        middle_px: float64 (2,).
        radius_px: Of the disc with its area.
    """

    middle_px: FloatArray
    radius_px: float

    @classmethod
    def of_mask(cls, mask: Mask, factor: int) -> Ball:
        """Return the ball that a mask shows.

        Args:
            mask: bool (h, w), not empty.
            factor: Pixels of the image per pixel of the mask.
        """
        rows, columns = np.nonzero(mask)
        middle = np.array([columns.mean(), rows.mean()]) + 0.5
        return cls(middle * factor, float(np.sqrt(len(rows) / np.pi)) * factor)


def from_end_to_end(path: FloatArray, mask: Mask, half_px: float, ball: Ball | None) -> FloatArray:
    """Return a path that begins and ends where the rope does.

    Args:
        path: float64 (N, 2), along the rope.
        mask: bool (H, W), the rope.
        half_px: Half of the rope's width.
        ball: The ball at the path's first end, None for a rope without one.
    """
    path = to_the_edge(path, mask, half_px)
    if ball is None:
        return to_the_edge(path[::-1], mask, half_px)[::-1]
    return _from_ball(path, ball)


def to_the_edge(path: FloatArray, mask: Mask, half_px: float) -> FloatArray:
    """Return a path that ends at the edge of the mask.

    What is outside comes off. Where the mask goes on straight ahead for less than six half
    widths, so does the path; where it goes on longer, it may be another part of the rope.

    Args:
        path: float64 (N, 2).
        mask: bool (H, W).
        half_px: Half of the rope's width.
    """
    within = np.flatnonzero(lies_on(path, mask))
    if len(within) < 2:
        return path
    path = path[: within[-1] + 1]
    behind = np.linalg.norm(path - path[-1], axis=1) >= TRACING.end_back * half_px
    if not behind.any():
        return path
    way = path[-1] - path[np.flatnonzero(behind)[-1]]
    way /= np.linalg.norm(way)
    step_px = TRACING.edge_step_px
    ahead = path[-1] + np.arange(step_px, TRACING.end_reach * half_px, step_px)[:, None] * way
    outside = ~lies_on(ahead, mask)
    return np.vstack([path, ahead[: outside.argmax()]]) if outside.any() else path


def _from_ball(path: FloatArray, ball: Ball) -> FloatArray:
    """Return a path that begins on the circle where the rope leaves its ball, if it begins near."""
    least_px = TRACING.leaves_ball_at * ball.radius_px
    gap = np.linalg.norm(path - ball.middle_px, axis=1)
    first = int((gap > least_px).argmax())
    if not least_px < gap[first] < 2 * ball.radius_px:
        return path
    way = (path[first] - ball.middle_px) / gap[first]
    return np.vstack([ball.middle_px + least_px * way, path[first:]])
