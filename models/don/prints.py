"""How a square cloth is turned: upright for the network, and by the print where it has one.

A blank square looks alike from four sides. A network of blank cloths learns to distinguish them by
the orientation in the picture. A rotated cloth is first set upright: by the angle of its outline
or, if that is ambiguous, by the confidence of the network. After a rotation by more than in the
training data, the four sides cannot be distinguished, so the other quarter turns of the source are
answered too.

On a cloth with a print they can be distinguished without knowing the print: under the right quarter
turn, the colours at matched places go together. What counts is the share of the variance of one
picture's colours that a linear map of the other's explains, added up both ways, so that another
light, or the same print in other colours, does not matter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from pliant.baselines.outline import angle_from_upright
from pliant.baselines.tracing import Reframed
from pliant.models.don.described import ViewDescriber
from pliant.models.don.sides import grid_of
from pliant.spec.answers import Answers
from pliant.spec.arrays import FloatArray, Mask, RealArray
from pliant.spec.frame import Frame, Pair
from pliant.spec.io.resizing import resize_rgb

_LEAST_GAIN: Final = 0.15
"""Agreement by which a quarter turn must exceed the others. With blank cloths it is 0.09."""

_POINTS: Final = 200


def turned_by_print(
    source: Reframed, target: Reframed, views: ViewDescriber, matched: Callable[[Pair], FloatArray]
) -> Reframed:
    """Return the source turned so that its print agrees with the target's.

    If either picture has no print or no mask, or if no turn is clearly better than the others, the
    source is returned unchanged.

    Args:
        source: The view that the queries are in.
        target: The view to find them in.
        views: The views as the network sees them.
        matched: Where the queries of a pair are in its target, float64 (N, 2), by the network.
    """
    seen, there = (views.described(each.view) for each in (source, target))
    if seen.mask is None or not (seen.printed and there.printed):
        return source
    colours, others = (_colours(each.view, views) for each in (source, target))
    points = grid_of(seen.mask, _POINTS)
    read = _read(colours, points)
    in_view = (points * views.pixel_scale(source.view)).astype(np.float32)
    original = source.back(Answers(in_view)).uv_px
    ways = [source, *other_quarter_turns(source, seen.mask)]
    agreement = []
    for way in ways:
        places = matched(Pair(way.view, target.view, way.forward(original)))
        there_read = _read(others, places / views.pixel_scale(target.view))
        agreement.append(_explained(read, there_read) + _explained(there_read, read))
    best, second = np.argsort(agreement)[[-1, -2]]
    if agreement[best] < agreement[second] + _LEAST_GAIN:
        return source
    return replace(ways[best], settled=True, segmented=source.segmented)


def _colours(view: Frame, views: ViewDescriber) -> FloatArray:
    """Return a picture at the network's size, float64 (h, w, 3)."""
    return resize_rgb(view.rgb, views.size).astype(np.float64)


def _read(colours: FloatArray, places: RealArray) -> FloatArray:
    """Return the colours at pixels of the network, float64 (N, 3)."""
    height, width = colours.shape[:2]
    column, row = np.floor(places).astype(np.int64).T
    return colours[row.clip(0, height - 1), column.clip(0, width - 1)]


def _explained(by: FloatArray, what: FloatArray) -> float:
    by, what = by - by.mean(axis=0), what - what.mean(axis=0)
    left = what - by @ np.linalg.lstsq(by, what, rcond=1e-3)[0]
    return 1.0 - float(np.square(left).sum() / max(np.square(what).sum(), 1e-12))


_UPRIGHT_RAD: Final = np.deg2rad(32)
"""Cloths in training are turned by less: 20 degrees on the table, 12 by the camera."""

_TRIED_RAD: Final = (-np.pi / 6, np.pi / 6)
"""Turns that are tried where the outline says nothing."""

_LEAST_CONFIDENCE_GAIN: Final = 0.06
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
    turns, least_gain = (
        (_TRIED_RAD, _LEAST_CONFIDENCE_GAIN) if angle_rad is None else ((-angle_rad,), 0.0)
    )
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
