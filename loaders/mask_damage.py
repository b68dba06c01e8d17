"""Faults of the masks that a network is given in training; the masks of the losses stay exact.

`faulty` is what a good segmenter does wrong, `damaged` what a bad one does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.spec.arrays import Mask

Masks = tuple[Mask, Mask]
"""The queried object's mask and the mask of all objects, bool (h, w) each."""

_LEAST_LEFT: Final = 0.2
"""A fault that leaves less of the queried object's pixels is not applied."""

_MOST_HOLES: Final = 4
_HOLE_SHARE: Final = 0.04
"""Largest radius of a hole, as a share of the image's height."""

_RAGGED_SHARE: Final = (0.003, 0.012)
"""Displacement of a ragged contour, standard deviation as a share of the image's height."""

_RAGGED_CELL: Final = (0.01, 0.06)
"""Size of its teeth, as a share of the image's height."""

_END_SHARE: Final = (0.03, 0.15)
"""Radius around an end within which the mask is missing, as a share of the image's height."""

_DAMAGE_HOLES: Final = 8


def faulty(rng: np.random.Generator, mask: Mask, objects: Mask) -> Masks:
    """Return both masks eroded by a pixel, dilated by one, or with holes.

    Args:
        rng: Source of randomness.
        mask: bool (h, w), the queried object.
        objects: bool (h, w), all objects.
    """
    fault = rng.integers(3)
    if fault == 2:
        free = ~_discs(rng, mask.shape, _MOST_HOLES)
        return mask & free, objects & free
    changed = (~_grown(~mask), ~_grown(~objects)) if fault == 0 else (_grown(mask), _grown(objects))
    # Erosion must not delete an object that is thinner than three pixels.
    return _kept(changed, mask, objects)


def _grown(mask: Mask) -> Mask:
    """Return a mask and all pixels next to it: bool (h, w)."""
    padded = np.pad(mask, 1)
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    return rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]


def damaged(rng: np.random.Generator, mask: Mask, objects: Mask) -> Masks:
    """Return both masks with one or two kinds of heavy damage.

    The kinds are a ragged contour, holes in the object, a second object in the mask, missing ends
    or corners, and other objects (a rope's ball) in the queried object's mask.

    Args:
        rng: Source of randomness.
        mask: bool (h, w), the queried object.
        objects: bool (h, w), all objects.
    """
    damage = mask, objects
    if not mask.any():
        return damage
    kinds = rng.choice(len(_DAMAGES), size=rng.integers(1, 3), replace=False)
    for kind in kinds:
        damage = _kept(_DAMAGES[kind](rng, *damage), *damage)
    return damage


def _kept(changed: Masks, mask: Mask, objects: Mask) -> Masks:
    """Return the changed masks where enough of the queried object is left, else the others."""
    return changed if changed[0].sum() > _LEAST_LEFT * mask.sum() else (mask, objects)


def _ragged(rng: np.random.Generator, mask: Mask, objects: Mask) -> Masks:
    """Displace the pixels of both masks by smooth noise: thin objects fray but stay connected."""
    height, width = mask.shape
    cell = max(1.0, rng.uniform(*_RAGGED_CELL) * height)
    coarse = (max(1, round(height / cell)), max(1, round(width / cell)))
    sigma_px = rng.uniform(*_RAGGED_SHARE) * height
    places = []
    for axis, size in enumerate((height, width)):
        noise = Image.fromarray(rng.normal(0, sigma_px, coarse).astype(np.float32))
        shift = np.asarray(noise.resize((width, height), Image.Resampling.BICUBIC))
        own = np.indices((height, width), sparse=True)[axis]
        places.append((own + shift).round().astype(np.intp).clip(0, size - 1))
    row, column = places
    return mask[row, column], objects[row, column]


def _pierced(rng: np.random.Generator, mask: Mask, objects: Mask) -> Masks:
    free = ~_discs(rng, mask.shape, _DAMAGE_HOLES, on=mask)
    return mask & free, objects & free


def _with_second(rng: np.random.Generator, mask: Mask, objects: Mask) -> Masks:
    """Add a mirrored and shifted copy of the queried object, or a part of it, to both masks."""
    mirrored = [axis for axis in (0, 1) if rng.random() < 0.5]
    shift = [round(rng.uniform(-0.5, 0.5) * size) for size in mask.shape]
    second = np.roll(np.flip(mask, mirrored), shift, (0, 1))
    if rng.random() < 0.5:
        row, column = (rng.uniform(0.2, 0.8) * size for size in mask.shape)
        angle = rng.uniform(-np.pi, np.pi)
        rows, columns = np.indices(mask.shape, sparse=True)
        second = second & ((rows - row) * np.sin(angle) + (columns - column) * np.cos(angle) > 0)
    return mask | second, objects | second


def _without_ends(rng: np.random.Generator, mask: Mask, objects: Mask) -> Masks:
    """Remove what is near one or two of the pixels that are farthest out in some direction."""
    at = np.argwhere(mask)
    free = np.ones(mask.shape, dtype=np.bool_)
    for _ in range(rng.integers(1, 3)):
        direction = rng.normal(size=2)
        end = at[(at @ direction).argmax()]
        free &= ~_disc(mask.shape, end, rng.uniform(*_END_SHARE) * mask.shape[0])
    return mask & free, objects & free


def _with_others(rng: np.random.Generator, mask: Mask, objects: Mask) -> Masks:
    del rng
    return mask | objects, objects


_DAMAGES: Final[tuple[Callable[[np.random.Generator, Mask, Mask], Masks], ...]] = (
    _ragged,
    _pierced,
    _with_second,
    _without_ends,
    _with_others,
)


def _discs(
    rng: np.random.Generator, shape: tuple[int, ...], most: int, on: Mask | None = None
) -> Mask:
    """Return one to `most` discs anywhere, or around pixels of a mask: bool (h, w)."""
    discs = np.zeros(shape, dtype=np.bool_)
    centres = None if on is None else np.argwhere(on)
    for _ in range(int(rng.integers(1, most + 1))):
        centre: npt.NDArray[Any]
        if centres is None:
            centre = np.array([rng.uniform(0, shape[0]), rng.uniform(0, shape[1])])
        else:
            centre = centres[rng.integers(len(centres))]
        discs |= _disc(shape, centre, rng.uniform(1.0, max(1.0, _HOLE_SHARE * shape[0])))
    return discs


def _disc(shape: tuple[int, ...], centre: npt.NDArray[Any], radius: float) -> Mask:
    rows, columns = np.indices(shape, sparse=True)
    near: Mask = (rows - centre[0]) ** 2 + (columns - centre[1]) ** 2 <= radius**2
    return near
