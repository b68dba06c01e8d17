"""Figures of a dataset: contact sheets, index colours, depth, tracks.

They are drawn from the files alone, so that they show what a reader of the dataset gets.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pliant.spec.arrays import Rgb
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.writing import replacing
from pliant.spec.model import Tier
from pliant.spec.sequence import RecordedFrame, SequenceRecord
from pliant.viewer.drawing import DRAWINGS, PICTURES, check_ending, depth_image, evenly, index_image
from pliant.viewer.point_tracks import draw_annotated_points, draw_point_tracks
from pliant.viewer.tracks import ANIMATION, draw_tracks, read_predicted_tracks

_SHEETS: Final = ("sheet", "index", "depth")
FIGURES: Final = (*_SHEETS, "tracks", "points")

_TILE_PX: Final = 240
_GAP_PX: Final = 6
_UNKNOWN_GREY: Final = 235


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
        frame: RecordedFrame of `anatomy`.
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
            if out.suffix.lower() in (".jpg", ".jpeg"):
                sheet.save(partial, quality=88)
            else:
                sheet.save(partial)
        elif figure == "points":
            draw_annotated_points(dataset, chosen[0], truth, count, partial)
        else:
            episode = next((s for s in chosen if s.temporal), chosen[0])
            draw_point_tracks(episode, count, partial)
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
        out: The image (as for `tracks`), or a `.gif` of all frames.
        sequence: Id of an episode; None takes the first that is asked about.
        frames: Frames of the image; None takes 0, 22 and 87 where there are those.

    Returns:
        `out`.

    Raises:
        CallError: The submission, the episode, a frame or the file's ending cannot be served.
    """
    check_ending(out, (*DRAWINGS, ANIMATION))
    tracks = read_predicted_tracks(Dataset.open(root), submission, sequence)
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as partial:
        draw_tracks(tracks, partial, frames)
    return out


def contact_sheet(
    dataset: Dataset, sequences: Sequence[SequenceRecord], layer: str = "sheet", count: int = 24
) -> Rgb:
    """Draw frames in a grid, spread evenly over the sequences.

    Args:
        dataset: The dataset.
        sequences: Where the frames come from.
        layer: `sheet` (colour over index colours and depth), `index`, `depth` or `rgb` alone; the
            last needs no surface images.
        count: Number of frames at most.

    Returns:
        uint8 (H, W, 3).
    """
    # Held-out and imported sequences come without surface images: grey, or nothing if all do.
    if layer == "sheet" and not any(s[0].has_surface for s in sequences):
        layer = "rgb"
    tiles = [
        _tile(frame, dataset.tiers[frame.sequence.tier], layer)
        for frame in _spread_frames(sequences, count)
    ]
    columns = min(len(tiles), max(1, math.ceil(math.sqrt(1.5 * len(tiles)))))
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % columns)
    cells = np.pad(
        np.stack(tiles), ((0, 0), (_GAP_PX, 0), (_GAP_PX, 0), (0, 0)), constant_values=255
    )
    _, tall, wide, _ = cells.shape
    grid = cells.reshape(-1, columns, tall, wide, 3).swapaxes(1, 2)
    sheet = grid.reshape(-1, columns * wide, 3)
    return np.pad(sheet, ((0, _GAP_PX), (0, _GAP_PX), (0, 0)), constant_values=255)


def _tile(frame: RecordedFrame, tier: Tier, layer: str) -> Rgb:
    """Return one frame of a sheet under a line of text."""
    size = frame.size
    height = round(_TILE_PX * size[1] / size[0])
    half = (_TILE_PX // 2, height // 2)
    rows: list[Rgb] = []
    if layer in ("rgb", "sheet"):
        rows.append(_resized(frame.rgb, (_TILE_PX, height)))
    if layer == "sheet" and not frame.has_surface:
        rows.append(np.full((half[1], _TILE_PX, 3), _UNKNOWN_GREY, np.uint8))
    elif layer != "rgb":
        surface = frame.sequence.surface(frame.index)
        images = {"index": index_image(surface, tier), "depth": depth_image(surface)}
        if layer == "sheet":
            parts = [_resized(image, half) for image in images.values()]
            rows.append(np.concatenate(parts, axis=1))
        else:
            rows.append(_resized(images[layer], (_TILE_PX, height)))
    shape = f" {frame.sequence.shape}" if frame.sequence.shape else ""
    text = Image.new("RGB", (_TILE_PX, 16), "white")
    ImageDraw.Draw(text).text(
        (1, 1),
        f"{frame.sequence.id} #{frame.index}{shape}",
        fill=(40, 40, 40),
        font=ImageFont.load_default(11),
    )
    return np.concatenate([np.asarray(text), *rows])


def _spread_frames(sequences: Sequence[SequenceRecord], count: int) -> list[RecordedFrame]:
    """Choose frames: each sequence once before any a second time, evenly over its frames."""
    if count <= len(sequences):
        return [sequences[k][0] for k in evenly(count, len(sequences))]
    whole, rest = divmod(count, len(sequences))
    return [
        sequence[frame]
        for k, sequence in enumerate(sequences)
        for frame in evenly(whole + (k < rest), sequence.frames)
    ]


def _resized(image: Rgb, size: tuple[int, int]) -> Rgb:
    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.LANCZOS))
