"""One cause for many rows: what turns every correct projection into what a table says.

A writer that follows another convention breaks every row in the same way. Each hypothesis here
predicts u_px, v_px and depth_m from the world positions; the first one that predicts the rows to
the tolerance of the projection names the cause.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.camera import Camera
from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.correspondences import FrameRows

ROWS_PER_FRAME = 64
MAX_FRAMES = 64
"""So many rows and frames are kept to find a cause."""

SHARE = 0.95
"""A cause explains this share of the rows, or it is none."""

FITTED = 16
"""Rows of a frame from which twelve numbers of a camera are fitted."""

_PIXELS = 0.02
_DEPTH = 1e-4  # relative
_AXES = ((0, 2, 1), (1, 0, 2), (2, 1, 0), (1, 2, 0), (2, 0, 1))


@dataclass
class RowSample:
    """Some rows of a sequence, right and wrong, as the table has them.

    Attributes:
        rows: Of some frames.
        checked: How many rows were compared.
    """

    rows: list[FrameRows] = field(default_factory=list)
    checked: int = 0

    def add(self, rows: FrameRows) -> None:
        """Keep some rows of a frame."""
        self.checked += len(rows.point)
        if len(self.rows) >= MAX_FRAMES:
            return
        keep = np.unique(np.linspace(0, len(rows.point) - 1, ROWS_PER_FRAME).astype(np.int64))
        self.rows.append(rows.chosen(keep))


@dataclass(frozen=True)
class _Compared:
    """The sampled rows next to their projection; (N, 2) pixels and (N,) metres."""

    uv: FloatArray
    depth: FloatArray
    true_uv: FloatArray
    true_depth: FloatArray
    ray: FloatArray


def diagnose_rows(
    sample: RowSample, cameras: Sequence[Camera], size: tuple[int, int], problems: FileProblems
) -> None:
    """Replace the issues of rows that share one cause by one issue that names it.

    Args:
        sample: Rows of the sequence.
        cameras: Its cameras.
        size: (width, height) of the images.
        problems: The table's; its row issues may be replaced.
    """
    wrong_uv = problems.counts["REPROJECTION_DISAGREES"]
    wrong_depth = problems.counts["DEPTH_DISAGREES"]
    if max(wrong_uv, wrong_depth) < 0.9 * sample.checked or not sample.rows:
        return
    cause = _camera_cause(sample, cameras)
    if cause is not None:
        _explain_all(cause, problems)
        return
    compared = _compare(sample, cameras)
    if not compared.uv.size:
        return
    explained = False
    for code, rows, found in (
        ("REPROJECTION_DISAGREES", wrong_uv, _pixel_cause(compared, size)),
        ("DEPTH_DISAGREES", wrong_depth, _depth_cause(compared)),
    ):
        if found is not None and rows >= 0.9 * sample.checked:
            problems.diagnose(code, found)
            explained = True
    cause = None if explained else _frame_cause(sample, cameras) or _linear_cause(sample)
    if cause is not None:
        _explain_all(cause, problems)


def _explain_all(cause: str, problems: FileProblems) -> None:
    for code in ("REPROJECTION_DISAGREES", "DEPTH_DISAGREES", "OUT_OF_FRAME_DISAGREES"):
        if problems.counts[code]:
            problems.diagnose(code, cause)


def _compare(sample: RowSample, cameras: Sequence[Camera]) -> _Compared:
    true = np.concatenate([cameras[rows.frame].project(rows.xyz_m) for rows in sample.rows])
    K = np.concatenate(
        [np.broadcast_to(cameras[r.frame].K, (len(r.point), 3, 3)) for r in sample.rows]
    )
    slope = (true[:, :2] - K[:, :2, 2]) / K[:, [0, 1], [0, 1]]
    front = true[:, 2] > 1e-6
    return _Compared(
        np.concatenate([rows.uv_px for rows in sample.rows])[front],
        np.concatenate([rows.depth_m for rows in sample.rows])[front],
        true[front, :2],
        true[front, 2],
        np.sqrt(1 + (slope[front] ** 2).sum(axis=1)),
    )


def _most(good: npt.NDArray[np.bool_]) -> bool:
    return bool(good.size >= 4 and np.mean(good) >= SHARE)


def _near(found: FloatArray, predicted: FloatArray, tolerance: float = _PIXELS) -> bool:
    gap = np.abs(found - predicted).max(axis=1)
    return _most(gap <= tolerance + 1e-5 * np.abs(predicted).max(axis=1))


def _pixel_cause(rows: _Compared, size: tuple[int, int]) -> str | None:
    """Return what u_px, v_px do, or None."""
    u, v = rows.true_uv.T
    width, height = size
    shift = np.median(rows.uv - rows.true_uv, axis=0)
    if _near(rows.uv, rows.true_uv + shift):
        half = np.abs(np.abs(shift) - 0.5).max() < _PIXELS
        why = ""
        if half:
            why = ": OpenCV convention?" if np.all(shift < 0) else ": half a pixel too much?"
        step = np.round(shift, 2)
        return f"differ by ({step[0]:+.2f}, {step[1]:+.2f}) px{why}"
    for text, predicted in (
        ("have v upwards: count v from the top of the image", (u, height - v)),
        ("have u leftwards: count u from the left of the image", (width - u, v)),
        ("are turned by 180 degrees", (width - u, height - v)),
        ("have u and v exchanged: swapped axes", (v, u)),
        ("are in [0, 1]: divided by the image size; multiply by it", (u / width, v / height)),
        ("are in [-1, 1]: normalised device coordinates", (2 * u / width - 1, 2 * v / height - 1)),
    ):
        small = 1e-3 if "are in" in text else _PIXELS
        if _near(rows.uv, np.stack(predicted, axis=1), small):
            return text
    for parts, text in ((2, "pixels"), (10, "tenths of pixels")):
        nearest = np.abs(parts * rows.uv - np.rint(parts * rows.uv)).max(axis=1) < 5e-5 * parts
        if _most(nearest) and _most(np.abs(rows.uv - rows.true_uv).max(axis=1) <= 2.02 / parts):
            return f"are rounded to {text}: positions are never rounded"
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = float(np.median(rows.uv / rows.true_uv))
    if np.isfinite(factor) and abs(factor - 1) > 1e-3 and _near(rows.uv, factor * rows.true_uv):
        return f"are {factor:.4g} times the projection: images of another size?"
    return None


def _depth_cause(rows: _Compared) -> str | None:
    """Return what depth_m does, or None."""
    z = rows.true_depth

    def fits(predicted: FloatArray) -> bool:
        return _most(np.abs(rows.depth - predicted) <= _DEPTH * np.abs(predicted))

    for text, predicted in (
        ("have depth_m 1000 times too large: millimetres", 1000 * z),
        ("have depth_m 1000 times too small: kilometres", z / 1000),
        ("have depth_m 100 times too large: centimetres", 100 * z),
        ("have the length of the ray as depth_m; required: planar z", z * rows.ray),
        ("have a negative depth_m: the camera looks along -z (OpenGL)?", -z),
        ("have 1 / z as depth_m: disparity", 1 / z),
    ):
        if fits(predicted):
            return text
    factor = float(np.median(rows.depth / z))
    if abs(factor - 1) > 1e-4 and fits(factor * z):
        return f"have a depth_m of {factor:.4g} times the camera-space z"
    shift = float(np.median(rows.depth - z))
    if fits(z + shift):
        return f"have a depth_m that differs by {shift:+.4f} m"
    return None


def _camera_cause(sample: RowSample, cameras: Sequence[Camera]) -> str | None:
    """Return which other camera or axes give u_px, v_px and depth_m, or None."""
    for text, others, axes in _cameras(cameras):
        good = []
        for rows in sample.rows:
            camera = others[rows.frame]
            if camera is None:
                good.append(np.zeros(len(rows.point), np.bool_))
                continue
            good.append(_seen(rows, camera, rows.xyz_m @ axes.T))
        if _most(np.concatenate(good)):
            return text
    return None


def _seen(rows: FrameRows, camera: Camera, xyz_m: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which rows have the projections of world positions (N, 3)."""
    uv, z = np.split(camera.project(xyz_m), [2], axis=1)
    with np.errstate(invalid="ignore"):
        gap = np.abs(rows.uv_px - uv).max(axis=1)
        depth = np.abs(rows.depth_m - z[:, 0]) <= _DEPTH * np.abs(z[:, 0]) + 2e-5
    return np.asarray((gap <= _PIXELS * 2) & depth)


