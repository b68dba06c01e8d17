"""Damaged masks, and pictures that are missing: what a network is given in training."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import label

from pliant.loaders import mask_damage
from pliant.loaders.augment import AugmentSettings, given_masks, given_picture
from pliant.loaders.mask_damage import damaged
from tests.loaders.test_augment import SIZE, both_masks, with_ball

DRAWS = 60


def bar_and_ball() -> tuple[np.ndarray, np.ndarray]:
    """A bar, 10 x 80 px, and a ball of other material at its right end."""
    rows, columns = np.indices((SIZE[1], SIZE[0]))
    bar = (abs(rows - 60) < 5) & (columns >= 40) & (columns < 120)
    ball = (rows - 60) ** 2 + (columns - 126) ** 2 <= 49
    return bar, bar | ball


@pytest.mark.parametrize("kind", range(5))
def test_each_damage_does_what_it_is_called(kind: int) -> None:
    bar, objects = bar_and_ball()
    edge = np.zeros_like(bar)
    edge[50:70, 35:135] = True
    rng = np.random.default_rng(kind)
    seen = [mask_damage._DAMAGES[kind](rng, bar, objects) for _ in range(DRAWS)]
    for own, everything in seen:
        assert own.shape == bar.shape
        assert not (own & ~everything).any(), "the queried object is one of all objects"
    changed = [own for own, _ in seen if (own != bar).any()]
    if kind == 4:  # the ball
        assert all((own == objects).all() for own, _ in seen)
        return
    assert len(changed) > DRAWS * 0.8
    if kind == 0:  # ragged: pixels near the contour alone, in both directions
        assert all((own & ~edge).sum() == 0 for own in changed)
        assert any((own & ~bar).any() and (bar & ~own).any() for own in changed)
        assert np.mean([own[60, 50:110].all() for own in changed]) > 0.9
    elif kind == 1:  # holes in the object
        assert all((bar & ~own).any() and not (own & ~bar).any() for own in changed)
    elif kind == 2:  # a second object
        assert all((own | bar == own).all() for own in changed)
        assert np.mean([label(own)[1] >= 2 for own in changed]) > 0.4
    else:  # ends are missing, the middle is not
        assert all(own[:, 70:90].sum() == bar[:, 70:90].sum() for own in changed)
        ends = [(own[:, 40:44].any(), own[:, 116:120].any()) for own in changed]
        assert {(False, True), (True, False)} <= set(ends)


def test_damage_never_deletes_the_object_and_needs_one() -> None:
    small = np.zeros((SIZE[1], SIZE[0]), dtype=bool)
    small[50:54, 70:74] = True
    rng = np.random.default_rng(0)
    for _ in range(DRAWS):
        own, everything = damaged(rng, small, small)
        assert own.sum() > 0.04 * small.sum()
        assert not (own & ~everything).any()
    nothing = np.zeros_like(small)
    own, everything = damaged(rng, nothing, nothing)
    assert not own.any()
    assert not everything.any()


def test_damage_is_asked_for_and_repeatable() -> None:
    view = with_ball()
    settings = AugmentSettings(mask_damage=1)
    mask, again = (both_masks(np.random.default_rng(5), view, settings)[0] for _ in range(2))
    assert (mask != view.mask).any()
    np.testing.assert_array_equal(mask, again)


def test_picture_and_masks_are_never_both_missing() -> None:
    """Each is missing as often as asked, the picture among the frames that keep their mask."""
    view = with_ball()
    settings = AugmentSettings(mask_drop=0.25, picture_drop=0.4)
    rng = np.random.default_rng(7)
    no_mask, alone, greys, with_mask = 0, 0, [], 0
    for _ in range(400):
        mask, objects = given_masks(rng, view, settings)
        rgb = given_picture(rng, view.rgb, mask, settings)
        if mask is None:
            assert objects is None
            no_mask += 1
            np.testing.assert_array_equal(rgb, view.rgb)
            continue
        with_mask += 1
        alone += objects is None
        if (rgb == rgb[0, 0, 0]).all():
            greys.append(int(rgb[0, 0, 0]))
        else:
            np.testing.assert_array_equal(rgb, view.rgb)
    assert (no_mask, alone) == pytest.approx((100, 100), abs=30)
    assert len(greys) / with_mask == pytest.approx(0.4, abs=0.09)
    assert len(set(greys)) > 40, "the grey is drawn"
