"""Contact sheets: frames of a dataset in a grid, over index colours and depth.

They are drawn from the files alone, so that they show what a reader of the dataset gets.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pliant.evaluator.report.colours import depth_image, index_image
from pliant.spec.arrays import Rgb
from pliant.spec.dataset import Dataset
from pliant.spec.model import Tier
from pliant.spec.sequence import RecordedFrame, SequenceRecord

_TILE_PX: Final = 240
_GAP_PX: Final = 6
_UNKNOWN_GREY: Final = 235


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
        images = {"index": index_image(surface, tier), "depth": depth_image(surface.depth_m)}
        if layer == "sheet":
            parts = [_resized(image, half) for image in images.values()]
            rows.append(np.concatenate(parts, axis=1))
        else:
            rows.append(_resized(images[layer], (_TILE_PX, height)))
    shape = f" {frame.sequence.shape}" if frame.sequence.shape else ""
    text = Image.new("RGB", (_TILE_PX, 16), "white")
    draw = ImageDraw.Draw(text)
    draw.fontmode = "1"  # no soft edges: the paper around the text may be made transparent
    font = ImageFont.load_default(11)
    name, rest = frame.sequence.id, f" #{frame.index}{shape}"
    while len(name) > 1 and draw.textlength(name + rest, font) > _TILE_PX - 2:
        name = f"…{name[2:]}"  # the end tells sequences apart
    draw.text((1, 1), name + rest, fill=(112, 122, 130), font=font)
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


def evenly(count: int, of: int) -> list[int]:
    """Return at most `count` different indices, spread evenly over 0 to `of` - 1."""
    picks = np.linspace(0, of - 1, min(count, of)).round().astype(int)
    return [int(pick) for pick in np.unique(picks)]
