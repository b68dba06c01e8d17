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
from pliant.spec.storage import layout
from pliant.viewer.drawing import DRAWINGS, PICTURES, check_ending
from pliant.viewer.tracks import draw_tracks

_SHEETS: Final = ("sheet", "index", "depth")
FIGURES: Final = (*_SHEETS, "tracks")

_NEEDED: Final = {
    "index": layout.depth_name(0),
    "depth": layout.depth_name(0),
    "tracks": layout.POINTS_TABLE,
}

_STEPS: Final = 8  # panels of tracks at most


def draw_figure(
    root: Path,
    out: Path,
    *,
    figure: str = "sheet",
    sequence: str | None = None,
    count: int = 24,
) -> Path:
    """Draw a figure of a dataset.

    Args:
        root: The dataset's folder.
        out: The image to write; `.png`, `.jpg`, `.webp`, and for `tracks` also `.pdf` and
            `.svg`.
        figure: One of `FIGURES`.
        sequence: Id of a sequence; None takes all (sheets) or the first that fits (tracks).
        count: Images on a sheet, or of `tracks`.

    Returns:
        `out`.

    Raises:
        CallError: The sequence or the file's ending cannot be served.
    """
    if count < 1:
        raise CallError("invalid number of images", where="--count", found=count, required=">= 1")
    check_ending(out, PICTURES if figure in _SHEETS else DRAWINGS)
    dataset = Dataset.open(root)
    chosen = [dataset.chosen(sequence)] if sequence else list(dataset.sequences)
    if not chosen:
        raise CallError("the dataset has no sequences", path=root)
    if figure in _NEEDED:  # withheld sequences and imported ones do not have it
        chosen = [each for each in chosen if each.has(_NEEDED[figure])]
    if not chosen:
        raise CallError(
            "the dataset does not contain what the figure shows",
            path=root,
            where=f"--figure {figure}",
            required=f"a sequence with {_NEEDED[figure]}",
            fix="Draw the pictures alone, with --figure sheet.",
        )
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as partial:
        if figure in _SHEETS:
            sheet = Image.fromarray(contact_sheet(dataset, chosen, figure, count))
            sheet.save(partial, quality=88)  # PNG has none
        else:
            episode = next((s for s in chosen if s.temporal), chosen[0])
            frames = evenly(min(count, _STEPS), episode.frames)
            draw_tracks(episode, frames, partial)
    return out
