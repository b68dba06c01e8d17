"""Pictures seen from above, and a small object in a part of its picture: answers come back."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy import ndimage

from pliant.baselines.tracing import Reframed, RopeTracer, rectified
from pliant.baselines.tracing.tilt import Nadir, slant
from pliant.spec.answers import Answers
from pliant.spec.arrays import FloatArray
from pliant.spec.frame import Frame, Pair

WIDTH, HEIGHT, FOCAL = 640, 480, 686.0
RADIUS_M = 0.011
ABOVE = Nadir.of_image((HEIGHT, WIDTH))


def winding_rope(count: int = 1500) -> FloatArray:
    """Return the centre line of a rope on the table, float64 (count, 3), metres."""
    t = np.linspace(0, 1, count)
    return np.stack([0.22 * np.sin(7 * t + 0.4), 0.66 * t - 0.33, np.full(count, RADIUS_M)], axis=1)


def projected(points: FloatArray, tilt_deg: float) -> tuple[FloatArray, FloatArray]:
    """Return positions (N, 2), px, and depths (N,) from 1.3 m away at an angle from above."""
    tilt = np.radians(tilt_deg)
    right = np.array([1.0, 0.0, 0.0])
    forward = np.array([0.0, np.sin(tilt), -np.cos(tilt)])
    down = np.cross(forward, right)
    in_camera = (points + 1.3 * forward) @ np.stack([right, down, forward]).T
    uv = FOCAL * in_camera[:, :2] / in_camera[:, 2:] + [WIDTH / 2, HEIGHT / 2]
    return uv, in_camera[:, 2]


@functools.cache
def drawn(tilt_deg: float) -> Frame:
    """Return the view of the rope as discs of its apparent radius, with a ball at its start."""
    uv, depth = projected(winding_rope(), tilt_deg)
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)

    def disc(centre: FloatArray, radius: float) -> npt.NDArray[np.bool_]:
        return np.asarray((columns - centre[0]) ** 2 + (rows - centre[1]) ** 2 <= radius**2)

    mask = np.zeros((HEIGHT, WIDTH), dtype=np.bool_)
    for centre, z in zip(uv[::6], depth[::6], strict=True):
        mask |= disc(centre, RADIUS_M * FOCAL / z)
    objects = mask | disc(uv[0], 2.2 * RADIUS_M * FOCAL / depth[0])
    mask &= ~disc(uv[0], 2.2 * RADIUS_M * FOCAL / depth[0])
    rgb = np.where(mask[..., None], 200, 30).astype(np.uint8).repeat(3, axis=2)
    return Frame(rgb, mask, key=f"tilt-{tilt_deg}", objects=objects)


@pytest.mark.parametrize(
    "tilt_deg", [40, *(pytest.param(each, marks=pytest.mark.long) for each in (28, 48))]
)
def test_the_tilt_is_read_off_the_widths(tilt_deg: float) -> None:
    mask = drawn(tilt_deg).mask
    assert mask is not None
    found = slant(mask, ABOVE)
    assert found is not None
    assert np.degrees(np.arctan(found)) == pytest.approx(tilt_deg, abs=6)


@pytest.mark.parametrize("tilt_deg", [pytest.param(0, marks=pytest.mark.long), 6])
def test_a_view_from_above_stays_as_it_is(tilt_deg: float) -> None:
    view = drawn(tilt_deg)
    seen = rectified(view)
    assert seen.view is view
    assert seen.homography is None
    places = np.array([[3.25, 4.5]])
    np.testing.assert_array_equal(seen.forward(places), places)


@pytest.mark.parametrize("seed", [15, 25, 50])
def test_an_uneven_edge_is_no_slant(seed: int) -> None:
    """The widths of these ropes from above grow downwards by three to five standard errors."""
    share = np.linspace(0, 1, 2000)
    line = np.stack([60 + 520 * share, 240 + 90 * np.sin(2 * np.pi * share)], axis=1)
    away = np.ones((480, 640), np.bool_)
    away[tuple(np.round(line[:, ::-1]).astype(int).T)] = False
    noise = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=away.shape), 3)
    mask = ndimage.distance_transform_edt(away) + 1.5 * noise / noise.std() < 4.5
    assert slant(mask, Nadir.of_image(mask.shape)) is None


def test_without_a_mask_or_a_rope_nothing_is_rectified() -> None:
    view = drawn(40)
    assert rectified(Frame(view.rgb)).homography is None
    speck = np.zeros((HEIGHT, WIDTH), dtype=np.bool_)
    speck[100:104, 100:104] = True
    assert slant(speck, ABOVE) is None
    assert slant(np.zeros_like(speck), ABOVE) is None


def test_distances_are_those_on_the_table_afterwards() -> None:
    table = winding_rope()[::60]
    uv, _ = projected(table, 45)

    def spread(positions: FloatArray) -> float:
        """Return the ratio of the largest to the smallest pixels per metre between neighbours."""
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        metres = np.linalg.norm(np.diff(table, axis=0), axis=1)
        return float((steps / metres).max() / (steps / metres).min())

    seen = rectified(drawn(45))
    assert spread(uv) > 1.5
    assert spread(seen.forward(uv).astype(np.float64)) < 1.12


def test_the_picture_moves_as_its_positions_do() -> None:
    view = drawn(40)
    seen = rectified(view)
    assert seen.view.mask is not None
    uv, _ = projected(winding_rope()[150:], 40)
    column, row = seen.forward(uv).astype(int).T
    assert seen.view.mask[row, column].mean() > 0.98
    assert (seen.view.rgb[row, column, 0] > 100).mean() > 0.98
    assert seen.view.cache_key != view.key


def test_the_table_is_equally_far_everywhere_from_straight_above() -> None:
    """Depth is along the optical axis, which turns."""
    tilt = np.radians(40)
    row = (np.arange(HEIGHT) + 0.5 - HEIGHT / 2) / FOCAL
    depth_m = 1.3 * np.cos(tilt) / (np.cos(tilt) + row * np.sin(tilt))
    table = np.repeat(depth_m[:, None], WIDTH, axis=1).astype(np.float32)
    table[:3] = np.inf
    seen = rectified(replace(drawn(40), depth_m=table, key="with depth")).view
    assert seen.depth_m is not None
    assert seen.depth_m.dtype == np.float32
    shown = seen.depth_m[np.isfinite(seen.depth_m)]
    assert shown.size > 0.3 * table.size
    assert shown.max() / shown.min() < 1.15 < 1.7 < depth_m.max() / depth_m.min()
    assert np.median(shown) == pytest.approx(1.3 * np.cos(tilt), rel=0.06)


def test_answers_come_back_with_their_widths() -> None:
    seen = rectified(drawn(45))
    there = np.array([[200.0, 180.0], [400.0, 330.0]])
    width = 1e-2
    sigma = np.full(2, width, dtype=np.float32)
    forward = seen.forward(there)
    modes = [np.array([[*place, width, 1.0]], dtype=np.float32) for place in forward]
    answers = seen.back(Answers(forward, None, sigma, modes))
    np.testing.assert_allclose(answers.uv_px, there, atol=1e-2)
    assert answers.sigma_px is not None
    assert answers.modes is not None
    # The area of a small square that comes back, from its mapped corners.
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for row, place in enumerate(forward.astype(np.float64)):
        x, y = seen.back(Answers((place + corners).astype(np.float32))).uv_px.T.astype(np.float64)
        area = abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2
        assert answers.sigma_px[row] == pytest.approx(width * np.sqrt(area / 4), rel=0.02)
        assert answers.modes[row][0, 2] == pytest.approx(answers.sigma_px[row], rel=1e-4)


def test_the_tracer_counts_along_the_rope_at_a_slant() -> None:
    rope = winding_rope()[200:1450:25] + np.array([0, 0, RADIUS_M])  # both see its highest line
    asked, truth = projected(rope, 0)[0], projected(rope, 48)[0]
    answers = RopeTracer().answer(Pair(drawn(0), drawn(48), asked.astype(np.float32)))
    assert np.median(np.linalg.norm(answers.uv_px - truth, axis=1)) < 6


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
