"""Poor masks for training: what a segmentation gives is thinner, thicker, holed or missing."""

from __future__ import annotations

from typing import Final

import numpy as np
from PIL import Image, ImageFilter

from pliant.loaders.augment import AugmentSettings
from pliant.loaders.views import TrainingFrame
from pliant.spec.arrays import Mask

_MOST_HOLES: Final = 4
_HOLE_SHARE: Final = 0.04
"""Largest radius of a hole, as a share of the image's height."""


def given_masks(
    rng: np.random.Generator, view: TrainingFrame, settings: AugmentSettings
) -> tuple[Mask | None, Mask | None]:
    """Return the masks that the network is given in a training step.

    Args:
        rng: Source of randomness.
        view: The frame with its exact masks.
        settings: How often masks are missing or faulty.

    Returns:
        The queried object's mask and the mask of all objects, bool (h, w) each, or None.
    """
    mask, objects = view.mask, view.objects
    if settings.mask_faults > 0 and rng.random() < settings.mask_faults:
        mask, objects = _faulty(rng, mask, objects)
    if settings.mask_drop > 0:
        draw = rng.random()
        if draw < settings.mask_drop:
            return None, None
        if draw < 2 * settings.mask_drop:
            return mask, None
    return mask, objects


def _faulty(rng: np.random.Generator, mask: Mask, objects: Mask) -> tuple[Mask, Mask]:
    """Return both masks with the same kind of fault."""
    fault = rng.integers(3)
    if fault == 2:
        holes = _holes(rng, mask.shape)
        return mask & ~holes, objects & ~holes
    change = _eroded if fault == 0 else _dilated
    changed, all_changed = change(mask), change(objects)
    # Erosion must not delete an object that is thinner than three pixels.
    return (changed, all_changed) if changed.sum() > 0.2 * mask.sum() else (mask, objects)


def _eroded(mask: Mask) -> Mask:
    return np.asarray(Image.fromarray(mask).convert("L").filter(ImageFilter.MinFilter(3))) > 0


def _dilated(mask: Mask) -> Mask:
    return np.asarray(Image.fromarray(mask).convert("L").filter(ImageFilter.MaxFilter(3))) > 0


def _holes(rng: np.random.Generator, shape: tuple[int, ...]) -> Mask:
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    holes = np.zeros(shape, dtype=np.bool_)
    for _ in range(int(rng.integers(1, _MOST_HOLES + 1))):
        row, column = rng.uniform(0, shape[0]), rng.uniform(0, shape[1])
        radius = rng.uniform(1.0, max(1.0, _HOLE_SHARE * shape[0]))
        holes |= (rows - row) ** 2 + (columns - column) ** 2 <= radius**2
    return holes
