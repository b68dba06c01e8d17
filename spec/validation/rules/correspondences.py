"""Rules of correspondences.parquet: every point of every frame, and where it projects to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.camera import Camera
from pliant.spec.conventions import OUT_OF_FRAME, VISIBILITY_STATES
from pliant.spec.io import limits
from pliant.spec.io.parquet_columns import codes, stacked
from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.tables import CheckedTable, numbers, report_not_finite

PIXEL_TOLERANCE = 0.01
"""How far u_px, v_px may be from the projection of x_m, y_m, z_m, pixels."""

DEPTH_TOLERANCE_M = 1e-5
"""How far depth_m may be from the camera-space z of x_m, y_m, z_m, metres."""

BORDER_TOLERANCE = 1e-3
"""A point so near the image's border may be on either side of it, pixels."""

_FLOATS = ["u_px", "v_px", "depth_m", "x_m", "y_m", "z_m"]
_MAX_SORTED_ROWS = 2_000_000
_PER_ROW = ("point", "uv_px", "depth_m", "state", "xyz_m")


@dataclass(frozen=True)
class FrameRows:
    """Rows of one frame, all with finite values and known keys.

    Attributes:
        frame: The frame.
        point: int32 (N,).
        uv_px: float64 (N, 2).
        depth_m: float64 (N,).
        state: int32 (N,), index into `VISIBILITY_STATES`.
        xyz_m: float64 (N, 3), world metres.
    """

    frame: int
    point: npt.NDArray[np.int32]
    uv_px: npt.NDArray[np.float64]
    depth_m: npt.NDArray[np.float64]
    state: npt.NDArray[np.int32]
    xyz_m: npt.NDArray[np.float64]

    def where(self, index: int) -> str:
        """Return the place of a row for an issue."""
        return f"frame {self.frame}, point {self.point[index]}"

    def chosen(self, rows: npt.NDArray[Any]) -> FrameRows:
        """Return some of the rows, by their numbers or a mask."""
        return replace(self, **{name: getattr(self, name)[rows] for name in _PER_ROW})


def check_keys(table: CheckedTable, frames: int, points: int) -> bool:
    """Check that every point of every frame has one row, in order.

    Reports `ROW_UNKNOWN`, `ROW_DUPLICATE`, `ROW_MISSING` and `ROW_ORDER`.

    Args:
        table: The correspondences.
        frames: Frames of the sequence.
        points: Points of the sequence.

    Returns:
        True if the rows of a frame are together, so that they can be read frame by frame.
    """
    problems = table.problems
    if frames * points > limits.MAX_CORRESPONDENCE_ROWS:
        problems.add(
            "FILE_TOO_LARGE",
            "",
            f"{frames} frames of {points} points; required: at most "
            f"{limits.MAX_CORRESPONDENCE_ROWS} rows",
        )
        return False
    seen = np.zeros(frames * points, np.bool_)
    grouped = ordered = True
    last_frame, last_key = -1, -1
    for start, batch in table.batches(["frame", "point"]):
        frame = numbers(batch, "frame").astype(np.int64)
        point = numbers(batch, "point").astype(np.int64)
        known = (frame >= 0) & (frame < frames) & (point >= 0) & (point < points)
        problems.add_rows(
            "ROW_UNKNOWN",
            ~known,
            lambda i, s=start, f=frame, p=point: (  # type: ignore[misc]
                f"row {s + i}",
                f"frame {f[i]}, point {p[i]}; required: frame < {frames}, point < {points}",
            ),
        )
        key = (frame * points + point)[known]
        unique, counts = np.unique(key, return_counts=True)
        twice = unique[(counts > 1) | seen[unique]]
        problems.add_rows(
            "ROW_DUPLICATE",
            np.ones(len(twice), np.bool_),
            lambda i, t=twice: (  # type: ignore[misc]
                f"frame {t[i] // points}, point {t[i] % points}",
                "this point has more than one row",
            ),
        )
        seen[unique] = True
        steps = np.diff(np.concatenate([[last_key], key]))
        ordered &= bool(np.all(steps > 0))
        frame_steps = np.diff(np.concatenate([[last_frame], frame[known]]))
        grouped &= bool(np.all(frame_steps >= 0))
        if len(key):
            last_key, last_frame = int(key[-1]), int(frame[known][-1])
    problems.add_rows(
        "ROW_MISSING",
        ~seen,
        lambda i: (f"frame {i // points}, point {i % points}", "this point has no row"),
    )
    if not ordered and not problems.counts["ROW_DUPLICATE"]:
        problems.add("ROW_ORDER", "", "required: ascending by frame, then by point")
    return grouped


