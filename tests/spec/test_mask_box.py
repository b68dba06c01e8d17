"""The rectangle around a mask."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.spec.mask_box import mask_box

_PIXELS = [(3, 2), (5, 7)]


@pytest.mark.parametrize(
    ("margin_px", "rows", "columns"),
    [(0, range(3, 6), range(2, 8)), (1, range(2, 7), range(1, 9)), (9, range(8), range(10))],
)
def test_box(margin_px: int, rows: range, columns: range) -> None:
    mask = np.zeros((8, 10), dtype=np.bool_)
    mask[tuple(zip(*_PIXELS, strict=True))] = True
    found_rows, found_columns = mask_box(mask, margin_px)
    assert range(8)[found_rows] == rows
    assert range(10)[found_columns] == columns


def test_empty_mask() -> None:
    mask = np.zeros((8, 10), dtype=np.bool_)
    assert mask[mask_box(mask, 2)].shape == (0, 0)
