"""The true tracks of a dozen points, as a strip of frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from pliant.spec.sequence import SequenceRecord
from pliant.viewer.colours import material_colours
from pliant.viewer.drawing import Float64, draw_point, evenly, positions_px, show, strip

_POINTS: Final = 12
_STEPS: Final = 8
_TRAIL: Final = 60


@dataclass(frozen=True)
class _Tracks:
    """Points of a sequence.

    Attributes:
        uv_px: float64 (T, N, 2).
        visible: bool (T, N).
        colours: float64 (N, 3), 0 to 1.
    """

    uv_px: Float64
    visible: npt.NDArray[np.bool_]
    colours: Float64


def draw_point_tracks(sequence: SequenceRecord, count: int, out: Path) -> None:
    """Draw where points of a sequence are, and in an episode where they came from.

    Args:
        sequence: The sequence.
        count: Frames of the strip, at most 8.
        out: The image to write.
    """
    tracks = _read(sequence)
    frames = evenly(min(count, _STEPS), sequence.frames)
    figure, axes = strip(len(frames), sequence.size, columns=4, width_in=4.1)
    for axis, frame in zip(axes, frames, strict=True):
        show(axis, sequence.rgb(frame), f"{sequence.id}, frame {frame}")
        for k, colour in enumerate(tracks.colours):
            if sequence.temporal:
                trail = tracks.uv_px[max(0, frame - _TRAIL) : frame + 1, k].T
                axis.plot(*trail, color="black", lw=2.2, alpha=0.5)
                axis.plot(*trail, color=colour, lw=1.3)
            draw_point(axis, tracks.uv_px[frame, k], colour, seen=bool(tracks.visible[frame, k]))
    figure.savefig(out)


def _read(sequence: SequenceRecord) -> _Tracks:
    """Read points spread over the queried object."""
    tier, points = sequence.described, sequence.points()
    of_object = np.asarray(points["object"].to_numpy()) == tier.queried_object
    rows = np.flatnonzero(of_object & (np.asarray(points["kind"].to_pylist()) == "surface"))
    m = positions_px(points, "m0", "m1")[rows]
    if tier.kind == "rope":  # along one side
        order = np.lexsort((np.abs(m[:, 1] - np.pi / 2), np.round(m[:, 0], 6)))
        chosen = order[np.linspace(0, len(order) - 1, _POINTS).round().astype(int)]
        colours = material_colours(m[chosen, 0], np.zeros(len(chosen)), tier)
    else:
        grid = np.stack(np.meshgrid([0.1, 0.37, 0.63, 0.9], [0.15, 0.5, 0.85]), -1).reshape(-1, 2)
        chosen = np.argmin(((m[None] - grid[:, None]) ** 2).sum(-1), axis=1)
        colours = material_colours(m[chosen, 0], m[chosen, 1], tier)
    table = sequence.correspondences()
    shape = (sequence.frames, len(points))
    uv_px = positions_px(table).reshape(*shape, 2)
    visible = (np.asarray(table["visibility"].to_pylist()) == "visible").reshape(shape)
    return _Tracks(uv_px[:, rows[chosen]], visible[:, rows[chosen]], colours)
