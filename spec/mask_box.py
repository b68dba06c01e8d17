"""The part of a picture that a mask takes up."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import Mask


def mask_box(mask: Mask, margin_px: int = 0) -> tuple[slice, slice]:
    """Return the rows and the columns of the smallest rectangle that contains a mask.

    Args:
        mask: bool (H, W).
        margin_px: Pixels that the rectangle is larger on each side, as far as the picture goes.

    Returns:
        Two empty slices for an empty mask.
    """
    rows = np.flatnonzero(mask.any(axis=1))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    columns = np.flatnonzero(mask[rows[0] : rows[-1] + 1].any(axis=0))
    return _span(rows, margin_px), _span(columns, margin_px)


def _span(found: npt.NDArray[np.intp], margin_px: int) -> slice:
    return slice(max(0, int(found[0]) - margin_px), int(found[-1]) + 1 + margin_px)
