"""Tracks of points as pictures: a strip of frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.sequence import SequenceRecord
from pliant.viewer.drawing import name_point, show

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DPI: Final = 100
_TITLE_IN: Final = 0.3
_TRAIL: Final = 60
_NAMED: Final = 12  # more points have colours alone


@dataclass(frozen=True)
class Tracks:
    """Where points of a sequence are.

    Attributes:
        sequence: The sequence.
        places: Frame -> float64 (N, 2), pixels; NaN where nothing is known of a point.
        seen: Frame -> bool (N,), False for a point that is not visible there.
        colours: float64 (N, 3 or 4), 0 to 1.
        titles: Frame -> text above its picture.
        truth: Frame -> float64 (N, 2), where the points truly are, NaN where they are not visible,
            or None where the places are not answers, or the truth is withheld.
        names: Names of the points, or none.
        trails: Whether the way of a point to its place is drawn.
    """

    sequence: SequenceRecord
    places: Mapping[int, FloatArray]
    seen: Mapping[int, npt.NDArray[np.bool_]]
    colours: FloatArray
    titles: Mapping[int, str]
    truth: Mapping[int, FloatArray] | None = None
    names: Sequence[str] = ()
    trails: bool = False


def draw_tracks(
    tracks: Tracks, frames: Sequence[int], out: Path, *, columns: int = 4, width_in: float = 4.1
) -> None:
    """Write frames as panels, row by row, with dots for the points.

    A dot is hollow where its point is not visible. A line leads from an answer to the truth.

    Args:
        tracks: The points.
        frames: The frames to show.
        out: The image to write.
        columns: Panels per row at most.
        width_in: Width of a panel, inches.
    """
    from matplotlib.figure import Figure

    size = tracks.sequence.size
    columns = min(len(frames), columns)
    rows = -(-len(frames) // columns)
    image_in = width_in * size[1] / size[0]
    tall = rows * (image_in + _TITLE_IN)
    figure = Figure(figsize=(width_in * columns, tall), dpi=_DPI, facecolor="white")
    figure.subplots_adjust(
        0.004, 0.005, 0.996, 1 - _TITLE_IN / tall, wspace=0.02, hspace=_TITLE_IN / image_in
    )
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for unused in axes[len(frames) :]:
        unused.set_axis_off()
    for axis, frame in zip(axes, frames, strict=False):
        show(axis, tracks.sequence.rgb(frame), tracks.titles[frame])
        _draw_points(axis, tracks, frame)
    figure.savefig(out)


def _draw_points(axis: Axes, tracks: Tracks, frame: int) -> None:
    uv, seen = tracks.places[frame], tracks.seen[frame]
    truth = None if tracks.truth is None else tracks.truth.get(frame)
    way = range(max(0, frame - _TRAIL), frame + 1)
    for k, colour in enumerate(tracks.colours):
        if tracks.trails:
            trail = np.stack([tracks.places[at][k] for at in way])
            axis.plot(*trail.T, color="black", lw=2.2, alpha=0.5)
            axis.plot(*trail.T, color=colour, lw=1.3)
        if truth is not None and seen[k]:
            axis.plot(*np.stack([uv[k], truth[k]]).T, color="white", lw=1.2)
        face, edge = (colour, "white") if seen[k] else ("none", colour)
        axis.plot(*uv[k], "o", ms=6, mfc=face, mec=edge, mew=1.0)
        if len(tracks.names) in range(1, _NAMED + 1) and np.isfinite(uv[k]).all():
            name_point(axis, uv[k], tracks.names[k])
