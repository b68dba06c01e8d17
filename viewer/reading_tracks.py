"""Tracks to draw: the true ones of a sequence, those of a submission, and annotated points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from pliant.evaluator.report.colours import material_colours
from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.parquet import read_table
from pliant.spec.queries import QueryPair
from pliant.spec.sequence import RecordedFrame, SequenceRecord
from pliant.viewer.drawing import number_colour, positions_px
from pliant.viewer.recorded_answers import read_answers
from pliant.viewer.tracks import Tracks

_POINTS: Final = 12


def true_tracks(sequence: SequenceRecord) -> Tracks:
    """Return where points spread over the queried object are in every frame."""
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
    uv_px = positions_px(table).reshape(*shape, 2)[:, rows[chosen]]
    visible = (np.asarray(table["visibility"].to_pylist()) == "visible").reshape(shape)
    return Tracks(
        sequence,
        dict(enumerate(uv_px)),
        dict(enumerate(visible[:, rows[chosen]])),
        colours,
        {frame: f"{sequence.id}, frame {frame}" for frame in range(sequence.frames)},
        trails=sequence.temporal,
    )


def annotated_points(dataset: Dataset, sequence: SequenceRecord, truth: Path | None) -> Tracks:
    """Return the points that are asked about in a sequence, with the names of the import, if any.

    Args:
        dataset: The dataset.
        sequence: Its sequence.
        truth: The truth of its split; None takes the dataset's own, or the file
            `DATASET-truth/SPLIT.parquet` as `pliant import` writes it.

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
    found: dict[tuple[int, int], tuple[float, float, bool]] = {}
    for query, true in zip(dataset.queries(split).to_pylist(), table.to_pylist(), strict=True):
        if query["sequence_b"] == sequence.id:
            seen = true["visibility_b"] == "visible"
            found[query["frame_b"], true["point"]] = (true["u_b"], true["v_b"], seen)
        if query["sequence_a"] == sequence.id:
            found[query["frame_a"], true["point"]] = (query["u_a"], query["v_a"], True)
    if not found:
        raise CallError("no point of the sequence is asked about", where=sequence.id)
    frames, points = (sorted({key[axis] for key in found}) for axis in (0, 1))
    missing = (np.nan, np.nan, False)
    values = {
        frame: np.array([found.get((frame, point), missing) for point in points], np.float64)
        for frame in frames
    }
    config = dataset.info["provenance"]["config"]
    names, pictures = (dict(enumerate(config.get(key, ()))) for key in ("points", "pictures"))
    return Tracks(
        sequence,
        {frame: each[:, :2] for frame, each in values.items()},
        {frame: each[:, 2] > 0 for frame, each in values.items()},
        np.array([number_colour(number, len(points)) for number in range(len(points))]),
        {
            frame: str(pictures.get(frame, {}).get("name", f"{sequence.id}, frame {frame}"))
            for frame in frames
        },
        names=[str(names.get(point, point)) for point in points],
    )


def predicted_tracks(dataset: Dataset, submission: Path, sequence: str | None = None) -> Tracks:
    """Read an episode's tracks from a submission.

    Args:
        dataset: The dataset whose queries it answers.
        submission: A submission of kind `answers`.
        sequence: Id of an episode; None takes the first one asked about.

    Returns:
        The tracks of the source frame with the most targets; that frame has the queries.

    Raises:
        SubmissionError: The submission cannot be read, or answers other queries.
        CallError: No pair is of one episode.
    """
    given = read_answers(submission, dataset)
    pairs = dataset.pairs(given.split)
    first_rows = np.cumsum([0, *map(len, pairs)])
    source, asked = _most_asked(pairs, sequence, submission)
    rows = np.concatenate([np.arange(first_rows[k], first_rows[k + 1]) for k in asked])
    frame = np.repeat([pairs[k].target.index for k in asked], [len(pairs[k]) for k in asked])
    uv_a = np.concatenate([pairs[k].uv_a_px for k in asked]).astype(np.float64)
    points, point = np.unique(uv_a, axis=0, return_inverse=True)
    point = point.reshape(-1)

    def by_frame(uv_px: FloatArray) -> dict[int, FloatArray]:
        """Return positions of rows, float64 (N, 2), as frame -> float64 (points, 2) or NaN."""
        found = {int(k): np.full(points.shape, np.nan) for k in np.unique(frame)}
        for k, positions in found.items():
            positions[point[frame == k]] = uv_px[frame == k]
        return found

    places = {source.index: points} | by_frame(given.rows.uv_px[rows].astype(np.float64))
    seen = {k: np.ones(len(points), np.bool_) for k in places}
    truth: dict[int, FloatArray] | None = None
    if given.split in dataset.held_out:  # colours from left to right
        from matplotlib import colormaps

        rank = points[:, 0].argsort().argsort() / max(1, len(points) - 1)
        colours = colormaps["turbo"](rank)[:, :3]
    else:
        table = dataset.truth(given.split).take(rows)
        uv_b = positions_px(table, "u_b", "v_b")
        uv_b[np.asarray(table["visibility_b"].to_pylist()) != "visible"] = np.nan
        truth = by_frame(uv_b)
        seen |= {k: np.isfinite(each).all(axis=1) for k, each in truth.items()}
        material = np.zeros(len(points), np.int64)
        material[point] = table["point"].to_numpy()
        m = positions_px(source.sequence.points(), "m0", "m1")[material]
        colours = material_colours(m[:, 0], m[:, 1], source.sequence.described)
    about = f"{given.method}, {source.sequence.id}"
    titles = {k: f"{about}, frame {k}{_rmse_text(places[k], truth, k)}" for k in places}
    return Tracks(source.sequence, places, seen, colours, titles, truth)


def _rmse_text(places: FloatArray, truth: dict[int, FloatArray] | None, frame: int) -> str:
    if truth is None or frame not in truth:
        return ""
    error = np.linalg.norm(places - truth[frame], axis=1)
    if not np.isfinite(error).any():
        return ""
    return f", RMSE {np.sqrt(np.nanmean(error**2)):.1f} px"


def _most_asked(
    pairs: Sequence[QueryPair], sequence: str | None, submission: Path
) -> tuple[RecordedFrame, list[int]]:
    """Return the source frame with the most targets in its episode, and the indices of its pairs.

    Raises:
        CallError: No pair is of one episode, or of the named one.
    """
    own = [
        k
        for k, pair in enumerate(pairs)
        if pair.source.sequence.id == pair.target.sequence.id
        and pair.source.sequence.temporal
        and sequence in (None, pair.source.sequence.id)
    ]
    if not own:
        raise CallError(
            "no pair of the submission is in one episode",
            path=submission,
            where=sequence,
            fix="Ask for tracks when generating: --episodes --set queries.kind=track",
        )
    episode = pairs[own[0]].source.sequence
    targets: dict[int, set[int]] = {}
    for k in own:
        if pairs[k].source.sequence.id == episode.id:
            targets.setdefault(pairs[k].source.index, set()).add(pairs[k].target.index)
    source = max(sorted(targets), key=lambda frame: len(targets[frame]))
    key = episode[source].key
    return episode[source], [k for k in own if pairs[k].source.key == key]
