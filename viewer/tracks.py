"""Predicted tracks as pictures: a strip of frames, or an animation of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from pliant.evaluator.report.colours import material_colours
from pliant.evaluator.report.contact_sheet import evenly
from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.queries import QueryPair
from pliant.spec.sequence import RecordedFrame, SequenceRecord
from pliant.viewer.drawing import draw_point, draw_strip, positions_px
from pliant.viewer.recorded_answers import read_answers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAPER_FRAMES: Final = (0, 22, 87)
"""The frames that the paper's figure of tracked points shows."""

ANIMATION: Final = ".gif"

_TRAIL: Final = 20
_FRAMES_PER_SECOND: Final = 15
_ANIMATION_WIDTH_PX: Final = 480


@dataclass(frozen=True)
class PredictedTracks:
    """Where a submission sees the points of one source frame of an episode.

    Attributes:
        sequence: The episode.
        method: Name of the method.
        source: The source frame.
        answers: Frame -> float64 (Q, 2); the source frame contains the queries. NaN: not asked
            there.
        truth: Frame -> float64 (Q, 2), NaN where a point is not visible, or None where the
            dataset withholds it.
        colours: float64 (Q, 3), 0 to 1.
    """

    sequence: SequenceRecord
    method: str
    source: int
    answers: dict[int, FloatArray]
    truth: dict[int, FloatArray] | None
    colours: FloatArray


def read_predicted_tracks(
    dataset: Dataset, submission: Path, sequence: str | None = None
) -> PredictedTracks:
    """Read an episode's tracks from a submission.

    Args:
        dataset: The dataset whose queries it answers.
        submission: A submission of kind `answers`.
        sequence: Id of an episode; None takes the first one asked about.

    Returns:
        The tracks of the source frame with the most targets.

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

    answers = {source.index: points} | by_frame(given.rows.uv_px[rows].astype(np.float64))
    if given.split in dataset.held_out:  # colours from left to right
        from matplotlib import colormaps

        rank = points[:, 0].argsort().argsort() / max(1, len(points) - 1)
        truth, colours = None, colormaps["turbo"](rank)[:, :3]
    else:
        table = dataset.truth(given.split).take(rows)
        uv_b = positions_px(table, "u_b", "v_b")
        uv_b[np.asarray(table["visibility_b"].to_pylist()) != "visible"] = np.nan
        truth = by_frame(uv_b)
        material = np.zeros(len(points), np.int64)
        material[point] = table["point"].to_numpy()
        m = positions_px(source.sequence.points(), "m0", "m1")[material]
        colours = material_colours(m[:, 0], m[:, 1], source.sequence.described)
    return PredictedTracks(source.sequence, given.method, source.index, answers, truth, colours)


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


def draw_tracks(tracks: PredictedTracks, out: Path, frames: Sequence[int] | None = None) -> None:
    """Write predicted tracks: a strip of frames, or an animation where the ending is one's.

    Args:
        tracks: From `read_predicted_tracks`.
        out: `.png`, `.jpg`, `.webp`, `.pdf`, `.svg` for a strip; `.gif` for an animation.
        frames: Frames of the strip; None takes 0, 22 and 87 where the episode has them, else
            three spread over it.

    Raises:
        CallError: A frame is not asked about.
    """
    if out.suffix.lower() == ANIMATION:
        _animate(tracks, out)
        return
    asked = sorted(tracks.answers)
    if frames is None:
        paper = set(PAPER_FRAMES) <= set(asked)
        frames = PAPER_FRAMES if paper else [asked[k] for k in evenly(3, len(asked))]
    for frame in frames:
        if frame not in tracks.answers:
            raise CallError(
                "the submission says nothing of this frame",
                where=f"--frames, {tracks.sequence.id}",
                found=frame,
                required=f"{asked[0]} to {asked[-1]}, {len(asked)} of them asked about",
            )
    titles = {
        frame: f"{tracks.method}, {tracks.sequence.id}, frame {frame}{_rmse_text(tracks, frame)}"
        for frame in frames
    }
    draw_points = partial(_draw_points, tracks)
    draw_strip(out, tracks.sequence, titles, draw_points, columns=len(titles), width_in=5.2)


def _draw_points(tracks: PredictedTracks, axis: Axes, frame: int) -> None:
    """Draw the answers as dots and a line to where each visible point truly is."""
    uv = tracks.answers[frame]
    truth = None if tracks.truth is None else tracks.truth.get(frame)
    for k, colour in enumerate(tracks.colours):
        seen = truth is None or bool(np.isfinite(truth[k]).all())
        if truth is not None and seen:
            axis.plot(*np.stack([uv[k], truth[k]]).T, color="white", lw=1.2)
        draw_point(axis, uv[k], colour, seen=seen)


def _rmse_text(tracks: PredictedTracks, frame: int) -> str:
    if frame == tracks.source or tracks.truth is None or frame not in tracks.truth:
        return ""
    error = np.linalg.norm(tracks.answers[frame] - tracks.truth[frame], axis=1)
    if not np.isfinite(error).any():
        return ""
    return f", RMSE {np.sqrt(np.nanmean(error**2)):.1f} px"


def _animate(tracks: PredictedTracks, out: Path) -> None:
    """Write every frame that is asked about, with short trails."""
    from PIL import Image, ImageDraw

    asked = sorted(tracks.answers)
    width, height = tracks.sequence.size
    scale = min(1.0, _ANIMATION_WIDTH_PX / width)
    size = (round(width * scale), round(height * scale))
    colours = [tuple(int(255 * c) for c in colour) for colour in tracks.colours]
    pictures = []
    for number, frame in enumerate(asked):
        picture = Image.fromarray(tracks.sequence.rgb(frame)).resize(size)
        pen = ImageDraw.Draw(picture)
        trail = np.stack([tracks.answers[k] for k in asked[max(0, number - _TRAIL) : number + 1]])
        for k, colour in enumerate(colours):
            line = trail[np.isfinite(trail[:, k]).all(axis=1), k] * scale
            if len(line) > 1:
                pen.line([tuple(p) for p in line.tolist()], fill=colour, width=1)
            if len(line):
                u, v = line[-1].tolist()
                pen.ellipse([u - 3, v - 3, u + 3, v + 3], fill=colour, outline="white")
        pen.text((4, 3), f"{tracks.method}  {tracks.sequence.id}  frame {frame}", fill="white")
        pictures.append(picture)
    first, *rest = [picture.quantize(128) for picture in pictures]
    milliseconds = round(1000 / _FRAMES_PER_SECOND)
    first.save(out, save_all=True, append_images=rest, duration=milliseconds, loop=0)
