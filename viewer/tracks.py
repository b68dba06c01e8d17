"""Predicted tracks as pictures: a strip of frames, or an animation of all of them."""

from __future__ import annotations

from collections.abc import Sequence as Frames
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, MissingExtraError
from pliant.spec.io.parquet import read_footer, read_table
from pliant.spec.sequence import SequenceRecord
from pliant.viewer.colours import material_colours

Float64 = npt.NDArray[np.float64]
Rgb = npt.NDArray[np.uint8]

PAPER_FRAMES: Final = (0, 22, 87)
"""The frames that the paper's figure of tracked points shows."""

ANIMATIONS: Final = (".gif", ".mp4")

_DPI: Final = 100
_TRAIL: Final = 20
_FRAMES_A_SECOND: Final = 15
_ANIMATION_WIDTH_PX: Final = 480


@dataclass(frozen=True)
class PredictedTracks:
    """Where a submission sees the points of one source frame of an episode.

    Attributes:
        sequence: The episode.
        method: Name of the method.
        source: The source frame.
        answers: Frame -> float64 (Q, 2); the source frame holds the queries. NaN: not asked there.
        truth: Frame -> float64 (Q, 2), NaN where a point is not visible, or None where the
            dataset keeps it to itself.
        colours: float64 (Q, 3), 0 to 1.
    """

    sequence: SequenceRecord
    method: str
    source: int
    answers: dict[int, Float64]
    truth: dict[int, Float64] | None
    colours: Float64


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
        SpecError: The submission cannot be read.
        CallError: It answers other queries, or no pair lies in the episode.
    """
    footer = read_footer(submission)
    split = str(footer.get("split"))
    if split not in dataset.splits_with_queries() or (
        footer.get("queries_sha256") != dataset.queries_sha256(split)
    ):
        raise CallError(
            "the submission answers other queries than this dataset asks",
            path=submission,
            found=f"{footer.get('dataset')}, split {split}",
            fix="Name the dataset that it was made for",
        )
    queries = dataset.queries(split)
    columns = {name: queries[name].to_numpy() for name in ("pair_id", "query_id", "u_a", "v_a")}
    columns |= {name: queries[name].to_numpy() for name in ("frame_a", "frame_b")}
    source_id, target_id = (np.asarray(queries[f"sequence_{k}"].to_pylist()) for k in "ab")
    temporal = {each.id for each in dataset.sequences if each.temporal}
    own = (source_id == target_id) & np.isin(source_id, list(temporal))
    if sequence is not None:
        own &= source_id == sequence
    if not own.any():
        raise CallError(
            "no pair of the submission lies in one episode",
            path=submission,
            where=sequence,
            fix="Ask for tracks when generating: --episodes --set queries.kind=track",
        )
    chosen_id = source_id[own][0]
    own &= source_id == chosen_id
    targets = {a: len(set(columns["frame_b"][own & (columns["frame_a"] == a)].tolist()))
               for a in set(columns["frame_a"][own].tolist())}  # fmt: skip
    source = max(sorted(targets), key=lambda frame: targets[frame])
    rows = np.flatnonzero(own & (columns["frame_a"] == source))
    answered = _answers(submission, columns["pair_id"][rows], columns["query_id"][rows])
    uv_a = np.stack([columns["u_a"][rows], columns["v_a"][rows]], axis=1).astype(np.float64)
    points, point = np.unique(uv_a, axis=0, return_inverse=True)
    point = point.reshape(-1)
    answers = {int(source): points}
    for frame in np.unique(columns["frame_b"][rows]):
        here = columns["frame_b"][rows] == frame
        uv = np.full(points.shape, np.nan)
        uv[point[here]] = answered[here]
        answers[int(frame)] = uv
    episode = dataset.sequence(str(chosen_id))
    truth, colours = _truth(dataset, episode, split, rows, point, points, columns["frame_b"][rows])
    method = str(footer.get("method", {}).get("name", submission.stem))
    return PredictedTracks(episode, method, int(source), answers, truth, colours)


def _answers(submission: Path, pair_id: npt.NDArray[Any], query_id: npt.NDArray[Any]) -> Float64:
    """Return the submission's position for each key, NaN where it has none: float64 (N, 2)."""
    table = read_table(submission, "answers", ["pair_id", "query_id", "u", "v"])
    given = {
        (pair, query): (u, v)
        for pair, query, u, v in zip(
            *(table[n].to_pylist() for n in table.column_names), strict=True
        )
    }
    lost = (np.nan, np.nan)
    keys = zip(pair_id.tolist(), query_id.tolist(), strict=True)
    return np.array([given.get(key, lost) for key in keys], np.float64)


def _truth(
    dataset: Dataset,
    episode: SequenceRecord,
    split: str,
    rows: npt.NDArray[np.int64],
    point: npt.NDArray[np.int64],
    points: Float64,
    frame_b: npt.NDArray[Any],
) -> tuple[dict[int, Float64] | None, Float64]:
    """Return the true positions and index colours; left to right where the truth is kept back."""
    from matplotlib import colormaps

    rank = points[:, 0].argsort().argsort() / max(1, len(points) - 1)
    if split in dataset.held_out:
        return None, colormaps["turbo"](rank)[:, :3]
    truth = dataset.truth(split).take(rows)
    uv = np.stack([truth["u_b"].to_numpy(), truth["v_b"].to_numpy()], axis=1).astype(np.float64)
    uv[np.asarray(truth["visibility_b"].to_pylist()) != "visible"] = np.nan
    found = {}
    for frame in np.unique(frame_b):
        here = frame_b == frame
        found[int(frame)] = np.full(points.shape, np.nan)
        found[int(frame)][point[here]] = uv[here]
    material = np.zeros(len(points), np.int64)
    material[point] = truth["point"].to_numpy()
    table = episode.points()
    m0, m1 = (table[name].to_numpy()[material] for name in ("m0", "m1"))
    return found, material_colours(m0, m1, dataset.tiers[episode.tier])


