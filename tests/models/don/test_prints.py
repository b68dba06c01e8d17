"""Printed cloths that are turned by quarter turns, which a blank square does not show."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from pliant.models.don.matcher import DonMatcher
from pliant.spec.frame import Frame, Pair
from tests.known import known
from tests.models.shipped_models import shipped_don


@pytest.fixture(scope="module")
def matcher() -> DonMatcher:
    return shipped_don("don-cloth")


def turned(pair: Pair, quarters: int) -> Pair:
    """The source about the middle of its frame, counter-clockwise; the queries with it."""
    frame = pair.source
    middle = np.array(frame.size) / 2

    def moved(values: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(Image.fromarray(values).rotate(90 * quarters))

    mask = moved(known(frame.mask))
    assert mask.sum() == known(frame.mask).sum()
    away = pair.uv_a_px - middle
    for _ in range(quarters):
        away = np.column_stack([away[:, 1], -away[:, 0]])
    source = Frame(moved(frame.rgb), mask)
    return Pair(source, pair.target, (away + middle).astype(np.float32))


@pytest.mark.parametrize(
    "quarters", [1, *(pytest.param(more, marks=pytest.mark.long) for more in (2, 3))]
)
def test_the_print_says_how_a_cloth_is_turned(
    matcher: DonMatcher, printed: list[Pair], quarters: int
) -> None:
    for pair in printed:
        upright = matcher.answer(pair).uv_px
        moved = matcher.answer(turned(pair, quarters)).uv_px
        assert np.median(np.linalg.norm(moved - upright, axis=1)) < 12


def test_a_blank_cloth_stays_as_it_is_and_a_print_is_settled(
    matcher: DonMatcher, printed: list[Pair], blank_cloths: list[Pair]
) -> None:
    for settled, asked in ((True, printed), (False, blank_cloths)):
        for pair in asked:
            assert (
                matcher._decided(pair.source, pair.target, pair.uv_a_px).source.settled == settled
            )
