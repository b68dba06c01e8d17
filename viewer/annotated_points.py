"""The points of imported pictures, drawn where their queries and their truth say that they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.parquet import read_table
from pliant.spec.sequence import SequenceRecord
from pliant.viewer.drawing import draw_point, evenly, show, strip

_NAMED = 12  # more points have colours alone


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
    from matplotlib import colormaps

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
    figure, axes = strip(len(shown), sequence.size, columns=4, width_in=4.1)
    for axis, frame in zip(axes, shown, strict=True):
        title = pictures.get(frame, {}).get("name", f"{sequence.id}, frame {frame}")
        show(axis, sequence.rgb(frame), str(title))
        for point, (u, v, seen) in places[frame].items():
            colour = colormaps["turbo"](0.05 + 0.9 * points.index(point) / max(1, len(points) - 1))
            draw_point(axis, np.array([u, v]), colour, seen=seen)
            if len(points) <= _NAMED:
                axis.annotate(
                    str(names.get(point, point)),
                    (u, v),
                    xytext=(5, 4),
                    textcoords="offset points",
                    fontsize=8,
                    color="white",
                    bbox={"boxstyle": "round,pad=0.15", "fc": "#000000a0", "lw": 0},
                )
    figure.savefig(out)
