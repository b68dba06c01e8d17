"""One cause for many wrong rows, made by hand, and the limits where there is none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from pliant.spec.arrays import FloatArray
from pliant.spec.camera import Camera
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.diagnosis import (
    RowSample,
    _Compared,
    _depth_cause,
    _most,
    _near,
    _pixel_cause,
    diagnose_rows,
)
from tests.spec.validation.world import rows_at

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
BOTH = {"REPROJECTION_DISAGREES": 1.0, "DEPTH_DISAGREES": 1.0}
LINEAR = "fit another K and pose: those of another sequence, or of another world frame?"
XYZ = np.random.default_rng(0).uniform(-0.3, 0.3, (FRAMES, POINTS, 3))


def causes(
    uvz: FloatArray,
    xyz: FloatArray,
    wrong: Mapping[str, float] = MappingProxyType(BOTH),
    cameras: Sequence[Camera] = CAMERAS,
) -> Findings:
    """Look for the cause of tables (F, P, 3) of whose rows a share is called wrong by a code."""
    findings, sample = Findings(), RowSample()
    problems = findings.at("table")
    for frame, (projected, placed) in enumerate(zip(uvz, xyz, strict=True)):
        sample.add(rows_at(frame, projected, placed))
        for code, share in wrong.items():
            bad = np.arange(POINTS) < share * POINTS
            problems.add_rows(code, bad, lambda index: (str(index), "wrong"))
    problems.add("OUT_OF_FRAME_DISAGREES", "", "x")
    diagnose_rows(sample, cameras, SIZE, problems)
    return findings


def diagnosed(
    uvz: FloatArray, xyz: FloatArray, wrong: float = 1.0, cameras: Sequence[Camera] = CAMERAS
) -> dict[tuple[str, str], int]:
    """Return (code, cause) -> rows of wrong positions and depths."""
    findings = causes(uvz, xyz, dict.fromkeys(BOTH, wrong), cameras)
    found = {key: files[0][1] for key, files in findings.diagnoses.items()}
    return {key: rows for key, rows in found.items() if key[0] in BOTH}


def right_rows() -> FloatArray:
    return np.stack([c.project(xyz) for c, xyz in zip(CAMERAS, XYZ, strict=True)])


@pytest.mark.parametrize(("others", "found"), [(1, True), (3, False)])
def test_a_cause_explains_nearly_all_positions(others: int, found: bool) -> None:
    """Of 40 rows a frame one may be another mistake; three are too many."""
    rows = right_rows()
    rows[..., 1] = HEIGHT - rows[..., 1]
    rows[:, :others, :2] += np.arange(1, others + 1)[:, None] * [7.3, -11.7]
    key = ("REPROJECTION_DISAGREES", "have v upwards: count v from the top of the image")
    explained = diagnosed(rows, XYZ)
    assert {k: n for k, n in explained.items() if k[0] != "DEPTH_DISAGREES"} == (
        {key: FRAMES * POINTS} if found else {}
    )


def test_a_cause_explains_nearly_all_depths() -> None:
    rows = right_rows()
    at = np.stack([c.to_camera(xyz) for c, xyz in zip(CAMERAS, XYZ, strict=True)])
    rows[..., 2] = np.linalg.norm(at, axis=-1)
    rows[:, 0, 2] *= 1.7
    rows[:, :, :2] += np.random.default_rng(1).normal(0, 9, rows[:, :, :2].shape)
    cause = "have the length of the ray as depth_m; required: planar z"
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
    "fit the camera of another frame: shifted by one frame ": lambda k: CAMERAS[k - 1],
    "fit the camera of frame 3: another frame's camera": lambda k: CAMERAS[3],
}


@pytest.mark.parametrize("cause", OTHER_CAMERAS)
def test_another_camera(cause: str) -> None:
    used = [OTHER_CAMERAS[cause](frame) for frame in range(FRAMES)]
    rows = np.stack([camera.project(xyz) for camera, xyz in zip(used, XYZ, strict=True)])
    both = {(code, cause.strip()) for code in ("REPROJECTION_DISAGREES", "DEPTH_DISAGREES")}
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


def test_few_cameras_are_not_shifted() -> None:
    """Of two frames the other one's camera is named; one frame has no other."""
    rows = np.stack([CAMERAS[1].project(xyz) for xyz in XYZ[:2]])
    found = diagnosed(rows[:1], XYZ[:1], cameras=CAMERAS[:1])
    assert {cause for _, cause in found} == {LINEAR}
    found = diagnosed(rows, XYZ[:2], cameras=CAMERAS[:2])
    assert {cause for _, cause in found} == {"fit the camera of frame 1: another frame's camera"}


