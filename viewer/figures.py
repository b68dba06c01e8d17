"""Figures of a dataset: contact sheets, index colours, depth, tracks.

They are drawn from the files alone, so that they show what a reader of the dataset gets.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from PIL import Image

from pliant.evaluator.report.contact_sheet import contact_sheet, evenly
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.writing import replacing
from pliant.viewer.drawing import DRAWINGS, PICTURES, check_ending
from pliant.viewer.reading_tracks import annotated_points, predicted_tracks, true_tracks
from pliant.viewer.tracks import draw_tracks

_SHEETS: Final = ("sheet", "index", "depth")
FIGURES: Final = (*_SHEETS, "tracks", "points")
PAPER_FRAMES: Final = (0, 22, 87)
"""The frames that the paper's figure of tracked points shows."""

_STEPS: Final = 8  # panels of true tracks at most


def draw_figure(
    root: Path,
    out: Path,
    *,
    figure: str = "sheet",
    sequence: str | None = None,
    count: int = 24,
    truth: Path | None = None,
) -> Path:
    """Draw a figure of a dataset.

    Args:
        root: The dataset's folder.
        out: The image to write; `.png`, `.jpg`, `.webp`, and for `tracks` and `points` also `.pdf`
            and `.svg`.
        figure: One of `FIGURES`.
        sequence: Id of a sequence; None takes all (sheets) or the first that fits (the others).
        count: Images on a sheet, or of `tracks` or `points`.
        truth: Of `points`, the truth where the dataset does not contain it.

    Returns:
        `out`.

    Raises:
        CallError: The figure, the sequence or the file's ending cannot be served.
    """
    if figure not in FIGURES:
        raise CallError(
            "unknown figure", where="--figure", found=figure, required=", ".join(FIGURES)
        )
    if count < 1:
        raise CallError("no images are asked for", where="--count", found=count, required=">= 1")
    check_ending(out, PICTURES if figure in _SHEETS else DRAWINGS)
    dataset = Dataset.open(root)
    chosen = [dataset.sequence(sequence)] if sequence else list(dataset.sequences)
    if not chosen:
        raise CallError("the dataset has no sequences", path=root)
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as partial:
        if figure in _SHEETS:
            sheet = Image.fromarray(contact_sheet(dataset, chosen, figure, count))
            sheet.save(partial, quality=88)  # PNG has none
        elif figure == "points":
            points = annotated_points(dataset, chosen[0], truth)
            asked = sorted(points.places)
            draw_tracks(points, [asked[k] for k in evenly(count, len(asked))], partial)
        else:
            episode = next((s for s in chosen if s.temporal), chosen[0])
            frames = evenly(min(count, _STEPS), episode.frames)
            draw_tracks(true_tracks(episode), frames, partial)
    return out


def draw_predicted_tracks(
    root: Path,
    submission: Path,
    out: Path,
    *,
    sequence: str | None = None,
    frames: list[int] | None = None,
) -> Path:
    """Draw a submission's tracks through an episode.

    Args:
        root: The dataset's folder.
        submission: The submission, of kind `answers`.
        out: The image, as for `tracks`.
        sequence: Id of an episode; None takes the first that is asked about.
        frames: Frames of the image; None takes 0, 22 and 87 where there are those.

    Returns:
        `out`.

    Raises:
        CallError: The submission, the episode, a frame or the file's ending cannot be served.
    """
    check_ending(out, DRAWINGS)
    tracks = predicted_tracks(Dataset.open(root), submission, sequence)
    asked = sorted(tracks.places)
    if frames is None:
        paper = set(PAPER_FRAMES) <= set(asked)
        frames = list(PAPER_FRAMES) if paper else [asked[k] for k in evenly(3, len(asked))]
    for frame in frames:
        if frame not in tracks.places:
            raise CallError(
                "the submission says nothing of this frame",
                where=f"--frames, {tracks.sequence.id}",
                found=frame,
                required=f"{asked[0]} to {asked[-1]}, {len(asked)} of them asked about",
            )
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as partial:
        draw_tracks(tracks, frames, partial, columns=len(frames), width_in=5.2)
    return out
