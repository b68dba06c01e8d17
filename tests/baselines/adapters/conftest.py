"""A card before and after a motion, with the queries and their truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from pliant.baselines import Frame
from pliant.spec.arrays import FloatArray
from pliant.spec.frame import Pair

Place = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Motion:
    """A rendered pair and the exact motion: pixel of the source -> pixel of the target."""

    source: Frame
    target: Frame
    queries: npt.NDArray[np.float32]
    before: Any
    after: Any

    @property
    def pair(self) -> Pair:
        return Pair(self.source, self.target, self.queries)

    def move(self, uv_px: npt.NDArray[Any]) -> FloatArray:
        moved: FloatArray = self.after.place(self.before.locate(uv_px))
        return moved

    def error(self, found: npt.NDArray[np.float32]) -> FloatArray:
        errors: FloatArray = np.linalg.norm(found - self.move(self.queries), axis=1)
        return errors


@pytest.fixture
def motion(pose: Any, view_of: Callable[..., Frame], card_queries: FloatArray) -> Motion:
    before, after = pose(), pose(angle_deg=25, scale=0.9, centre=(122.3, 97.6))
    queries = before.place(card_queries).astype(np.float32)
    return Motion(view_of(before, "before"), view_of(after, "after"), queries, before, after)


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