def draw_tracks(tracks: PredictedTracks, out: Path, frames: Frames[int] | None = None) -> None:
    """Write predicted tracks: a strip of frames, or an animation where the ending is one's.

    Args:
        tracks: From `read_predicted_tracks`.
        out: `.png`, `.jpg`, `.webp`, `.pdf`, `.svg` for a strip; `.gif`, `.mp4` for an animation.
        frames: Frames of the strip; None takes 0, 22 and 87 where the episode has them, else
            three spread over it.

    Raises:
        CallError: A frame is not asked about.
        MissingExtraError: `.mp4` without OpenCV.
    """
    if out.suffix.lower() in ANIMATIONS:
        _animate(tracks, out)
        return
    asked = sorted(tracks.answers)
    if frames is None:
        spread = [asked[k] for k in np.linspace(0, len(asked) - 1, 3).round().astype(int)]
        frames = PAPER_FRAMES if set(PAPER_FRAMES) <= set(asked) else list(dict.fromkeys(spread))
    for frame in frames:
        if frame not in tracks.answers:
            raise CallError(
                "the submission says nothing of this frame",
                where=f"--frames, {tracks.sequence.id}",
                found=frame,
                required=f"{asked[0]} to {asked[-1]}, {len(asked)} of them asked about",
            )
    _strip(tracks, frames).savefig(out)


def _strip(tracks: PredictedTracks, frames: Frames[int]) -> Any:
    """Return a matplotlib figure of frames side by side."""
    from matplotlib.figure import Figure

    width, height = tracks.sequence.size
    figure = Figure(
        figsize=(5.2 * len(frames), 5.2 * height / width + 0.3), dpi=_DPI, facecolor="white"
    )
    figure.subplots_adjust(0.004, 0.005, 0.996, 1 - 0.3 / (5.2 * height / width + 0.3), wspace=0.02)
    axes = figure.subplots(1, len(frames), squeeze=False)[0]
    for axis, frame in zip(axes, frames, strict=True):
        axis.imshow(tracks.sequence.rgb(frame), extent=(0, width, height, 0))
        _draw_points(axis, tracks, frame)
        axis.set(xlim=(0, width), ylim=(height, 0))
        axis.set_axis_off()
        error = "" if frame == tracks.source else _rmse_text(tracks, frame)
        axis.set_title(f"{tracks.method}, {tracks.sequence.id}, frame {frame}{error}", fontsize=10)
    return figure


def _draw_points(axis: Any, tracks: PredictedTracks, frame: int) -> None:
    """Draw the answers as dots and a line to where each visible point truly is."""
    uv = tracks.answers[frame]
    truth = None if tracks.truth is None else tracks.truth.get(frame)
    for k, colour in enumerate(tracks.colours):
        if truth is not None and np.isfinite(truth[k]).all():
            axis.plot(*np.stack([uv[k], truth[k]]).T, color="white", lw=1.2)
        hidden = truth is not None and not np.isfinite(truth[k]).all()
        axis.plot(
            *uv[k],
            "o",
            ms=5.5,
            mfc="none" if hidden else colour,
            mec=colour if hidden else "white",
            mew=0.9,
        )


def _rmse_text(tracks: PredictedTracks, frame: int) -> str:
    if tracks.truth is None or frame not in tracks.truth:
        return ""
    error = np.linalg.norm(tracks.answers[frame] - tracks.truth[frame], axis=1)
    error = error[np.isfinite(error)]
    if not len(error):
        return ""
    return f", RMSE {np.sqrt(np.mean(error**2)):.1f} px"


def _animate(tracks: PredictedTracks, out: Path) -> None:
    """Write every frame that is asked about, with short trails."""
    from PIL import Image, ImageDraw

    asked = sorted(tracks.answers)
    width, height = tracks.sequence.size
    scale = min(1.0, _ANIMATION_WIDTH_PX / width)
    # Codecs want even sides.
    size = (2 * round(width * scale / 2), 2 * round(height * scale / 2))
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
    if out.suffix.lower() == ".gif":
        first, *rest = [picture.quantize(128) for picture in pictures]
        milliseconds = round(1000 / _FRAMES_A_SECOND)
        first.save(out, save_all=True, append_images=rest, duration=milliseconds, loop=0)
    else:
        _write_mp4([np.asarray(picture) for picture in pictures], out)


def _write_mp4(pictures: list[Rgb], out: Path) -> None:
    try:
        import cv2
    except ImportError as error:
        raise MissingExtraError("writing .mp4 (a .gif needs nothing)", "classical") from error
    height, width = pictures[0].shape[:2]
    code = cv2.VideoWriter.fourcc(*"mp4v")
    writer = cv2.VideoWriter(str(out), code, _FRAMES_A_SECOND, (width, height))
    if not writer.isOpened():
        raise CallError("this OpenCV cannot write .mp4", path=out, fix="Write a .gif")
    for picture in pictures:
        writer.write(np.ascontiguousarray(picture[..., ::-1]))
    writer.release()
