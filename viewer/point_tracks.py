"""True positions of points, as a strip of frames: tracks, and the points of imported pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from pliant.evaluator.report.colours import material_colours
from pliant.evaluator.report.contact_sheet import evenly
from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.parquet import read_table
from pliant.spec.sequence import SequenceRecord
from pliant.viewer.drawing import (
    draw_point,
    draw_strip,
    name_point,
    number_colour,
    positions_px,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_POINTS: Final = 12
_STEPS: Final = 8
_TRAIL: Final = 60
_NAMED: Final = 12  # more points have colours alone


@dataclass(frozen=True)
class _Tracks:
    """Points of a sequence.

    Attributes:
        uv_px: float64 (T, N, 2).
        visible: bool (T, N).
        colours: float64 (N, 3), 0 to 1.
    """

    uv_px: FloatArray
    visible: npt.NDArray[np.bool_]
    colours: FloatArray


def draw_point_tracks(sequence: SequenceRecord, count: int, out: Path) -> None:
    """Draw where points of a sequence are, and in an episode where they came from.

    Args:
        sequence: The sequence.
        count: Frames of the strip, at most 8.
        out: The image to write.
    """
    tracks = _read(sequence)
    frames = evenly(min(count, _STEPS), sequence.frames)

    def draw(axis: Axes, frame: int) -> None:
        for k, colour in enumerate(tracks.colours):
            if sequence.temporal:
                trail = tracks.uv_px[max(0, frame - _TRAIL) : frame + 1, k].T
                axis.plot(*trail, color="black", lw=2.2, alpha=0.5)
                axis.plot(*trail, color=colour, lw=1.3)
            draw_point(axis, tracks.uv_px[frame, k], colour, seen=bool(tracks.visible[frame, k]))

    titles = {frame: f"{sequence.id}, frame {frame}" for frame in frames}
    draw_strip(out, sequence, titles, draw, columns=4, width_in=4.1)


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


def draw_annotated_points(
    dataset: Dataset, sequence: SequenceRecord, truth: Path | None, count: int, out: Path
) -> None:
    """Draw the points that are asked about on the pictures of a sequence.

    A dot is a visible point, a hollow one a hidden point. Names are those of the import, if any.

    Args:
        dataset: The dataset.
        sequence: Its sequence.
        truth: The truth of its split; None takes the dataset's own, or the file
            `DATASET-truth/SPLIT.parquet` as `pliant import` writes it.
        count: Pictures at most.
        out: The image to write.

    Raises:
        CallError: There are no queries or no truth.
    """
    split = sequence.split
    if split not in dataset.splits_with_queries():
        raise CallError("the split has no queries", path=dataset.root, found=split)
    if truth is None and not dataset.has(f"truth/{split}.parquet"):
        truth = dataset.root.with_name(f"{dataset.root.name}-truth") / f"{split}.parquet"
        if not truth.is_file():
            raise CallError(
                "the points are in the truth, which is not there",
                path=truth,
                fix="Name it: --truth FILE",
            )
    table = dataset.truth(split) if truth is None else read_table(truth, "truth")
    queries = dataset.queries(split).to_pylist()
    places: dict[int, dict[int, tuple[float, float, bool]]] = {}
    for query, true in zip(queries, table.to_pylist(), strict=True):
        if query["sequence_b"] == sequence.id:
            seen = true["visibility_b"] == "visible"
            own = places.setdefault(query["frame_b"], {})
            own[true["point"]] = (true["u_b"], true["v_b"], seen)
        if query["sequence_a"] == sequence.id:
            own = places.setdefault(query["frame_a"], {})
            own[true["point"]] = (query["u_a"], query["v_a"], True)
    if not places:
        raise CallError("no point of the sequence is asked about", where=sequence.id)
    names = dict(enumerate(dataset.info["provenance"]["config"].get("points", ())))
    points = sorted({point for own in places.values() for point in own})
    shown = [sorted(places)[k] for k in evenly(count, len(places))]
    pictures = dict(enumerate(dataset.info["provenance"]["config"].get("pictures", ())))

    def draw(axis: Axes, frame: int) -> None:
        for point, (u, v, seen) in places[frame].items():
            colour = number_colour(points.index(point), len(points))
            draw_point(axis, np.array([u, v]), colour, seen=seen)
            if len(points) <= _NAMED:
                name_point(axis, (u, v), str(names.get(point, point)))

    titles = {
        frame: str(pictures.get(frame, {}).get("name", f"{sequence.id}, frame {frame}"))
        for frame in shown
    }
    draw_strip(out, sequence, titles, draw, columns=4, width_in=4.1)
