"""Values of pixels at another size, where a mean of two of them would be wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def resize_nearest(values: npt.NDArray[Any], size: tuple[int, int]) -> npt.NDArray[Any]:
    """Return values at another size: those under each new pixel's centre.

    Masks, ids and depths are never averaged: a mean of two surfaces is on neither.

    Args:
        values: (H, W, ...), of any dtype.
        size: (w, h).

    Returns:
        (h, w, ...), the same dtype.
    """
    height, width = values.shape[:2]
    if (width, height) == size:
        return values
    columns = ((np.arange(size[0]) + 0.5) * width / size[0]).astype(np.intp)
    rows = ((np.arange(size[1]) + 0.5) * height / size[1]).astype(np.intp)
    return values[np.ix_(rows, columns)]
