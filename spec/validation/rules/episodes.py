"""Whether frames that claim to be an episode follow each other in time.

Between frames in time one small action is done. Points of independent configurations move as far
from one frame to the next as between any two frames, which is about the object's own size.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pliant.spec.validation.rules.correspondences import FrameRows

LARGE_STEP: Final = 0.6
"""Step over the object's radius, from which it is more than one small action."""

SMALL_STEP: Final = 0.1
"""Steps below this are small whatever the others are."""

UNORDERED: Final = 0.75
"""Mean step over the mean distance of other frames: 1 without an order in time."""

MIN_FRAMES: Final = 4
"""From so many frames neighbours are compared with others."""


def unordered(rows: list[FrameRows]) -> str | None:
    """Return why frames cannot be an episode, or None.

    Args:
        rows: The same points of some frames, in the order of the frames.
    """
    from scipy.spatial.distance import pdist

    if len(rows) < 2 or any(not np.array_equal(each.point, rows[0].point) for each in rows):
        return None
    positions = np.array([each.xyz_m for each in rows])  # (F, N, 3)
    radius = float(np.sqrt(positions.var(axis=1).sum(axis=1).mean()))
    first, second = np.triu_indices(len(rows), 1)
    frame = np.array([each.frame for each in rows])
    near = frame[second] - frame[first] == 1
    if not near.any():
        return None
    apart = pdist(positions.reshape(len(rows), -1)) / np.sqrt(positions.shape[1])
    distance = apart / max(radius, 1e-9)  # root mean square over the points, of any two frames
    step = float(np.median(distance[near]))
    ratio = (
        float(distance[near].mean() / max(distance[~near].mean(), 1e-9)) if (~near).any() else 0.0
    )
    mixed = len(rows) >= MIN_FRAMES and step > SMALL_STEP and ratio > UNORDERED
    if step <= LARGE_STEP and not mixed:
        return None
    others = f", {ratio:.2f} of the distance between other frames" if mixed else ""
    return (
        f"from one frame to the next the points move by {step:.2f} of the object's radius{others}: "
        "independent configurations?"
    )
