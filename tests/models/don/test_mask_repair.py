"""Given masks of a rope, checked against its picture."""

from __future__ import annotations

import numpy as np

from pliant.baselines.conditions import segmented
from pliant.baselines.tracing import MaskShape
from pliant.models.don.mask_repair import repaired
from pliant.models.don.segmentation import rope_masks
from pliant.spec.arrays import Mask
from pliant.spec.frame import Frame
from tests.models.don.test_segmentation import HALF_PX, overlap, scene, vague


def test_exact_masks_are_kept() -> None:
    rgb, rope, ball, _ = scene()
    found = rope_masks(rgb, vague(rope, ball))
    assert found is not None
    assert repaired(rope, rope | ball, found) is None
    assert repaired(rope | ball, None, found) is None


def test_an_exact_mask_is_kept_where_the_picture_misleads() -> None:
    rgb, rope, ball, _ = scene()
    found = rope_masks(rgb, vague(rope, ball))
    assert found is not None
    found[0][:, : found[0].shape[1] // 2] = False
    assert repaired(rope, rope | ball, (found[0], found[0] | ball)) is None


def test_a_rope_cut_by_holes_is_made_whole() -> None:
    rgb, rope, ball, _ = scene()
    found = rope_masks(rgb, vague(rope, ball))
    assert found is not None
    cut = rope.copy()
    cut[:, 300:312] = False  # a rope of even width, in two parts
    corrected = repaired(cut, cut | ball, found)
    assert corrected is not None
    assert (corrected[0] & rope).sum() > 0.96 * rope.sum()


def test_a_segmenters_masks_are_corrected() -> None:
    rgb, rope, ball, shadow = scene()
    found = rope_masks(rgb, vague(rope, ball | shadow))
    assert found is not None
    for k in range(3):
        damaged = segmented(Frame(rgb, mask=rope, objects=rope | ball, key=f"s/{k}"))
        assert damaged.mask is not None
        assert damaged.objects is not None
        corrected = repaired(damaged.mask, damaged.objects, found)
        assert corrected is not None
        mask, objects = corrected
        assert objects is not None
        assert overlap(mask, rope) > overlap(damaged.mask, rope)
        assert (mask & rope).sum() > 0.96 * rope.sum()  # holes are filled, the end is back
        given = overlap(damaged.objects & ~damaged.mask, ball)
        assert abs(overlap(objects & ~mask, ball) - given) < 0.02  # the ball is as it was given


def test_a_ball_that_the_picture_shows_elsewhere_is_no_rope() -> None:
    """The ball found in the picture is 12 px away from the given one; its pixels are not rope."""
    rgb, rope, ball, _ = scene()
    damaged = segmented(Frame(rgb, mask=rope, objects=rope | ball, key="s/0"))
    assert damaged.mask is not None
    beside = np.roll(ball, (-12, 0), axis=(0, 1)) & ~rope
    corrected = repaired(damaged.mask, damaged.objects, (rope, rope | beside))
    assert corrected is not None
    assert not (corrected[0] & beside & ~damaged.mask).any()


def test_a_second_rope_in_the_mask_goes() -> None:
    rgb, rope, ball, _ = scene()
    found = rope_masks(rgb, vague(rope, ball))
    other = np.zeros_like(rope)
    other[30:50, 60:580] = True
    assert found is not None
    corrected = repaired(rope | other, rope | other | ball, found)
    assert corrected is not None
    mask, objects = corrected
    assert objects is not None
    assert not (objects & other).any()
    assert overlap(mask, rope) > 0.85


def test_a_loop_that_the_picture_does_not_show_goes() -> None:
    rgb, rope, ball, _ = scene()
    found = rope_masks(rgb, vague(rope, ball))
    assert found is not None
    rows, columns = np.mgrid[: rope.shape[0], : rope.shape[1]]
    row, column = np.argwhere(rope)[len(np.argwhere(rope)) // 2]
    ring = np.abs(np.hypot(rows - row - 75, columns - column) - 75) <= HALF_PX
    given = (rope | ring) & ~ball
    assert not MaskShape.of(given, given | ball).several_ropes  # the shape alone does not tell
    corrected = repaired(given, given | ball, found)
    assert corrected is not None
    assert overlap(corrected[0], rope) > 0.8


def test_lengths_scale_with_the_picture() -> None:
    rgb, rope, ball, _ = scene()
    found = rope_masks(rgb, vague(rope, ball))
    assert found is not None

    def doubled(mask: Mask) -> Mask:
        return mask.repeat(2, axis=0).repeat(2, axis=1)

    damaged = segmented(Frame(rgb, mask=rope, objects=rope | ball, key="s/0"))
    assert damaged.mask is not None
    assert damaged.objects is not None
    assert found[1] is not None
    once = repaired(damaged.mask, damaged.objects, found)
    twice = repaired(
        doubled(damaged.mask), doubled(damaged.objects), (doubled(found[0]), doubled(found[1]))
    )
    assert once is not None
    assert twice is not None
    assert overlap(doubled(once[0]), twice[0]) > 0.95
    exact = doubled(rope), doubled(rope | ball)
    assert repaired(*exact, (doubled(found[0]), doubled(found[1]))) is None
