"""A card before and after a motion, with the queries and their truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from pliant.spec.arrays import FloatArray
from tests.baselines.cards import Motion, Similarity


@pytest.fixture
def motion() -> Motion:
    return Motion(Similarity(), Similarity(angle_deg=25, scale=0.9, centre=(122.3, 97.6)))


def centres(height: int, width: int) -> FloatArray:
    """Centres of a grid's cells over the card's image of 240x200 px, (height, width, 2)."""
    u = (np.arange(width) + 0.5) * (240 / width)
    v = (np.arange(height) + 0.5) * (200 / height)
    return np.stack(np.meshgrid(u, v), axis=-1)


def counted(
    uv_px: npt.NDArray[Any], coordinates: str, size: tuple[int, int] | None
) -> npt.NDArray[Any]:
    """Pixels of the card's image as a function counts them that receives it in another size."""
    width, height = size or (240, 200)
    at = uv_px * [width / 240, height / 200]
    if coordinates == "index":
        return at - 0.5
    return 2 * at / [width, height] - 1 if coordinates == "normalised" else at
