"""Prints on cloths: designs by number, whose shapes are elsewhere than their mirror images."""

from __future__ import annotations

from typing import Final

import numpy as np

from pliant.spec.arrays import BoolArray, FloatArray

_SHAPES: Final = (4, 12)
_SIZE: Final = (0.03, 0.2)
"""Fewest and most shapes of a print, and their smallest and largest half width, in sides."""

_HEM: Final = (0.015, 0.04)
_STITCH: Final = 90.0  # stitches along a side
_TAG: Final = (0.06, 0.035)  # half its length and half its width


def printed(ground: FloatArray, colours: tuple[FloatArray, FloatArray], design: int) -> FloatArray:
    """Return a print: stripes or checks on some, discs, bars and rings, a stitched hem, a tag.

    Args:
        ground: float64 (h, w, 3), what it is printed on; row k is v = (k + 0.5) / h, column k
            is u = (k + 0.5) / w.
        colours: float64 (3,) each, two colours other than the ground's.
        design: Number of the design; the same one has the same shapes in every colour.
    """
    rng = np.random.default_rng([0x7072696E74, design])
    height, width = ground.shape[:2]
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    second, third = colours
    out = ground.copy()
    _mix(out, _regular(rng, u, v), second, rng.uniform(0.3, 0.8))
    for number in range(int(rng.integers(_SHAPES[0], _SHAPES[1] + 1))):
        _mix(out, _shape(rng, u, v), third if number % 2 else second, 1.0)
    if rng.random() < 0.7:
        _hem(rng, out, u, v, second)
    if rng.random() < 0.7:
        place = rng.uniform(0.1, 0.9), rng.uniform(0.05, 0.1)
        tag = (np.abs(u - place[0]) < _TAG[0]) & (np.abs(v - place[1]) < _TAG[1])
        _mix(out, tag, third, 1.0)
    return out


def _mix(out: FloatArray, where: BoolArray, colour: FloatArray, share: float) -> None:
    """Put a share of a colour onto places of an image."""
    out[where] += share * (colour - out[where])


def _regular(rng: np.random.Generator, u: FloatArray, v: FloatArray) -> BoolArray:
    """Draw stripes along either side, checks, or nothing regular."""
    kind = rng.integers(5)
    periods, filled = rng.uniform(4, 14, 2), rng.uniform(0.2, 0.6)
    across, along = (u * periods[0]) % 1 < filled, (v * periods[1]) % 1 < filled
    stripes: tuple[BoolArray, ...] = (across, along, across ^ along)
    return stripes[kind] if kind < len(stripes) else np.zeros(u.shape, np.bool_)


def _shape(rng: np.random.Generator, u: FloatArray, v: FloatArray) -> BoolArray:
    """Draw a disc, a ring or a bar somewhere on the cloth."""
    kind = rng.integers(3)
    middle, size = rng.uniform(0.08, 0.92, 2), rng.uniform(*_SIZE)
    angle, slim = rng.uniform(-np.pi, np.pi), rng.uniform(0.15, 0.6)
    x, y = u - middle[0], v - middle[1]
    radius = np.hypot(x, y)
    if kind == 0:
        return np.asarray(radius < size)
    if kind == 1:
        return np.asarray((radius < size) & (radius > size * (1 - slim)))
    along = x * np.cos(angle) + y * np.sin(angle)
    across = y * np.cos(angle) - x * np.sin(angle)
    return np.asarray((np.abs(along) < size) & (np.abs(across) < size * slim))


def _hem(
    rng: np.random.Generator, out: FloatArray, u: FloatArray, v: FloatArray, thread: FloatArray
) -> None:
    """Draw a hem, a little darker, with a line of stitches along its inner edge."""
    wide = rng.uniform(*_HEM)
    inside = 0.5 - np.maximum(np.abs(u - 0.5), np.abs(v - 0.5))  # from the nearest edge
    out[inside < wide] *= 0.85
    along = np.where(np.abs(u - 0.5) > np.abs(v - 0.5), v, u)
    stitch = (np.abs(inside - wide) < 0.004) & ((along * _STITCH) % 1 < 0.6)
    _mix(out, stitch, thread, 1.0)