def test_a_camera_of_another_sequence() -> None:
    """Any K and pose is found, in each frame its own, from 16 rows of it."""
    K = np.array([[80.0, 0, 60], [0, 81, 70], [0, 0, 1]])
    others = [replace(CAMERAS[-1 - k], K=K + np.diag([k, k, 0])) for k in range(FRAMES)]
    rows = np.stack([c.project(xyz) for c, xyz in zip(others, XYZ, strict=True)])
    assert diagnosed(rows, XYZ) == {(code, LINEAR): FRAMES * POINTS for code in BOTH}
    noisy = rows + np.random.default_rng(0).normal(0, 0.1, rows.shape) * [1, 1, 0]
    assert diagnosed(noisy, XYZ) == {}
    for count in (15, 16):
        sample, problems = RowSample(), Findings().at("table")
        sample.add(rows_at(0, rows[0, :count], XYZ[0, :count]))
        problems.add_rows("DEPTH_DISAGREES", np.ones(count, bool), lambda _: ("", ""))
        diagnose_rows(sample, CAMERAS, SIZE, problems)
        assert bool(problems.findings.diagnoses) is (count == 16)


@pytest.mark.parametrize(("step", "name"), [(-1, "after"), (1, "before")])
def test_projections_of_another_frame(step: int, name: str) -> None:
    cameras = CAMERAS[:1] * FRAMES
    right = np.stack([CAMERAS[0].project(xyz) for xyz in XYZ])
    cause = f"have the u_px, v_px and depth_m of the frame {name}"
    found = diagnosed(np.roll(right, step, axis=0), XYZ, cameras=cameras)
    assert found == {(code, cause): FRAMES * POINTS for code in BOTH}


def test_rows_and_frames_are_sampled() -> None:
    """At most 64 rows of a frame, the first and the last among them, and 64 frames."""
    sample = RowSample()
    for frame in range(70):
        count = 1000 if frame == 0 else 5
        xyz = np.repeat(np.arange(count)[:, None], 3, axis=1).astype(float)
        sample.add(rows_at(frame, xyz, xyz))
    assert sample.checked == 1000 + 69 * 5
    assert [rows.frame for rows in sample.rows] == list(range(64))
    first, second = (rows.point for rows in sample.rows[:2])
    assert (len(first), first[0], first[-1]) == (64, 0, 999)
    assert set(np.diff(first)) <= {15, 16}
    assert second.tolist() == [0, 1, 2, 3, 4]


def test_what_nearly_all_rows_are() -> None:
    for good, of, most in ((4, 4, True), (3, 3, False), (19, 20, True), (18, 20, False)):
        assert _most(np.arange(of) < good) is most
    zero = np.zeros((4, 2))
    for far, gap, near in ((0, 0.0199, True), (0, 0.0201, False), (1e4, 0.1199, True),
                           (-1e4, 0.1199, True), (1e4, 0.1201, False)):  # fmt: skip
        predicted = zero + np.array([0, far])
        for axis in ((gap, 0), (0, -gap)):
            assert _near(predicted + axis, predicted) is near, (far, gap)
    assert _near(zero + 0.0009, zero, 1e-3)
    assert not _near(zero + 0.0011, zero, 1e-3)


def compared(uv: FloatArray, depth: FloatArray) -> _Compared:
    """Four rows far apart in the image, at other depths."""
    return _Compared(uv, depth, RIGHT_UV, RIGHT_Z, np.full(4, 1.3))


RIGHT_UV = np.array([[10.0, 100], [150, 20], [80, 7], [35, 64]])
RIGHT_Z = np.array([1.0, 2, 3, 5])
SIGNS = np.array([[1, -1], [-1, 1], [1, 1], [-1, -1]])