def _frame_cause(sample: RowSample, cameras: Sequence[Camera]) -> str | None:
    """Return whether u_px, v_px and depth_m are those of the frame after or before, or None."""
    for one, other, text in ((0, 1, "after"), (1, 0, "before")):
        pairs = list(zip(sample.rows[one:], sample.rows[other:], strict=False))
        same = [(a, b) for a, b in pairs if np.array_equal(a.point, b.point)]
        good = [_seen(a, cameras[a.frame], b.xyz_m) for a, b in same]
        if good and _most(np.concatenate(good)):
            return f"have the u_px, v_px and depth_m of the frame {text}"
    return None


def _linear_cause(sample: RowSample) -> str | None:
    """Return whether the rows of each frame fit some K and pose, or None.

    With homogeneous positions X, depth * (u, v, 1) = K [R t] X is linear in twelve numbers.
    """
    good = [np.zeros(0, np.bool_)]
    for rows in sample.rows:
        if len(rows.point) < FITTED:
            return None
        seen = np.column_stack([rows.uv_px, np.ones(len(rows.point))]) * rows.depth_m[:, None]
        place = np.column_stack([rows.xyz_m, np.ones(len(rows.point))])
        fit = place @ np.linalg.lstsq(place, seen, rcond=None)[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            gap = np.abs(fit[:, :2] / fit[:, 2:] - rows.uv_px).max(axis=1)
        depth = np.abs(rows.depth_m - fit[:, 2]) <= _DEPTH * np.abs(fit[:, 2]) + 2e-5
        good.append((gap <= _PIXELS * 2) & depth)
    if _most(np.concatenate(good)):
        return "fit another K and pose: those of another sequence, or of another world frame?"
    return None


def _cameras(
    cameras: Sequence[Camera],
) -> Iterator[tuple[str, Sequence[Camera | None], FloatArray]]:
    """Yield (cause, camera of every frame, (3, 3) that turns world positions)."""
    count, same = len(cameras), np.eye(3)
    turn = np.diag([1.0, -1.0, -1.0, 1.0])
    for text, change in (
        ("fit the inverse pose: camera_to_world?", np.linalg.inv),
        ("fit a camera with y up and z backward (OpenGL, Blender)", turn.__matmul__),
    ):
        others = [replace(c, world_to_camera=change(c.world_to_camera)) for c in cameras]
        yield text, others, same
    if count > 2:
        text = "fit the camera of another frame: shifted by one frame"
        yield text, [*cameras[1:], None], same
        yield text, [None, *cameras[:-1]], same
    for frame in range(min(count, MAX_FRAMES) if count > 1 else 0):
        text = f"fit the camera of frame {frame}: another frame's camera"
        yield text, [cameras[frame]] * count, same
    for factor, name in ((1e-3, "millimetres"), (1e-2, "centimetres"), (1e3, "kilometres")):
        text = f"have a world position {1 / factor:g} times too large: {name}"
        yield text, cameras, factor * same
    for axes in _AXES:
        text = "".join("xyz"[axis] for axis in axes)
        text = f"have their world axes swapped: x, y, z are written as {text}"
        yield text, cameras, same[list(axes)]
    for turned in (same[[0, 2, 1]], same):
        for sign in ((1, -1, 1), (1, 1, -1), (-1, 1, 1)):
            text = "have a world axis turned round: y up, or z down?"
            yield text, cameras, turned * np.array(sign)[:, None]
