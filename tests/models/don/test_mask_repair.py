"""Given masks of a rope, checked against its picture."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.conditions import segmented
from pliant.baselines.tracing import MaskShape
from pliant.models.don.mask_repair import repaired
from pliant.spec.arrays import Mask
from pliant.spec.frame import Frame
from tests.models.don.test_segmentation import HALF_PX, masks_in, overlap, scene, vague

Masks = tuple[Mask, Mask | None]


@pytest.fixture(scope="module")
def shown() -> tuple[Mask, Mask, Mask, Masks]:
    """A rope, its ball and its shadow, and the masks that the picture shows of the first two."""
    rgb, rope, ball, shadow = scene()
    return rope, ball, shadow, masks_in(rgb, vague(rope, ball))


@pytest.fixture(scope="module")
def rope(shown: tuple[Mask, Mask, Mask, Masks]) -> Mask:
    return shown[0]


@pytest.fixture(scope="module")
def ball(shown: tuple[Mask, Mask, Mask, Masks]) -> Mask:
    return shown[1]


@pytest.fixture(scope="module")
def found(shown: tuple[Mask, Mask, Mask, Masks]) -> Masks:
    return shown[3]


def corrected(mask: Mask, objects: Mask, found: Masks) -> tuple[Mask, Mask]:
    masks = repaired(mask, objects, found)
    assert masks is not None
    assert masks[1] is not None
    return masks[0], masks[1]


def damaged(rope: Mask, ball: Mask, number: int = 0) -> tuple[Mask, Mask]:
    """Return both masks as a segmenter might give them."""
    view = Frame(scene()[0], mask=rope, objects=rope | ball, key=f"s/{number}")
    given = segmented(view)
    assert given.mask is not None
    assert given.objects is not None
    return given.mask, given.objects


def test_exact_masks_are_kept_also_where_the_picture_misleads(
    rope: Mask, ball: Mask, found: Masks
) -> None:
    assert repaired(rope, rope | ball, found) is None
    assert repaired(rope, None, (found[0], None)) is None


@pytest.mark.parametrize("with_ball", [False, True])
def test_the_ball_of_a_mask_of_all_or_of_the_rope_alone_is_the_one_in_the_picture(
    rope: Mask, ball: Mask, found: Masks, with_ball: bool
) -> None:
    masks = repaired(rope | ball if with_ball else rope, None, found)
    assert masks is not None
    assert masks[1] is not None
    assert overlap(masks[0], rope) > 0.97
    assert overlap(masks[1] & ~masks[0], ball) > 0.85
    away = np.roll(found[1] & ~found[0], -60, axis=0) if found[1] is not None else ball
    assert not (away & rope).any()
    assert repaired(rope, None, (found[0] & ~away, found[0] | away)) is None, "it is another object"
    half = found[0].copy()
    half[:, : half.shape[1] // 2] = False
    assert repaired(rope, rope | ball, (half, half | ball)) is None


def test_a_rope_cut_by_holes_is_made_whole(rope: Mask, ball: Mask, found: Masks) -> None:
    cut = rope.copy()
    cut[:, 300:312] = False  # a rope of even width, in two parts
    whole, _ = corrected(cut, cut | ball, found)
    assert (whole & rope).sum() > 0.96 * rope.sum()


def test_a_segmenters_masks_are_corrected(rope: Mask, ball: Mask) -> None:
    rgb, _, _, shadow = scene()
    found = masks_in(rgb, vague(rope, ball | shadow))
    for number in range(3):
        given, given_objects = damaged(rope, ball, number)
        mask, objects = corrected(given, given_objects, found)
        assert overlap(mask, rope) > overlap(given, rope)
        assert (mask & rope).sum() > 0.96 * rope.sum()  # holes are filled, the end is back
        as_given = overlap(given_objects & ~given, ball)
        assert abs(overlap(objects & ~mask, ball) - as_given) < 0.02  # the ball is as it was given


def test_a_ball_that_the_picture_shows_elsewhere_is_no_rope(rope: Mask, ball: Mask) -> None:
    """The ball found in the picture is 12 px away from the given one; its pixels are not rope."""
    given, objects = damaged(rope, ball)
    beside = np.roll(ball, (-12, 0), axis=(0, 1)) & ~rope
    mask, _ = corrected(given, objects, (rope, rope | beside))
    assert not (mask & beside & ~given).any()


def test_a_second_rope_in_the_mask_goes(rope: Mask, ball: Mask, found: Masks) -> None:
    other = np.zeros_like(rope)
    other[30:50, 60:580] = True
    mask, objects = corrected(rope | other, rope | other | ball, found)
    assert not (objects & other).any()
    assert overlap(mask, rope) > 0.85


def test_a_loop_that_the_picture_does_not_show_goes(rope: Mask, ball: Mask, found: Masks) -> None:
    rows, columns = np.mgrid[: rope.shape[0], : rope.shape[1]]
    row, column = np.argwhere(rope)[len(np.argwhere(rope)) // 2]
    ring = np.abs(np.hypot(rows - row - 75, columns - column) - 75) <= HALF_PX
    given = (rope | ring) & ~ball
    assert not MaskShape.of(given, given | ball).several_ropes  # the shape alone does not tell
    assert overlap(corrected(given, given | ball, found)[0], rope) > 0.8


def test_lengths_scale_with_the_picture(rope: Mask, ball: Mask, found: Masks) -> None:
    def doubled(mask: Mask) -> Mask:
        return mask.repeat(2, 0).repeat(2, 1)

    given, objects = damaged(rope, ball)
    assert found[1] is not None
    large = doubled(found[0]), doubled(found[1])
    once = doubled(corrected(given, objects, found)[0])
    twice, _ = corrected(doubled(given), doubled(objects), large)
    assert overlap(once, twice) > 0.95
    assert repaired(doubled(rope), doubled(rope | ball), large) is None
