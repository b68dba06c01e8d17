"""Blank square cloths, whose sides look alike: upright for the network, and turned every way.

A network of blank cloths learns that how a cloth is placed in the picture says which side is which.
A cloth that is turned by more than training shows is turned upright first. Nothing then says which
of the four sides was the top one, so the other quarter turns of the source are answered too.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from pliant.baselines.outline import angle_from_upright
from pliant.baselines.tracing import Reframed
from pliant.spec.arrays import Mask

_UPRIGHT_RAD: Final = np.deg2rad(32)
"""Cloths in training are turned by less: 20 degrees on the table, 12 by the camera."""

_MOST_FILL: Final = 0.86
"""Share of the frame's width or height that the generator's objects take at most by default."""


def upright(seen: Reframed, shown: Mask) -> Reframed:
    """Return a view in which a flat cloth is upright; others, and nearly upright ones, stay.

    Args:
        seen: The view.
        shown: bool (h, w), where it shows the cloth, at any resolution.
    """
    angle_rad = angle_from_upright(cv2, shown)
    if angle_rad is None or abs(angle_rad) < _UPRIGHT_RAD:
        return seen
    return seen.turned_by(-angle_rad, shown, _MOST_FILL)


def other_quarter_turns(seen: Reframed, shown: Mask) -> list[Reframed]:
    """Return the view turned by one, two and three quarters; none where it shows no cloth.

    Args:
        seen: The view.
        shown: bool (h, w), where it shows the cloth, at any resolution.
    """
    if not shown.any():
        return []
    return [seen.turned_by(quarter * np.pi / 2, shown, _MOST_FILL) for quarter in (1, 2, 3)]
