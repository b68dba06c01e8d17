"""Given masks of a rope, checked against its picture."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.conditions import segmented
from pliant.baselines.tracing import MaskShape
from pliant.models.don.mask_repair import is_surely_unchanged, repaired
from pliant.models.don.segmentation import rope_masks
from pliant.spec.arrays import Mask
from pliant.spec.frame import Frame
from tests.known import known
from tests.models.don.test_segmentation import BALL, HALF_PX, ROPE, SHADOW, overlap, scene, vague

Masks = tuple[Mask, Mask]


@pytest.fixture(scope="module")
def found() -> Masks:
    """The masks that the picture shows of the rope and its ball."""
    rope, objects = known(rope_masks(scene()[0], *vague(ROPE, BALL), None))
    return rope, known(objects)


def corrected(mask: Mask, objects: Mask | None, found: Masks) -> Masks:
    rope, shown = known(repaired(mask, objects, found))
    return rope, known(shown)


def damaged(number: int = 0) -> tuple[Mask, Mask]:
    """Return both masks as a segmenter might give them."""
    view = Frame(scene()[0], mask=ROPE, objects=ROPE | BALL, key=f"s/{number}")
    given = segmented(view)
    return known(given.mask), known(given.objects)


def test_exact_masks_are_kept_also_where_the_picture_misleads(found: Masks) -> None:
    assert repaired(ROPE, ROPE | BALL, found) is None
    assert repaired(ROPE, None, (found[0], None)) is None
    piece = found[0].copy()  # of one rope, but a fourth of the given one
    piece[:, : piece.shape[1] * 3 // 4] = False
    assert not MaskShape.of(piece, None).several_ropes
    assert repaired(ROPE, ROPE | BALL, (piece, None)) is None


def test_only_masks_that_would_be_kept_are_kept_unseen(found: Masks) -> None:
    given, objects = damaged()
    cut = ROPE & ~(np.arange(ROPE.shape[1]) // 12 == 25)
    other = np.zeros_like(ROPE)
    other[30:50, 60:580] = True
    half = found[1] & (np.arange(ROPE.shape[1]) < ROPE.shape[1] // 2)
    assert is_surely_unchanged(ROPE, ROPE | BALL, found[1])
    assert not is_surely_unchanged(given, objects, found[1])  # ragged
    assert not is_surely_unchanged(cut, cut | BALL, found[1])  # in two parts
    assert not is_surely_unchanged(ROPE | other, ROPE | other | BALL, found[1] | other)  # two ropes
    assert not is_surely_unchanged(
        ROPE, ROPE | BALL, half
    )  # another object, or half of it not seen


@pytest.mark.parametrize("with_ball", [False, True])
def test_the_ball_of_a_mask_of_all_or_of_the_rope_alone_is_the_one_in_the_picture(
    found: Masks, with_ball: bool
) -> None:
    rope, objects = corrected(ROPE | BALL if with_ball else ROPE, None, found)
    assert overlap(rope, ROPE) > 0.97
    assert overlap(objects & ~rope, BALL) > 0.85
    away = np.roll(found[1] & ~found[0], -60, axis=0)
    assert not (away & ROPE).any()
    assert repaired(ROPE, None, (found[0] & ~away, found[0] | away)) is None, "it is another object"
    half = found[0].copy()
    half[:, : half.shape[1] // 2] = False
    assert repaired(ROPE, ROPE | BALL, (half, half | BALL)) is None


def test_a_rope_cut_by_holes_is_made_whole(found: Masks) -> None:
    cut = ROPE.copy()
    cut[:, 300:312] = False  # a rope of even width, in two parts
    whole, _ = corrected(cut, cut | BALL, found)
    assert (whole & ROPE).sum() > 0.96 * ROPE.sum()


def test_a_segmenters_masks_are_corrected() -> None:
    rope, shown = known(rope_masks(scene()[0], *vague(ROPE, BALL | SHADOW), None))
    for number in range(3):
        given, given_objects = damaged(number)
        mask, objects = corrected(given, given_objects, (rope, known(shown)))
        assert overlap(mask, ROPE) > overlap(given, ROPE)
        assert (mask & ROPE).sum() > 0.96 * ROPE.sum()  # holes are filled, the end is back
        as_given = overlap(given_objects & ~given, BALL)
        assert abs(overlap(objects & ~mask, BALL) - as_given) < 0.02  # the ball is as it was given


def test_a_ball_that_the_picture_shows_elsewhere_is_no_rope() -> None:
    """The ball found in the picture is 12 px away from the given one; its pixels are not rope."""
    given, objects = damaged()
    beside = np.roll(BALL, (-12, 0), axis=(0, 1)) & ~ROPE
    mask, _ = corrected(given, objects, (ROPE, ROPE | beside))
    assert not (mask & beside & ~given).any()


def test_a_second_rope_in_the_mask_goes(found: Masks) -> None:
    other = np.zeros_like(ROPE)
    other[30:50, 60:580] = True
    mask, objects = corrected(ROPE | other, ROPE | other | BALL, found)
    assert not (objects & other).any()
    assert overlap(mask, ROPE) > 0.85


def test_a_loop_that_the_picture_does_not_show_goes(found: Masks) -> None:
    rows, columns = np.mgrid[: ROPE.shape[0], : ROPE.shape[1]]
    row, column = np.argwhere(ROPE)[len(np.argwhere(ROPE)) // 2]
    ring = np.abs(np.hypot(rows - row - 75, columns - column) - 75) <= HALF_PX
    given = (ROPE | ring) & ~BALL
    assert not MaskShape.of(given, given | BALL).several_ropes  # the shape alone does not tell
    assert overlap(corrected(given, given | BALL, found)[0], ROPE) > 0.8


def test_lengths_scale_with_the_picture(found: Masks) -> None:
    def doubled(mask: Mask) -> Mask:
        return mask.repeat(2, 0).repeat(2, 1)

    given, objects = damaged()
    large = doubled(found[0]), doubled(found[1])
    once = doubled(corrected(given, objects, found)[0])
    twice, _ = corrected(doubled(given), doubled(objects), large)
    assert overlap(once, twice) > 0.95
    assert repaired(doubled(ROPE), doubled(ROPE | BALL), large) is None


def strip(half_px: np.ndarray) -> Mask:
    """Return a level strip of a half width at each of its columns."""
    mask = np.zeros((480, 640), dtype=np.bool_)
    rows = np.arange(480)[:, None] + 0.5
    mask[:, 60:580] = np.abs(rows - 240.0) < half_px
    return mask


@pytest.mark.parametrize(
    "half_px",
    [np.linspace(4, 12, 520), 14 + np.sin(np.arange(520) / 10)],
    ids=["seen obliquely", "thick and laid"],
)
def test_an_exact_mask_is_kept_where_the_one_in_the_picture_is_fringed(half_px: np.ndarray) -> None:
    exact = strip(half_px)
    fringed = strip(half_px + 3.5)
    assert repaired(exact, exact, (fringed, None)) is None
    given = segmented(Frame(np.zeros((480, 640, 3), np.uint8), mask=exact, objects=exact, key="s"))
    assert repaired(known(given.mask), known(given.objects), (fringed, None)) is not None