@pytest.mark.parametrize(
    ("uv", "cause"),
    [
        (RIGHT_UV * [1, -1] + [0, HEIGHT], "have v upwards: count v from the top of the image"),
        (RIGHT_UV * [-1, 1] + [WIDTH, 0], "have u leftwards: count u from the left of the image"),
        (SIZE - RIGHT_UV, "are turned by 180 degrees"),
        (RIGHT_UV[:, ::-1], "have u and v exchanged: swapped axes"),
        (RIGHT_UV - 0.5 + 0.0199 * SIGNS, "differ by (-0.50, -0.50) px: OpenCV convention?"),
        (RIGHT_UV + np.array([-0.519, -0.481]), "differ by (-0.52, -0.48) px: OpenCV convention?"),
        (RIGHT_UV + np.array([-0.521, -0.5]), "differ by (-0.52, -0.50) px"),
        (RIGHT_UV + np.array([-0.5, 0.5]), "differ by (-0.50, +0.50) px: half a pixel too much?"),
        (RIGHT_UV / SIZE + 0.0009, "are in [0, 1]: divided by the image size; multiply by it"),
        (RIGHT_UV / SIZE + 0.0012 * SIGNS, None),
        (2 * RIGHT_UV / SIZE - 1.0009, "are in [-1, 1]: normalised device coordinates"),
        (2 * RIGHT_UV / SIZE - 1 + 0.0012 * SIGNS, None),
        (RIGHT_UV + 0.5 * SIGNS, "are rounded to pixels: positions are never rounded"),
        (RIGHT_UV + 1.5 * SIGNS, None),
        (RIGHT_UV + 1.00004 * SIGNS, "are rounded to pixels: positions are never rounded"),
        (RIGHT_UV + 1.00006 * SIGNS, None),
        (RIGHT_UV + 0.1 * SIGNS, "are rounded to tenths of pixels: positions are never rounded"),
        (RIGHT_UV + 0.2 * SIGNS, "are rounded to tenths of pixels: positions are never rounded"),
        (RIGHT_UV + 0.3 * SIGNS, None),
        (RIGHT_UV + 0.11 * SIGNS, None),
        (RIGHT_UV * 1.0009, None),
        (RIGHT_UV * 1.0011, "are 1.001 times the projection: images of another size?"),
        (RIGHT_UV * 0.9, "are 0.9 times the projection: images of another size?"),
        (RIGHT_UV * [0.9, 0.8], None),
    ],
)
def test_limits_of_a_cause_of_positions(uv: FloatArray, cause: str | None) -> None:
    assert _pixel_cause(compared(uv, RIGHT_Z), SIZE) == cause


OFF = np.array([1, -1, 1, -1])


@pytest.mark.parametrize(
    ("depth", "cause"),
    [
        (1000 * RIGHT_Z * (1 + 0.99e-4 * OFF), "have depth_m 1000 times too large: millimetres"),
        (RIGHT_Z / 1000, "have depth_m 1000 times too small: kilometres"),
        (100 * RIGHT_Z, "have depth_m 100 times too large: centimetres"),
        (1 / RIGHT_Z, "have 1 / z as depth_m: disparity"),
        (-RIGHT_Z * (1 + 0.99e-4 * OFF), "have a negative depth_m: the camera looks along -z "
                                         "(OpenGL)?"),
        (-RIGHT_Z * (1 + 1.01e-4 * OFF), None),
        (RIGHT_Z * 1.00011, "have a depth_m of 1 times the camera-space z"),
        (RIGHT_Z + 0.001, "have a depth_m that differs by +0.0010 m"),
    ],
)  # fmt: skip
def test_limits_of_a_cause_of_depths(depth: FloatArray, cause: str | None) -> None:
    assert _depth_cause(compared(RIGHT_UV, depth)) == cause


def test_each_code_is_explained_by_itself() -> None:
    """Positions are all wrong, depths for a half: these stay, and so do other codes."""
    findings = causes(
        right_rows() + np.array([0.5, 0.5, 0.15]), XYZ, BOTH | {"DEPTH_DISAGREES": 0.5}
    )
    assert [code for code, _ in findings.diagnoses] == ["REPROJECTION_DISAGREES"]
    assert findings.counts == {
        "REPROJECTION_DISAGREES": FRAMES * POINTS, "DEPTH_DISAGREES": FRAMES * POINTS // 2,
        "OUT_OF_FRAME_DISAGREES": 1,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("moved", "deeper", "found"),
    [(0.039, 1.39e-4, True), (0.041, 0, False), (-0.039, -1.39e-4, True), (0, 1.42e-4, False)],
)
def test_a_camera_explains_what_is_out_of_the_frame_too(
    moved: float, deeper: float, found: bool
) -> None:
    """Within 0.04 px, 2e-5 m and 1e-4 of the depth, 1.2 m, of what the explanation says."""
    uvz = np.stack([c.project(xyz / 1000) for c, xyz in zip(CAMERAS, XYZ, strict=True)])
    uvz += np.array([moved, -moved, deeper])
    findings = causes(uvz, XYZ, {"REPROJECTION_DISAGREES": 1})
    cause = "have a world position 1000 times too large: millimetres"
    codes = ("REPROJECTION_DISAGREES", "OUT_OF_FRAME_DISAGREES")
    assert [*findings.diagnoses] == [(code, cause if found else LINEAR) for code in codes]


def test_rows_behind_the_camera_have_no_cause() -> None:
    behind = [replace(c, world_to_camera=np.diag([1, 1, -1, 1.0]) @ c.world_to_camera)
              for c in CAMERAS]  # fmt: skip
    rows = right_rows() + np.array([3, 5, 0.15])
    assert diagnosed(rows, XYZ, cameras=behind) == {}
    diagnose_rows(RowSample(), CAMERAS, SIZE, Findings().at("table"))
