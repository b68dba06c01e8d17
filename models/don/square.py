"""Blank square cloths, whose sides look alike: upright for the network, and turned every way.

A network of blank cloths learns to distinguish the sides by the orientation in the picture. A
rotated cloth is first set upright: by the angle of its outline or, if that is ambiguous, by the
confidence of the network. After a rotation by more than in the training data, the four sides cannot
be distinguished, so the other quarter turns of the source are answered too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from pliant.baselines.outline import angle_from_upright
from pliant.baselines.tracing import Reframed
from pliant.spec.arrays import Mask
from pliant.spec.frame import Frame

_UPRIGHT_RAD: Final = np.deg2rad(32)
"""Cloths in training are turned by less: 20 degrees on the table, 12 by the camera."""

_TRIED_RAD: Final = (-np.pi / 6, np.pi / 6)
"""Turns that are tried where the outline says nothing."""

_LEAST_GAIN: Final = 0.06
"""Of a mean log probability, for such a turn; chosen on scrunched validation cloths."""

_ALIKE: Final = 0.06
"""Two such turns that differ by less are alike: then half of each decides between them."""

_MOST_FILL: Final = 0.86
"""Share of the frame's width or height that the generator's objects take at most by default."""


def upright_turn(seen: Reframed, shown: Mask, confidence: Callable[[Frame], float]) -> float:
    """Return by which angle a view is turned so that a cloth is upright, 0 where it stays.

    The edges of a flat cloth say how it is turned; those of a scrunched one may be folds, so that
    the network has to be as sure of the turned view. Where edges disagree, the network tries.

    Args:
        seen: The view.
        shown: bool (h, w), where it shows the cloth, at any resolution.
        confidence: How sure the network is of what a view shows; see `ViewDescriber`.

    Returns:
        Radians, from right to down.
    """
    angle_rad = angle_from_upright(cv2, shown)
    if not shown.any() or (angle_rad is not None and abs(angle_rad) < _UPRIGHT_RAD):
        return 0.0
    turns, least_gain = (_TRIED_RAD, _LEAST_GAIN) if angle_rad is None else ((-angle_rad,), 0.0)
    sure = np.array([confidence(turned(seen, turn, shown).view) for turn in turns])
    best = int(sure.argmax())
    if len(turns) > 1 and np.ptp(sure) < _ALIKE:
        best = int(np.argmax([confidence(turned(seen, turn / 2, shown).view) for turn in turns]))
    return turns[best] if sure[best] - confidence(seen.view) >= least_gain else 0.0


def turned(seen: Reframed, angle_rad: float, shown: Mask) -> Reframed:
    """Return a view turned about the middle of a cloth, which fits into its frame.

    Only by more than `_UPRIGHT_RAD` does it count as turned: then each side may be the top one.

    Args:
        seen: The view.
        angle_rad: By how much, from right to down; 0 leaves it as it is.
        shown: bool (h, w), not empty unless the angle is 0, where it shows the cloth.
    """
    if not angle_rad:
        return seen
    far = abs(angle_rad) >= _UPRIGHT_RAD
    return replace(seen.turned_by(angle_rad, shown, _MOST_FILL), turned=seen.turned or far)


def other_quarter_turns(seen: Reframed, shown: Mask) -> list[Reframed]:
    """Return the view turned by one, two and three quarters; none where it shows no cloth.

    Args:
        seen: The view.
        shown: bool (h, w), where it shows the cloth, at any resolution.
    """
    if not shown.any():
        return []
    return [turned(seen, quarter * np.pi / 2, shown) for quarter in (1, 2, 3)]
