"""The rows of correspondences.parquet: their keys, and where each is seen, at every limit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.spec.camera import Camera
from pliant.spec.conventions import OUT_OF_FRAME, VISIBILITY_STATES, VISIBLE
from pliant.spec.io import limits
from pliant.spec.tables import CORRESPONDENCES
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules import correspondences
from pliant.spec.validation.rules.correspondences import check_keys, check_projection, frame_rows
from pliant.spec.validation.rules.tables import CheckedTable, check_table
from tests.spec.validation.world import SIZE, context, places, rows_at

WIDTH, HEIGHT = SIZE
FRONT = np.eye(4)
"""At the origin, looks along z."""

FAR = np.eye(4)
FAR[0, 3] = -1e4
"""At x = 10 km: what float32 rounds there is seen."""


def camera(pose: Any = FRONT, centre: tuple[float, float] = (32, 24), fx: float = 100.0) -> Camera:
    K = np.array([[fx, 0, centre[0]], [0, 150, centre[1]], [0, 0, 1]])
    return Camera(K, pose, SIZE)


def state_at(u: float, v: float) -> int:
    return VISIBLE if 0 <= u < WIDTH and 0 <= v < HEIGHT else OUT_OF_FRAME


def problems_of(
    seen_by: Camera,
    xyz: tuple[float, float, float],
    *,
    moved: tuple[float, float] = (0, 0),
    deeper: float = 0.0,
    state: int | None = None,
) -> set[str]:
    """Return the codes of the second of two rows; the first one, on the axis, is right."""
    place = np.array([[0, 0, 2], xyz], np.float64)
    place[0] -= seen_by.world_to_camera[:3, 3]
    uvz = seen_by.project(place)
    states = [state_at(u, v) if z > 0 else OUT_OF_FRAME for u, v, z in uvz.tolist()]
    if state is not None:
        states[1] = state
    uvz[1] += [*moved, deeper]
    rows = rows_at(3, uvz, place, np.array(states, np.int32), np.array([4, 9], np.int32))
    findings = Findings()
    good = check_projection(context(), seen_by, rows, findings.at("table"))
    assert good.tolist() == [True, not findings.counts], findings.issues
    assert {issue.where for issue in findings.issues} <= {"frame 3, point 9"}
    assert findings.total == len(findings.counts)
    return set(findings.counts)


@pytest.mark.parametrize(
    ("pose", "xyz", "most"),
    [
        # 10 um, and a millionth of the largest coordinate and of z.
        (FRONT, (0.1, 0.1, 2.0), 1.4e-5),
        (FRONT, (0.1, 3.0, 2.0), 1.5e-5),
        (FRONT, (0.1, 0.1, -2.0), 1.4e-5),
        (FAR, (1e4, 0.5, 2.0), 1e-5 + 1e-2 + 2e-6),
    ],
)
def test_depth_is_that_of_the_position(
    pose: Any, xyz: tuple[float, float, float], most: float
) -> None:
    for sign in (1, -1):
        for deeper, found in ((0.9999 * most, set()), (1.0001 * most, {"DEPTH_DISAGREES"})):
            assert problems_of(camera(pose), xyz, deeper=sign * deeper) == found


@pytest.mark.parametrize(
    ("seen_by", "xyz", "most"),
    [
        # 0.01 px; 3e-7 of 150 px (the larger focal length) and of the largest of u and v.
        (camera(), (0, 0, 2), 0.01 + 3e-7 * (150 + 32)),
        (camera(), (0.2, 0.3, 2), 0.01 + 3e-7 * (150 + 22.5 + 46.5)),
        # 10 km over 2 m, and a place 100 or 150 px from the axis.
        (camera(FAR), (1e4 + 2, 0, 2), 0.01 + 3e-7 * (250 * 5001 + 132)),
        (camera(FAR), (1e4, 2, 2), 0.01 + 3e-7 * (300 * 5000 + 174)),
        (camera(FAR), (1e4, 1, 1), 0.01 + 3e-7 * (300 * 10000 + 174)),
        # A focal length far too small does not widen what rounding explains.
        (camera(fx=1e-300), (0.2, 0.3, 2), 0.01 + 3e-7 * (150 + 22.5 + 46.5)),
        # The image of a camera whose axis is a million pixels away.
        (camera(centre=(1e6, 24)), (0, 0, 2), 0.01 + 3e-7 * (150 + 1e6)),
        (camera(centre=(32, 2e6)), (0, 0, 2), 0.01 + 3e-7 * (150 + 2e6)),
    ],
)
def test_a_position_is_seen_where_the_table_says(
    seen_by: Camera, xyz: tuple[float, float, float], most: float
) -> None:
    for axis in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        for size, found in ((0.999 * most, set()), (1.001 * most, {"REPROJECTION_DISAGREES"})):
            moved = (axis[0] * size, axis[1] * size)
            assert problems_of(seen_by, xyz, moved=moved) == found, (axis, size)


@pytest.mark.parametrize(
    ("z", "state", "found"),
    [
        (1.5e-6, OUT_OF_FRAME, {"REPROJECTION_DISAGREES"}),
        (1.5e-6, VISIBLE, {"REPROJECTION_DISAGREES"}),
        (0.5e-6, OUT_OF_FRAME, set()),  # in the camera's plane: u_px, v_px mean nothing
        (0.5e-6, VISIBLE, {"OUT_OF_FRAME_DISAGREES"}),
        (-1.0, OUT_OF_FRAME, set()),
        (-1.0, VISIBLE, {"OUT_OF_FRAME_DISAGREES"}),
    ],
)
def test_what_is_behind_the_camera_is_out_of_frame(z: float, state: int, found: set[str]) -> None:
    assert problems_of(camera(), (0, 0, z), moved=(1, -1), state=state) == found


@pytest.mark.parametrize(
    ("u", "v", "allowed"),
    [
        (0.0009, 24, "both"),
        (0.0011, 24, "in"),
        (-0.0009, 24, "both"),
        (-0.0011, 24, "out"),
        (63.9989, 24, "in"),
        (64.0011, 24, "out"),
        (32, 0.0011, "in"),
        (32, -0.0011, "out"),
        (32, 47.9991, "both"),
        (32, 47.9989, "in"),
        (32, 48.0011, "out"),
    ],
)
def test_a_thousandth_of_a_pixel_decides_at_the_border(u: float, v: float, allowed: str) -> None:
    xyz = ((u - 32) / 100 * 2, (v - 24) / 150 * 2, 2)
    for state, name in ((VISIBLE, "in"), (OUT_OF_FRAME, "out")):
        found = problems_of(camera(), xyz, state=state)
        assert found == (set() if allowed in (name, "both") else {"OUT_OF_FRAME_DISAGREES"}), name


Keys = Sequence[tuple[int, int]]


def table(
    path: Path, keys: Keys, row_group_size: int = 100, **columns: Any
) -> tuple[CheckedTable, Findings]:
    """Write rows whose numbers all differ, and open them."""
    count = len(keys)
    values: dict[str, Any] = {
        name: np.arange(count, dtype=np.float32) + start
        for start, name in zip(
            range(0, 600, 100), ("u_px", "v_px", "depth_m", "x_m", "y_m", "z_m"), strict=True
        )
    }
    values["frame"], values["point"] = zip(*keys, strict=True)
    values["visibility"] = [VISIBILITY_STATES[k % 4] for k in range(count)]
    values |= columns
    rows = pa.table([pa.array(values[f.name], f.type) for f in CORRESPONDENCES], CORRESPONDENCES)
    footer = b'{"spec_version": "1.0.0", "table": "correspondences"}'
    rows = rows.replace_schema_metadata({"pliant": footer})
    pq.write_table(rows, path / "table.parquet", row_group_size=row_group_size)
    findings = Findings()
    file, problems = path / "table.parquet", findings.at("table")
    opened = check_table(file, "correspondences", problems, max_rows=100)
    assert opened is not None
    assert not findings.counts
    return opened, findings


ALL: Keys = [(frame, point) for frame in range(3) for point in range(2)]


@pytest.mark.parametrize(
    ("keys", "grouped", "expected"),
    [
        (ALL, True, []),
        ([ALL[1], ALL[0], *ALL[2:]], True, [("ROW_ORDER", "")]),
        ([*ALL[:1], ALL[2], ALL[1], *ALL[3:]], False, [("ROW_ORDER", "")]),
        (ALL[:-1], True, [("ROW_MISSING", "frame 2, point 1")]),
        ([*ALL[:4], ALL[1], *ALL[4:]], False, [("ROW_DUPLICATE", "frame 0, point 1")]),
        ([*ALL, (3, 0)], True, [("ROW_UNKNOWN", "row 6")]),
        ([(-1, 1), *ALL], True, [("ROW_UNKNOWN", "row 0")]),
        ([*ALL[:2], (1, -1), *ALL[2:]], True, [("ROW_UNKNOWN", "row 2")]),
        ([*ALL[:2], (0, 2), *ALL[2:]], True, [("ROW_UNKNOWN", "row 2")]),
    ],
)
def test_every_point_of_every_frame_has_one_row_in_order(
    keys: Keys, grouped: bool, expected: list[tuple[str, str]], tmp_path: Path
) -> None:
    for row_group_size in (100, 3, 2, 1):
        rows, findings = table(tmp_path, keys, row_group_size)
        assert check_keys(rows, 3, 2) is grouped
        assert places(findings) == expected


def test_more_rows_than_allowed_are_not_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for most, codes in ((6, set()), (5, {"FILE_TOO_LARGE"})):
        rows, findings = table(tmp_path, ALL)
        monkeypatch.setattr(limits, "MAX_CORRESPONDENCE_ROWS", most)
        assert check_keys(rows, 3, 2) is (not codes)
        assert set(findings.counts) == codes
        monkeypatch.undo()


@pytest.mark.parametrize("row_group_size", [100, 4, 3, 1])
def test_rows_are_handed_out_frame_by_frame(tmp_path: Path, row_group_size: int) -> None:
    rows, findings = table(tmp_path, ALL, row_group_size)
    found = list(frame_rows(rows, 3, 2, True))
    assert [each.frame for each in found] == [0, 1, 2]
    for frame, each in enumerate(found):
        first = np.array([2 * frame, 2 * frame + 1])
        assert each.point.tolist() == [0, 1]
        assert each.state.tolist() == (first % 4).tolist()
        np.testing.assert_array_equal(each.uv_px, np.stack([first, first + 100], axis=1))
        np.testing.assert_array_equal(each.depth_m, first + 200)
        np.testing.assert_array_equal(each.xyz_m, first[:, None] + [300, 400, 500])
    assert not findings.counts


@pytest.mark.parametrize("row_group_size", [100, 4, 1])
def test_rows_without_sound_values_are_left_out(tmp_path: Path, row_group_size: int) -> None:
    keys = [*ALL[:2], (1, 7), (1, -1), (1, 1), (-1, 0), (2, 0), (2, 1), (3, 0)]
    z = np.arange(9.0)
    z[4] = np.inf
    states = ["visible"] * 6 + ["hidden", "occluded", "visible"]
    rows, findings = table(tmp_path, keys, row_group_size, z_m=z, visibility=states)
    found = [(each.frame, each.point.tolist()) for each in frame_rows(rows, 3, 2, True)]
    assert found == [(0, [0, 1]), (2, [1])]
    assert sorted(places(findings)) == [
        ("VALUE_NOT_FINITE", "row 4, z_m"),
        ("VALUE_OUT_OF_RANGE", "row 6, visibility"),
    ]


def test_rows_in_another_order_are_put_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = [(1, 1), (0, 1), (2, 0), (1, 0), (0, 0), (2, 1)]
    for most, expected in (
        (6, [(0, [1, 0], [1, 4]), (1, [1, 0], [0, 3]), (2, [0, 1], [2, 5])]),
        (5, []),  # too many to be sorted in memory
    ):
        monkeypatch.setattr(correspondences, "_MAX_SORTED_ROWS", most)
        rows, _ = table(tmp_path, keys, 2)
        found = [
            (each.frame, each.point.tolist(), each.uv_px[:, 0].tolist())
            for each in frame_rows(rows, 3, 2, False)
        ]
        assert found == expected
