"""A small object is answered in a part of its picture, and the answers come back."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.tracing import Reframed, rectified
from pliant.spec.answers import Answers
from pliant.spec.frame import Frame
from tests.baselines.tracing.test_rectification import drawn


def block(left: int, top: int, width: int, height: int) -> Frame:
    """Return a picture of 200x160 with a bright block."""
    mask = np.zeros((160, 200), dtype=np.bool_)
    mask[top : top + height, left : left + width] = True
    rgb = np.where(mask[..., None], 200, 30).astype(np.uint8).repeat(3, axis=2)
    return Frame(rgb, mask, np.full(mask.shape, 1.5, np.float32), "block", mask)


@pytest.mark.parametrize("left", [90, 0, 180])
def test_a_small_object_takes_the_wanted_share(left: int) -> None:
    view = block(left, 60, 20, 24)
    seen = Reframed.unchanged(view).zoomed(view.mask, 0.5, 0.75)
    assert seen.view.mask is not None
    rows, columns = np.nonzero(seen.view.mask)
    assert np.ptp(rows) + 1 == pytest.approx(0.75 * 160, abs=3)
    assert np.ptp(columns) + 1 == pytest.approx(0.75 * 160 * 20 / 24, abs=3)
    assert seen.view.size == view.size
    assert seen.view.cache_key == "block/zoomed"
    assert (seen.view.rgb[rows, columns, 0] > 110).all()
    # The part is inside the picture, so nothing is made up.
    corners = seen.back(Answers(np.array([[0, 0], [200, 160]], np.float32))).uv_px
    assert (corners >= -1e-3).all()
    assert (corners <= np.array([200, 160]) + 1e-3).all()
    assert seen.view.rgb.min() == 30
    assert seen.view.depth_m is not None
    assert (seen.view.depth_m == 1.5).all()


def test_answers_come_back_smaller() -> None:
    view = block(30, 60, 20, 24)
    seen = Reframed.unchanged(view).zoomed(view.mask, 0.5, 0.75)
    there = np.array([[31.25, 62.0], [44.0, 80.5]])
    forward = seen.forward(there)
    assert np.linalg.norm(forward[1] - forward[0]) > 4 * np.linalg.norm(there[1] - there[0])
    modes = [np.array([[*place, 5.0, 1.0]], np.float32) for place in forward]
    back = seen.back(Answers(forward, None, np.full(2, 5, np.float32), modes))
    np.testing.assert_allclose(back.uv_px, there, atol=1e-3)
    assert back.sigma_px is not None
    assert back.modes is not None
    np.testing.assert_allclose(back.sigma_px, 5 * 24 / (0.75 * 160), rtol=1e-5)
    np.testing.assert_allclose(back.modes[0][0, :3], [*there[0], back.sigma_px[0]], rtol=1e-4)


def test_an_object_of_one_pixel_is_turned_into_the_middle() -> None:
    view = block(30, 60, 1, 1)
    assert view.mask is not None
    seen = Reframed.unchanged(view).turned_by(np.pi / 2, view.mask, 0.8)
    np.testing.assert_allclose(seen.forward(np.array([[30.5, 60.5]])), [[100, 80]], atol=1e-4)


def test_other_views_stay_as_they_are() -> None:
    large, small = block(30, 20, 60, 110), block(30, 60, 20, 24)
    for view, shown in ((large, large.mask), (small, None), (small, np.zeros((4, 5), np.bool_))):
        seen = Reframed.unchanged(view)
        assert seen.zoomed(shown, 0.5, 0.75) is seen


def test_a_mask_of_another_resolution_says_the_same() -> None:
    view = block(80, 60, 20, 24)
    assert view.mask is not None
    whole = Reframed.unchanged(view).zoomed(view.mask, 0.5, 0.75).homography
    coarse = Reframed.unchanged(view).zoomed(view.mask[::4, ::4], 0.5, 0.75).homography
    assert whole is not None
    assert coarse is not None
    np.testing.assert_allclose(whole, coarse)


def test_a_rope_at_a_slant_is_enlarged_in_the_view_from_above() -> None:
    """One step from the original picture: its nadir and its positions follow both maps."""
    above = rectified(drawn(45))
    seen = above.zoomed(above.view.mask, 0.99, 1.2)
    assert seen.tilted
    assert seen.homography is not None
    places = np.array([[300.0, 200.0], [320.0, 260.0]])
    there, then = above.forward(places), seen.forward(places)
    scale = np.linalg.norm(then[1] - then[0]) / np.linalg.norm(there[1] - there[0])
    assert scale > 1.2
    assert seen.nadir.focal_px == pytest.approx(scale * above.nadir.focal_px, rel=1e-4)
    moved = then[0] - scale * there[0]
    np.testing.assert_allclose(seen.nadir.place_px, scale * above.nadir.place_px + moved, atol=0.05)
