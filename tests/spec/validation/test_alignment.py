"""Points next to the pixels around them: which are sampled, and what is measured of a bent patch.

The image is 50 px wide, so that it is larger than any number by which a place could be cut off.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pliant.spec.arrays import FloatArray
from pliant.spec.camera import Camera
from pliant.spec.conventions import OCCLUDED, OUT_OF_FRAME, SELF_OCCLUDED, VISIBLE
from pliant.spec.io.exr import Surface
from pliant.spec.model import Tier
from pliant.spec.validation.rules.alignment import Alignment, Measured, Sample, _sample, joined
from pliant.spec.validation.rules.windows import SoundFrame
from tests.dataset_files import coordinate, tier
from tests.spec.validation.world import view as frame

WIDTH, HEIGHT = 50, 44
TUBE, BALL = 1, 2
TIER = Tier.from_document(
    tier(
        "t",
        "rope",
        {
            "tube": [coordinate("s", 0, 60, 0.01), coordinate("theta", 0, 8, 0.01, 8)],
            "ball": [coordinate("u", 0, 60, 0.01), coordinate("v", 0, 60, 0.01)],
        },
    )
)
U, V = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
M0, M1 = (U / 10).astype(np.float32), ((V / 2) % 8).astype(np.float32)
DEPTH = (1 + U / 100 + V / 1000).astype(np.float32)


CAMERA = Camera(np.array([[100.0, 0, 20], [0, 120, 25], [0, 0, 1]]), np.eye(4), (WIDTH, HEIGHT))


def view(at: Any, object_id: Any = TUBE, **changes: Any) -> SoundFrame:
    """Return a frame in which a tube is everywhere; the last row's point has the material 0."""
    columns = {"object": TUBE, "state": VISIBLE, "line": False, "good": True} | changes
    points = [
        {name: np.broadcast_to(values, len(at))[k] for name, values in columns.items()}
        | {"at": place, "depth": 2 + k / 8}
        | {"material": ((len(at) - 1 - k) / 100, (len(at) - 1 - k) / 10)}
        for k, place in enumerate(at)
    ]
    ids = np.broadcast_to(np.array(object_id, np.uint32), DEPTH.shape)
    return frame(TIER, CAMERA, Surface(DEPTH, M0, M1, ids), points, 7)


def test_a_sample_is_the_4x4_pixels_around_a_point() -> None:
    ids = np.where(U < 25, TUBE, BALL)
    seen = view([(10.2, 20.9), (30.6, 5.4)], ids, object=np.array([TUBE, BALL]))
    sample = _sample(seen)
    assert sample is not None
    assert sample.frame.tolist() == [7, 7]
    assert sample.cell.tolist() == [[9, 20], [30, 4]]
    assert sample.queried.tolist() == [True, False]
    np.testing.assert_array_equal(sample.uv_px, [(10.2, 20.9), (30.6, 5.4)])
    np.testing.assert_array_equal(sample.depth_m, [2, 2.125])
    np.testing.assert_array_equal(sample.K, [seen.camera.K] * 2)
    for index, (u, v) in enumerate(((9, 20), (30, 4))):
        around = np.s_[v - 1 : v + 3, u - 1 : u + 3]
        np.testing.assert_array_equal(sample.shown_m[index], DEPTH[around])
        own = (0.01, 0.1) if index == 0 else (0, 0)
        np.testing.assert_allclose(sample.material[index, ..., 0], M0[around] - own[0])
        gap = M1[around].astype(float) - own[1]
        if index == 0:
            gap = (gap + 4) % 8 - 4  # the tube is closed: at most half of the way round
        np.testing.assert_allclose(sample.material[index, ..., 1], gap, atol=1e-12)


@pytest.mark.parametrize(
    ("at", "found"),
    [
        ((1.5, 20), True),
        ((1.49, 20), False),
        ((48.49, 20), True),
        ((48.5, 20), False),
        ((20, 1.5), True),
        ((20, 1.49), False),
        ((20, 42.49), True),
        ((20, 42.5), False),
        ((-1e30, 20), False),
        ((20, 1e30), False),
    ],
)
def test_all_pixels_of_a_sample_are_in_the_image(at: tuple[float, float], found: bool) -> None:
    assert (_sample(view([at])) is not None) is found


def test_a_sample_is_a_visible_surface_point_on_its_own_object() -> None:
    places = [(8.0 + 4 * k, 20.0) for k in range(9)]
    states = np.array([VISIBLE, SELF_OCCLUDED, OCCLUDED, OUT_OF_FRAME, *[VISIBLE] * 5], np.int32)
    ids = np.full(DEPTH.shape, TUBE)
    ids[18, 28 - 2] = 0  # a corner of the pixels around row 5, at (28, 20)
    line, good = np.zeros((2, 9), np.bool_)
    line[6], good[:] = True, True
    good[7] = False
    sample = _sample(view(places, ids, state=states, line=line, good=good))
    assert sample is not None
    assert sample.uv_px[:, 0].tolist() == [8, 24, 40]
    assert _sample(view(places[1:2], state=states[1:2])) is None
    assert _sample(view(places[:1], BALL)) is None


