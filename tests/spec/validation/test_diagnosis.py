"""One cause for many wrong rows or images, made by hand, and the limits where there is none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from pliant.spec.arrays import FloatArray
from pliant.spec.camera import Camera
from pliant.spec.model import Tier
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.agreement import check_agreement
from pliant.spec.validation.rules.alignment import Alignment, Measured, Sample
from pliant.spec.validation.rules.correspondences import FrameRows
from pliant.spec.validation.rules.diagnosis import RowSample, diagnose_rows
from tests.conformance.base import TIERS

WIDTH, HEIGHT = SIZE = (160, 120)
FRAMES, POINTS = 24, 40


def _camera(frame: int) -> Camera:
    """One of several cameras on a circle, 1.2 m away, which look down upon the origin."""
    turn, tilt = 0.3 * frame, 2.4
    about_z = [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    about_x = [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]
    pose = np.eye(4)
    pose[:3, :3] = np.array(about_x) @ np.array(about_z)
    pose[:3, 3] = 0.02, -0.03, 1.2
    return Camera(np.array([[150.0, 0, 83], [0, 155.0, 58], [0, 0, 1]]), pose, SIZE)


CAMERAS = [_camera(frame) for frame in range(FRAMES)]
XYZ = np.random.default_rng(0).uniform(-0.3, 0.3, (FRAMES, POINTS, 3))


def diagnosed(
    uvz: FloatArray, xyz: FloatArray, wrong: float = 1.0, cameras: Sequence[Camera] = CAMERAS
) -> dict[tuple[str, str], int]:
    """Return (code, cause) -> rows for tables (F, P, 3) of which a share is called wrong."""
    findings, sample = Findings(), RowSample()
    problems = findings.at("table")
    for frame, (projected, placed) in enumerate(zip(uvz, xyz, strict=True)):
        number = np.arange(POINTS, dtype=np.int32)
        rows = FrameRows(frame, number, projected[:, :2], projected[:, 2], 0 * number, placed)
        sample.add(rows)
        for code in ("REPROJECTION_DISAGREES", "DEPTH_DISAGREES"):
            problems.add_rows(code, number < wrong * POINTS, lambda index: (str(index), "wrong"))
    diagnose_rows(sample, cameras, SIZE, problems)
    return {key: files[0][1] for key, files in findings.diagnoses.items()}


def right_rows() -> FloatArray:
    return np.stack([c.project(xyz) for c, xyz in zip(CAMERAS, XYZ, strict=True)])


Change = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
PIXELS: dict[str, Change] = {
    "have v upwards: count v from the top of the image": lambda u, v: (u, HEIGHT - v),
    "have u leftwards: count u from the left of the image": lambda u, v: (WIDTH - u, v),
    "are turned by 180 degrees": lambda u, v: (WIDTH - u, HEIGHT - v),
    "have u and v exchanged: swapped axes": lambda u, v: (v, u),
    "are in [0, 1]: divided by the image size; multiply by it": lambda u, v: (
        u / WIDTH,
        v / HEIGHT,
    ),
    "are in [-1, 1]: normalised device coordinates": lambda u, v: (
        2 * u / WIDTH - 1,
        2 * v / HEIGHT - 1,
    ),
    "are rounded to pixels: positions are never rounded": lambda u, v: (np.rint(u), np.floor(v)),
    "are 0.5 times the projection: images of another size?": lambda u, v: (u / 2, v / 2),
    "are 1.002 times the projection: images of another size?": lambda u, v: (
        1.002 * u,
        1.002 * v,
    ),
    "differ by (-0.50, -0.50) px: OpenCV convention?": lambda u, v: (u - 0.5, v - 0.5),
    "differ by (+0.50, +0.50) px: half a pixel too much?": lambda u, v: (u + 0.5, v + 0.5),
    "differ by (+3.25, -0.50) px": lambda u, v: (u + 3.25, v - 0.5),
    "differ by (-0.53, -0.50) px": lambda u, v: (u - 0.53, v - 0.5),
}


@pytest.mark.parametrize("cause", PIXELS)
@pytest.mark.parametrize(("others", "found"), [(1, True), (3, False)])
def test_a_cause_explains_nearly_all_positions(cause: str, others: int, found: bool) -> None:
    """Of 40 rows a frame one may be another mistake; three are too many."""
    rows = right_rows()
    rows[..., :2] = np.stack(PIXELS[cause](rows[..., 0], rows[..., 1]), axis=-1)
    rows[:, :others, :2] += np.arange(1, others + 1)[:, None] * [7.3, -11.7]
    expected = {("REPROJECTION_DISAGREES", cause): FRAMES * POINTS} if found else {}
    causes = diagnosed(rows, XYZ)
    assert {key: causes[key] for key in causes if key[0] != "DEPTH_DISAGREES"} == expected


DEPTHS: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "have depth_m 1000 times too large: millimetres": lambda z, ray: 1000 * z,
    "have depth_m 1000 times too small: kilometres": lambda z, ray: z / 1000,
    "have depth_m 100 times too large: centimetres": lambda z, ray: 100 * z,
    "have the length of the ray as depth_m; required: planar z": lambda z, ray: z * ray,
    "have a negative depth_m: the camera looks along -z (OpenGL)?": lambda z, ray: -z,
    "have 1 / z as depth_m: disparity": lambda z, ray: 1 / z,
    "have a depth_m of 1.001 times the camera-space z": lambda z, ray: 1.001 * z,
    "have a depth_m that differs by +0.1500 m": lambda z, ray: z + 0.15,
}


@pytest.mark.parametrize("cause", DEPTHS)
def test_a_cause_explains_nearly_all_depths(cause: str) -> None:
    rows = right_rows()
    at = np.stack([c.to_camera(xyz) for c, xyz in zip(CAMERAS, XYZ, strict=True)])
    rows[..., 2] = DEPTHS[cause](rows[..., 2], np.linalg.norm(at, axis=-1) / at[..., 2])
    rows[:, 0, 2] *= 1.7
    rows[:, :, :2] += np.random.default_rng(1).normal(0, 9, rows[:, :, :2].shape)
    assert diagnosed(rows, XYZ) == {("DEPTH_DISAGREES", cause): FRAMES * POINTS}
    rows[:, 1:3, 2] *= 1.7
    assert diagnosed(rows, XYZ) == {}


TURN = np.diag([1.0, -1.0, -1.0, 1.0])
OTHER_CAMERAS: dict[str, Callable[[int], Camera]] = {
    "fit the inverse pose: camera_to_world?": lambda k: replace(
        CAMERAS[k], world_to_camera=np.linalg.inv(CAMERAS[k].world_to_camera)
    ),
    "fit a camera with y up and z backward (OpenGL, Blender)": lambda k: replace(
        CAMERAS[k], world_to_camera=TURN @ CAMERAS[k].world_to_camera
    ),
    "fit the camera of another frame: shifted by one frame": lambda k: CAMERAS[(k + 1) % FRAMES],
    "fit the camera of frame 3: another frame's camera": lambda k: CAMERAS[3],
}


@pytest.mark.parametrize("cause", OTHER_CAMERAS)
def test_another_camera(cause: str) -> None:
    used = [OTHER_CAMERAS[cause](frame) for frame in range(FRAMES)]
    rows = np.stack([camera.project(xyz) for camera, xyz in zip(used, XYZ, strict=True)])
    both = {(code, cause) for code in ("REPROJECTION_DISAGREES", "DEPTH_DISAGREES")}
    assert set(diagnosed(rows, XYZ)) == both


@pytest.mark.parametrize(
    ("cause", "written"),
    [
        ("have a world position 1000 times too large: millimetres", lambda x: 1000 * x),
        ("have a world position 100 times too large: centimetres", lambda x: 100 * x),
        ("have a world position 0.001 times too large: kilometres", lambda x: x / 1000),
        ("x, y, z are written as xzy", lambda x: x[..., [0, 2, 1]]),
        ("x, y, z are written as yxz", lambda x: x[..., [1, 0, 2]]),
        ("x, y, z are written as zyx", lambda x: x[..., [2, 1, 0]]),
        ("x, y, z are written as yzx", lambda x: x[..., [2, 0, 1]]),
        ("x, y, z are written as zxy", lambda x: x[..., [1, 2, 0]]),
        ("have a world axis turned round: y up, or z down?", lambda x: x * [1, -1, 1]),
        ("have a world axis turned round: y up, or z down?", lambda x: x * [1, 1, -1]),
        ("have a world axis turned round: y up, or z down?", lambda x: x * [-1, 1, 1]),
        (
            "have a world axis turned round: y up, or z down?",
            lambda x: (x * [1, -1, 1])[..., [0, 2, 1]],
        ),
    ],
)
def test_other_world_positions(cause: str, written: Callable[[FloatArray], FloatArray]) -> None:
    found = diagnosed(right_rows(), written(XYZ))
    assert {code for code, _ in found} == {"REPROJECTION_DISAGREES", "DEPTH_DISAGREES"}
    assert all(text.endswith(cause) for _, text in found)


def test_a_cause_is_looked_for_only_where_nearly_all_rows_are_wrong() -> None:
    rows = right_rows() + np.array([0.5, 0.5, 0.1])
    assert len(diagnosed(rows, XYZ, wrong=0.9)) == 2
    assert diagnosed(rows, XYZ, wrong=0.85) == {}


A, B = np.meshgrid(np.arange(-1.0, 3), np.arange(-1.0, 3))  # u and v from the inner cell's corner
CELL, FOCAL, CENTRE = np.array([30, 17]), np.array([100.0, 120.0]), np.array([23.5, 41.2])


def measured(
    material: FloatArray, depth: FloatArray, inside: tuple[float, float]
) -> list[Measured]:
    """Measure a point, if it can be, at a place of its cell, 0 to 1; (4, 4, 2), (4, 4) around."""
    K = np.array([[FOCAL[0], 0, CENTRE[0]], [0, FOCAL[1], CENTRE[1]], [0, 0, 1]])
    sample = Sample(
        frame=np.array([5]),
        uv_px=(CELL + 0.5 + inside)[None],
        depth_m=np.array([2.0]),
        queried=np.array([True]),
        K=K[None],
        cell=CELL[None],
        material=material[None],
        shown_m=depth[None].astype(np.float32),
    )
    return Alignment([sample]).frames()


def test_a_flat_patch_is_measured_exactly() -> None:
    J = np.array([[0.02, 0.005], [-0.01, 0.04]])
    inside, shift = np.array([0.3, 0.6]), np.array([0.11, -0.23])
    away = np.stack([A, B], axis=-1) - inside - shift
    slope = (CELL + 0.5 + inside - CENTRE) / FOCAL
    tilted = 1 / (0.5 + 0.01 * (A - 0.3) - 0.02 * (B - 0.6))
    [found] = measured(away @ J.T, tilted, (0.3, 0.6))
    assert found.offset_px[0] == pytest.approx(shift)
    assert found.shown_m[0] == pytest.approx(2.0, rel=1e-6)
    assert found.ray[0] == pytest.approx(np.sqrt(1 + (slope**2).sum()))
    assert found.footprint_m[0] == pytest.approx(2 / 100)
    for bound in (found.error_px, found.bend_px, found.noise_px):
        assert bound[0] == pytest.approx(0, abs=1e-12)
    [found] = measured(away @ J.T, np.full((4, 4), 2.0), (0.3, 0.6))
    sides = np.linalg.inv(J) * (2 / FOCAL)[:, None]  # metres in the image plane for one unit
    assert found.metres[0] == pytest.approx(np.linalg.norm(sides, axis=0))


def test_metres_on_a_surface_that_recedes() -> None:
    """Depth grows by 1/8 m from one column of pixels to the next: from 2 m at u = 30.5 px."""
    [found] = measured(np.stack([A, B], axis=-1), 2 + A / 8, (0.5, 0.5))
    along_u = ((31.5 - 23.5) * 2.125 - (30.5 - 23.5) * 2) / 100, (18 - 41.2) / 120 / 8, 1 / 8
    assert found.metres[0] == pytest.approx([np.linalg.norm(along_u), 2.0625 / 120])


def test_curvature_and_noise_of_a_patch() -> None:
    p, q, r, t = 0.03, 0.02, 0.01, 0.004
    curved = np.stack([A + p * A**2, B + q * B**2], axis=-1)
    [found] = measured(curved, 2 + r * A**2 - r * B**2, (0.5, 0.5))
    expected = ((1 + q) * 2 * p + (1 + p) * 2 * q) / (8 * (1 + p) * (1 + q))
    assert found.bend_px[0] == pytest.approx(expected)
    assert found.error_px[0] == pytest.approx(expected)
    assert found.bend_depth[0] == pytest.approx(4 * r / 8 / 0.02, rel=1e-4)
    # The third differences of t u^3 are 6 t along u and 0 along v: their median is 3 t.
    noisy = np.stack([A + t * A**3, B], axis=-1)
    [found] = measured(noisy, 2 + t * B**3, (0.5, 0.5))
    size = 3 * t / (0.6745 * np.sqrt(20))
    assert found.noise_px[0] == pytest.approx(size / (1 + t))
    assert found.noise_depth[0] == pytest.approx(size / 0.02, rel=1e-3)
    [found] = measured(noisy[..., ::-1], 2 + t * B**3, (0.5, 0.5))
    assert found.noise_px[0] == pytest.approx(size / (1 + t))


@pytest.mark.parametrize(("jump", "left"), [(9.9, 1), (10.1, 0)])
def test_a_jump_is_no_surface(jump: float, left: int) -> None:
    """A step six times the usual ones along u and v together; here it is one more in a corner."""
    torn = np.stack([A, B], axis=-1)
    torn[0, 0] -= jump / 2
    assert len(measured(torn, np.full((4, 4), 2.0), (0.5, 0.5))) == left


@pytest.mark.parametrize(("angle", "left"), [(0.025, 1), (0.015, 0)])
def test_material_needs_two_directions(angle: float, left: int) -> None:
    flat = np.stack([A + B, np.cos(angle) * (A + B) + np.sin(angle) * (A - B)], axis=-1)
    assert len(measured(flat, np.full((4, 4), 2.0), (0.5, 0.5))) == left


class Fixed(Alignment):
    """Points already measured."""

    def __init__(self, *parts: Measured) -> None:
        super().__init__()
        self.parts = list(parts)

    def frames(self) -> list[Measured]:
        return self.parts


def points(count: int = 40, frame: int = 0, **changes: FloatArray | float) -> Measured:
    """Points in order, about 1.5 m away, with small errors of all kinds."""
    rng = np.random.default_rng(frame)
    small = {name: np.full(count, 0.01) for name in ("error_px", "bend_px", "noise_px")}
    depth = rng.uniform(1, 2, count)
    found = Measured(
        frame=np.full(count, frame),
        offset_px=rng.uniform(-0.02, 0.02, (count, 2)),
        depth_m=depth,
        shown_m=depth.copy(),
        ray=rng.uniform(1.02, 1.2, count),
        footprint_m=depth / 100,
        bend_depth=np.full(count, 0.01),
        noise_depth=np.full(count, 0.01),
        metres=np.tile([0.5, 0.5], (count, 1)),
        **small,
    )
    changed = {
        name: np.broadcast_to(value, getattr(found, name).shape) for name, value in changes.items()
    }
    return replace(found, **changed)


CLOTH = Tier.from_document(TIERS["cloth-1"])


def agreement(*parts: Measured) -> dict[str, str]:
    """Return code -> the message of its first issue."""
    findings = Findings()
    other_depth = check_agreement(CLOTH, Fixed(*parts), Fixed(), findings.at("table"))
    assert other_depth is ("DEPTH_IMAGE_DISAGREES" in findings.counts)
    return {issue.code: issue.message for issue in reversed(findings.listed())}


def test_points_in_order_have_no_issue() -> None:
    assert agreement(points()) == {}
    assert agreement(points(11, offset_px=2.0)) == {}
    assert set(agreement(points(12, offset_px=2.0))) == {"OFFSET_DISAGREES"}


@pytest.mark.parametrize(
    ("offset", "says"),
    [
        (
            (-0.5, -0.5),
            "(+0.5, +0.5) px from where the surface layer shows the points' material: pixel",
        ),
        ((0.0, 0.5), "pixel centres at whole numbers"),
        ((1.0, -2.0), "shifted by whole pixels"),
        ((0.3, 0.0), "shifted, or of another camera"),
        ((0.12, 0.0), "shifted, or of another camera"),
    ],
)
def test_a_shift_is_named(offset: tuple[float, float], says: str) -> None:
    whole = points(offset_px=np.array(offset) + points().offset_px / 10)
    assert says in agreement(whole)["OFFSET_DISAGREES"]
    one = agreement(
        *(points(frame=frame) for frame in range(4)), replace(whole, frame=0 * whole.frame + 7)
    )
    assert says in one["OFFSET_DISAGREES"]


def test_a_shift_of_a_twelfth_of_a_pixel_is_left_alone() -> None:
    assert agreement(points(offset_px=np.array([0.09, -0.09]))) == {}


@pytest.mark.parametrize(
    ("size", "error", "found"), [(0.13, 0.01, True), (0.1, 0.01, False), (0.13, 0.05, False)]
)
def test_scattered_positions(size: float, error: float, found: bool) -> None:
    offset = size * np.tile([[1, 1], [1, -1], [-1, 1], [-1, -1]], (10, 1))
    assert ("OFFSET_SCATTERS" in agreement(points(offset_px=offset, error_px=error))) is found


@pytest.mark.parametrize(
    ("noise", "bend", "found"), [(0.13, 0.01, True), (0.11, 0.01, False), (0.13, 0.02, False)]
)
def test_noisy_material(noise: float, bend: float, found: bool) -> None:
    issues = agreement(points(noise_px=noise, bend_px=bend))
    assert set(issues) == ({"SURFACE_NOISY"} if found else set())


DEPTH = points().depth_m
DEPTH_IMAGES: dict[str, FloatArray] = {
    "are 1000 times depth_m: millimetres?": 1000 * DEPTH,
    "are 100 times depth_m: centimetres?": 96 * DEPTH,
    "are 0.001 times depth_m: kilometres?": 0.00104 * DEPTH,
    "have the length of the ray; required: planar z": DEPTH * points().ray,
    "they differ by about +50.0 mm": DEPTH + 0.05,
    "they are about 1.2 times depth_m": 1.2 * DEPTH,
    "they are about 0.93 times depth_m": 0.93 * DEPTH,
    "of another frame or another camera?": DEPTH + np.tile([0.1, 0.3], 20),
}


@pytest.mark.parametrize("says", DEPTH_IMAGES)
def test_other_depths_are_named(says: str) -> None:
    issues = agreement(points(shown_m=DEPTH_IMAGES[says]))
    assert set(issues) == {"DEPTH_IMAGE_DISAGREES"}
    assert issues["DEPTH_IMAGE_DISAGREES"].endswith(says)


@pytest.mark.parametrize(("footprints", "found"), [(0.19, True), (0.16, False)])
def test_the_limit_of_a_depth_that_differs(footprints: float, found: bool) -> None:
    """0.15 footprints and 2.2 times what the interpolation explains."""
    shown = DEPTH * (1 + footprints / 100)
    assert ("DEPTH_IMAGE_DISAGREES" in agreement(points(shown_m=shown))) is found


@pytest.mark.parametrize(
    ("scatter", "noise", "bend", "found"),
    [
        (0.07, 0.01, 0.01, True),
        (0.06, 0.01, 0.01, False),
        (0.07, 0.01, 0.03, False),
        (0, 0.15, 0.01, True),
        (0, 0.13, 0.01, False),
        (0, 0.15, 0.02, False),
    ],
)
def test_noisy_depth(scatter: float, noise: float, bend: float, found: bool) -> None:
    """Twice the scatter, or the noise, over 0.1 and what curvature explains."""
    shown = DEPTH * (1 + scatter / 100 * np.tile([1, -1], 20))
    issues = agreement(points(shown_m=shown, noise_depth=noise, bend_depth=bend))
    assert set(issues) == ({"DEPTH_IMAGE_SCATTERS"} if found else set())


@pytest.mark.parametrize(
    ("metres", "says"),
    [
        ((0.5 * 2.9, 0.5 / 2.9), ""),
        ((0.5 * 3.1, 0.5), "of u is 0.5, the images show 0.5"),
        ((0.5, 0.5 / 3.5), "of v is 0.5, the images show 0.05"),
        ((5.0, 500.0), "of u is 0.5, the images show 5; of v is 0.5, the images show 500"),
    ],
)
def test_metres_of_the_material(metres: tuple[float, float], says: str) -> None:
    found = points(metres=np.array(metres))
    assert says in agreement(found).get("SCALE_DISAGREES", "")
    assert bool(agreement(found)) == bool(says)
    few = found.metres.copy()
    few[11:] = np.nan
    assert agreement(replace(found, metres=few)) == {}