def frame_rows(table: CheckedTable, frames: int, points: int, grouped: bool) -> Iterator[FrameRows]:
    """Yield the rows of each frame, ascending by frame.

    Reports `VALUE_NOT_FINITE` and `VALUE_OUT_OF_RANGE`.

    Args:
        table: The correspondences.
        frames: Frames of the sequence.
        points: Points of the sequence.
        grouped: What `check_keys` returned.
    """
    columns = ["frame", "point", *_FLOATS, "visibility"]
    batches = table.batches(columns)
    if not grouped:
        if table.rows > _MAX_SORTED_ROWS:
            return
        whole = pa.concat_tables([batch for _, batch in batches])
        order = np.argsort(numbers(whole, "frame"), kind="stable")
        batches = iter([(0, whole.take(pa.array(order)))])
    rest: list[FrameRows] = []
    for start, batch in batches:
        for part in _split(batch, start, frames, points, table.problems):
            if rest and rest[0].frame != part.frame:
                yield _joined(rest)
                rest = []
            rest.append(part)
    if rest:
        yield _joined(rest)


def _split(
    batch: pa.Table, start: int, frames: int, points: int, problems: FileProblems
) -> Iterator[FrameRows]:
    frame = numbers(batch, "frame")
    point = numbers(batch, "point")
    state = codes(batch.column("visibility"), VISIBILITY_STATES)
    problems.add_rows(
        "VALUE_OUT_OF_RANGE",
        state < 0,
        lambda i: (
            f"row {start + i}, visibility",
            f"required: {' | '.join(VISIBILITY_STATES)}",
        ),
    )
    good = report_not_finite(batch, _FLOATS, start, problems)
    good &= (frame >= 0) & (frame < frames) & (point >= 0) & (point < points) & (state >= 0)
    values = stacked(batch, *_FLOATS).astype(np.float64)
    edges = np.flatnonzero(np.diff(frame)) + 1
    for low, high in zip([0, *edges], [*edges, len(frame)], strict=True):
        rows = np.arange(low, high)[good[low:high]]
        if rows.size:
            yield FrameRows(
                frame=int(frame[low]),
                point=point[rows],
                uv_px=values[rows, :2],
                depth_m=values[rows, 2],
                state=state[rows],
                xyz_m=values[rows, 3:],
            )


def _joined(parts: list[FrameRows]) -> FrameRows:
    if len(parts) == 1:
        return parts[0]
    rows = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _PER_ROW}
    return replace(parts[0], **rows)


def check_projection(
    context: Context, camera: Camera, rows: FrameRows, problems: FileProblems
) -> npt.NDArray[np.bool_]:
    """Check that the rows of a frame project to where they say.

    Args:
        context: The dataset.
        camera: The frame's camera.
        rows: The rows.
        problems: Gets `REPROJECTION_DISAGREES`, `DEPTH_DISAGREES`, `OUT_OF_FRAME_DISAGREES`.

    Returns:
        bool (N,), True for rows that do.
    """
    projected = camera.project(rows.xyz_m)
    uv, z = projected[:, :2], projected[:, 2]
    size = np.abs(rows.xyz_m).max(axis=1)
    deep = np.abs(rows.depth_m - z) > DEPTH_TOLERANCE_M + 1e-6 * (size + np.abs(z))
    problems.add_rows(
        "DEPTH_DISAGREES",
        deep,
        lambda i: (
            rows.where(i),
            f"depth_m is {rows.depth_m[i]:.6f}; its position is at z = {z[i]:.6f} m",
        ),
    )
    front = z > 1e-6
    K = camera.K
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slope = max(K[0, 0], K[1, 1]) + np.abs(uv - K[[0, 1], 2]).max(axis=1)
        rounding = 3e-7 * (slope * size / z + np.abs(uv).max(axis=1))
        gap = np.abs(rows.uv_px - uv).max(axis=1)
        off = front & ~(gap <= PIXEL_TOLERANCE + rounding)
    problems.add_rows(
        "REPROJECTION_DISAGREES",
        off,
        lambda i: (
            rows.where(i),
            f"u_px, v_px are {rows.uv_px[i, 0]:.3f}, {rows.uv_px[i, 1]:.3f}; its position "
            f"projects to {uv[i, 0]:.3f}, {uv[i, 1]:.3f}",
        ),
    )
    inside = np.minimum(rows.uv_px, context.size - rows.uv_px).min(axis=1)
    margin = np.where(front, inside, -np.inf)
    outside = rows.state == OUT_OF_FRAME
    wrong = ~off & (
        (outside & (margin > BORDER_TOLERANCE)) | (~outside & (margin < -BORDER_TOLERANCE))
    )
    problems.add_rows(
        "OUT_OF_FRAME_DISAGREES",
        wrong,
        lambda i: (
            rows.where(i),
            f"visibility is {VISIBILITY_STATES[rows.state[i]]} at u, v = "
            f"{rows.uv_px[i, 0]:.2f}, {rows.uv_px[i, 1]:.2f}, z = {z[i]:.3f} m",
        ),
    )
    good: npt.NDArray[np.bool_] = ~(deep | off | wrong)
    return good