def test_samples_are_spread_over_the_rows() -> None:
    places = [(5 + k % 30, 5 + k // 30) for k in range(98)]
    sample = _sample(view(places))
    assert sample is not None
    rows = ((sample.depth_m - 2) * 8).astype(int)
    assert (len(rows), rows[0], rows[-1]) == (96, 0, 97)
    assert set(np.diff(rows)) == {1, 2}
    sample = _sample(view(places[:96]))
    assert sample is not None
    assert len(sample.frame) == 96


def test_a_sequence_has_enough_samples_after_a_while() -> None:
    seen = view([(20, 20), (30, 30)])
    for before, after in ((1534, 2), (1535, 2), (1536, 1), (1537, 1)):
        parts: list[Any] = [SimpleNamespace(frame=np.zeros(before))]
        alignment = Alignment(parts)
        alignment.add(seen)
        assert len(alignment.samples) == after
    alignment = Alignment()
    alignment.add(view([(20, 20)], BALL))
    assert alignment.samples == []
    assert alignment.frames() == []
    assert joined([]) is None


def patch(material: FloatArray, depth: Any, inside: FloatArray, **changes: Any) -> Sample:
    """Return a point's 4x4 pixels, at a place of the inner cell (0 to 1)."""
    K = np.array([[100.0, 0, 23.5], [0, 120, 41.2], [0, 0, 1]])
    cell = np.array([[30, 17]])
    values: dict[str, Any] = {
        "frame": np.array([5]), "uv_px": cell + 0.5 + inside, "depth_m": np.array([2.0]),
        "queried": np.array([True]), "K": K[None], "cell": cell, "material": material[None],
        "shown_m": depth[None],
    } | changes  # fmt: skip
    return Sample(**values)


A, B = np.meshgrid(np.arange(-1.0, 3), np.arange(-1.0, 3))
FLAT, NOTHING = np.full((4, 4), 2.0), np.zeros((4, 4))
MIDDLE = np.array([0.5, 0.5])
J = np.array([[0.8, 0.3], [-0.2, 1.1]])
"""Change of the material (rows) along u and v (columns)."""


def mapped(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return material of which `first` and `second` are added to a plane."""
    plane = np.stack([A, B], axis=-1) @ J.T
    return plane + np.stack([first, second], axis=-1)


def measure(sample: Sample) -> Measured:
    [found] = Alignment([sample]).frames()
    return found


@pytest.mark.parametrize(
    ("first", "second"),
    [
        # Second differences 2 p along u and 2 q along v, of either coordinate.
        (0.03 * A * (A - 1), 0.02 * B * (B - 1)),
        (0.01 * B * (B - 1), 0.04 * B * (B - 1)),
        (0.05 * A * (A - 1) + 0.02 * B * (B - 1), NOTHING),
        (NOTHING, 0.05 * A * (A - 1) - 0.02 * B * (B - 1)),
    ],
)
def test_bounds_of_the_interpolation(first: FloatArray, second: FloatArray) -> None:
    """An eighth of the second differences, taken to pixels; k (k - 1) leaves the inner cell flat.

    For the bound the larger one of u and v counts, for the bend both.
    """
    found = measure(patch(mapped(first, second), FLAT, MIDDLE))
    share = np.abs(np.linalg.inv(J))
    along = [(abs(c[0, 2] - 2 * c[0, 1] + c[0, 0]), abs(c[2, 0] - 2 * c[1, 0] + c[0, 0]))
             for c in (first, second)]  # fmt: skip
    largest, both = np.max(along, axis=1), np.sum(along, axis=1)
    assert found.error_px[0] == pytest.approx((share @ largest).sum() / 8)
    assert found.bend_px[0] == pytest.approx((share @ both).sum() / 8)
    assert found.offset_px[0] == pytest.approx(-MIDDLE)


@pytest.mark.parametrize(("t", "r"), [(0.004, 0.0), (0.0, 0.003), (0.004, 0.003)])
def test_noise_is_that_of_the_less_certain_direction(t: float, r: float) -> None:
    """The third differences of t k (k - 1) (k - 2) are 6 t along one axis, and 0 along the other.

    Their median is 3 t; it is 0.6745 of the deviation of noise, of which they have 20 variances.
    """
    first, second = t * A * (A - 1) * (A - 2), r * B * (B - 1) * (B - 2)
    found = measure(patch(mapped(first, second), FLAT, MIDDLE))
    deviation = 3 * np.array([t, r]) / (0.6745 * np.sqrt(20))
    assert found.noise_px[0] == pytest.approx(np.sqrt(np.linalg.inv(J) ** 2 @ deviation**2).max())


def test_metres_of_a_tilted_surface() -> None:
    """Half a metre deeper along u and a quarter along v."""
    inside = np.array([0.3, 0.6])
    depth = 2 + A / 2 + B / 4
    u, v = 30.5 + A, 17.5 + B
    position = np.stack([(u - 23.5) / 100 * depth, (v - 41.2) / 120 * depth, depth], axis=-1)
    corner = position[1:3, 1:3]
    along_u = (corner[0, 1] - corner[0, 0]) * 0.4 + (corner[1, 1] - corner[1, 0]) * 0.6
    along_v = (corner[1, 0] - corner[0, 0]) * 0.7 + (corner[1, 1] - corner[0, 1]) * 0.3
    sides = np.stack([along_u, along_v], axis=1) @ np.linalg.inv(J)
    found = measure(patch(mapped(NOTHING, NOTHING), depth, inside))
    assert found.metres[0] == pytest.approx(np.linalg.norm(sides, axis=0))
    assert found.footprint_m[0] == 2 / 100
    other = measure(patch(mapped(NOTHING, NOTHING), depth, inside, queried=np.array([False])))
    assert np.isnan(other.metres).all()


def test_bend_and_noise_of_depth_are_in_footprints() -> None:
    """A pixel is 2 cm wide at 2 m."""
    found = measure(patch(mapped(NOTHING, NOTHING), 2 + 0.01 * A**2 - 0.03 * B**2, MIDDLE))
    assert found.bend_depth[0] == pytest.approx((0.02 + 0.06) / 8 / 0.02)
    found = measure(patch(mapped(NOTHING, NOTHING), 2 + 0.01 * A**3, MIDDLE))
    assert found.noise_depth[0] == pytest.approx(0.03 / (0.6745 * np.sqrt(20)) / 0.02)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize(("times", "left"), [(5.9, 1), (6.1, 0)])
def test_a_jump_along_either_axis(axis: int, which: int, times: float, left: int) -> None:
    """The material of one coordinate is torn between the last two columns or rows."""
    material = mapped(NOTHING, NOTHING)
    step = J[which, axis] * np.sign(J[which, axis])
    torn = (times * np.abs(J[which]).sum() - step) * np.sign(J[which, axis])
    material[..., which] += torn * ((B if axis else A) == 2)
    assert len(Alignment([patch(material, FLAT, MIDDLE)]).frames()) == left


def test_a_flat_patch_is_measured_exactly() -> None:
    """The material is that of a place (0.11, -0.23) px away; the plane recedes along both axes."""
    inside, shift = np.array([0.3, 0.6]), np.array([0.11, -0.23])
    material = (np.stack([A, B], axis=-1) - inside - shift) @ J.T
    tilted = 1 / (0.5 + 0.01 * (A - 0.3) - 0.02 * (B - 0.6))
    found = measure(patch(material, tilted, inside))
    assert found.offset_px[0] == pytest.approx(shift)
    assert found.shown_m[0] == pytest.approx(2.0)
    slope = (np.array([30.8, 18.1]) - [23.5, 41.2]) / [100, 120]
    assert found.ray[0] == pytest.approx(np.sqrt(1 + (slope**2).sum()))
    for bound in (found.error_px, found.bend_px, found.noise_px):
        assert bound[0] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(("angle", "left"), [(0.0205, 1), (0.0195, 0)])
def test_material_needs_two_directions(angle: float, left: int) -> None:
    """The sine of the angle between the directions in which they change is at least 0.02."""
    second = np.cos(angle) * (A + B) + np.sin(angle) * (A - B)
    material = np.stack([3 * (A + B), 0.5 * second], axis=-1)
    assert len(Alignment([patch(material, FLAT, MIDDLE)]).frames()) == left


def test_frames_are_measured_apart_and_joined_in_order() -> None:
    """Of three frames the second one cannot be measured: its material has one direction."""
    flat = mapped(NOTHING, NOTHING)
    parts = [
        patch(material, depth, MIDDLE, frame=np.array([number]))
        for number, material, depth in (
            (2, flat, FLAT), (3, np.zeros_like(flat), FLAT), (9, flat, FLAT + 1),
        )
    ]  # fmt: skip
    found = Alignment(parts).frames()
    assert [each.frame.tolist() for each in found] == [[2], [9]]
    both = joined(found)
    assert both is not None
    assert len(both) == 2
    assert both.shown_m == pytest.approx([2, 3])
