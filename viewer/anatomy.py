"""The anatomy of a frame: curve with handles, material grid, image, depth, index colours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.errors import CallError
from pliant.spec.io.exr import Surface
from pliant.spec.sequence import RecordedFrame, SequenceRecord
from pliant.viewer.drawing import (
    Float64,
    Rgb,
    Window,
    depth_image,
    index_image,
    positions_px,
    show,
    strip,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CURVE: Final = "#1f4e9c"
_HANDLE: Final = "#d1495b"


def draw_anatomy(sequence: SequenceRecord, frame: int, out: Path) -> None:
    """Draw how a frame came about, in five panels.

    Args:
        sequence: The sequence.
        frame: The frame.
        out: The image to write.

    Raises:
        CallError: The sequence has no such frame.
    """
    if not 0 <= frame < sequence.frames:
        raise CallError(
            "no such frame", where="--frame", found=frame, required=f"0 to {sequence.frames - 1}"
        )
    shown = sequence[frame]
    rgb, surface = shown.rgb, sequence.surface(frame)
    figure, axes = strip(5, shown.size, columns=5, width_in=3.6)
    window = _window(surface.object_id > 0)
    panels = {
        _curve_title(shown): (0.65 * 255 + 0.35 * rgb).astype(np.uint8),
        "material grid, visible points": _grid_image(shown, surface),
        "image": rgb,
        "depth": depth_image(surface),
        "index colours": index_image(surface, sequence.described),
    }
    for axis, (title, image) in zip(axes, panels.items(), strict=True):
        show(axis, image, title, window)
    _draw_curve(axes[0], shown)
    table = shown.correspondences
    seen = np.asarray(table["visibility"].to_pylist()) == "visible"
    seen &= np.asarray(sequence.points()["kind"].to_pylist()) == "surface"
    axes[1].plot(*positions_px(table)[seen].T, ".", color=_HANDLE, ms=1.0)
    figure.savefig(out)


def _window(mask: npt.NDArray[np.bool_]) -> Window:
    """Return a window of the image's proportions around a mask."""
    height, width = mask.shape
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    if len(columns) == 0:
        return 0.0, float(width), float(height), 0.0
    share = min(0.08 + max(float(np.ptp(columns)) / width, float(np.ptp(rows)) / height), 1.0)
    half = share * width / 2, share * height / 2
    u = float(np.clip((columns[0] + columns[-1]) / 2, half[0], width - half[0]))
    v = float(np.clip((rows[0] + rows[-1]) / 2, half[1], height - half[1]))
    return u - half[0], u + half[0], v + half[1], v - half[1]


def _curve_title(frame: RecordedFrame) -> str:
    if "control_points_m" in frame.sequence.info["frame_info"][frame.index]:
        return "Bézier curve and handles"
    rope = frame.sequence.info["parameters"].get("radius_m")
    return "centre line" if rope else "tracked points"


def _draw_curve(axis: Axes, frame: RecordedFrame) -> None:
    """Draw the Bezier curve with its handles, or the tracked points where there is no curve."""
    sequence = frame.sequence
    info = sequence.info["frame_info"][frame.index]
    if "control_points_m" not in info:
        uv = positions_px(frame.correspondences)
        line = np.asarray(sequence.points()["kind"].to_pylist()) == "centreline"
        if line.any():
            axis.plot(*uv[line].T, color=_CURVE, lw=1.6)
        else:
            axis.plot(*uv.T, ".", color=_CURVE, ms=2)
        return
    radius = float(sequence.info["parameters"].get("radius_m", 0.0))
    nodes, handles = (
        _project(frame, np.asarray(info[key], np.float64), radius)
        for key in ("control_points_m", "handles_m")
    )
    t = np.linspace(0, 1, 24)[:, None]
    for k in range(len(nodes) - 1):
        a, b, c, d = nodes[k], handles[k, 1], handles[k + 1, 0], nodes[k + 1]
        curve = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
        axis.plot(*curve.T, color=_CURVE, lw=1.8)
    for node, (left, right) in zip(nodes, handles, strict=True):
        axis.plot(*np.stack([left, node, right]).T, color=_HANDLE, lw=0.8)
        axis.plot(*np.stack([left, right]).T, "o", color=_HANDLE, ms=2.2)
        axis.plot(*node, "s", color="#edae49", mec="#5c4310", ms=4.5, mew=0.6)


def _project(frame: RecordedFrame, points_m: Float64, height_m: float) -> Float64:
    """Return points as pixels; points of the plane are first put at a height."""
    if points_m.shape[-1] == 2:
        height = np.full((*points_m.shape[:-1], 1), height_m)
        points_m = np.concatenate([points_m, height], axis=-1)
    camera = frame.sequence.camera(frame.index)
    uv: Float64 = camera.project(points_m.reshape(-1, 3))[:, :2].reshape(*points_m.shape[:-1], 2)
    return uv


def _grid_image(frame: RecordedFrame, surface: Surface) -> Rgb:
    """Return the lines of constant material coordinate."""
    tier = frame.sequence.described
    on = frame.queried_in(surface.object_id)
    lines = np.zeros(on.shape, bool)
    for values, step, field in zip(
        (surface.m0, surface.m1),
        (80, 6) if tier.kind == "rope" else (32, 32),
        tier.queried.material,
        strict=True,
    ):
        cell = np.floor((values - field.min) / (field.max - field.min) * step)
        cell = np.where(on, cell, -1)
        lines[:, 1:] |= cell[:, 1:] != cell[:, :-1]
        lines[1:] |= cell[1:] != cell[:-1]
    image = np.full((*on.shape, 3), 255, np.uint8)
    image[on] = (232, 238, 247)
    image[lines] = (90, 110, 140)
    return image
