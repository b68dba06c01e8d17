"""A dataset whose truth is an affine map: a coloured square sheet on a grey table, seen from above.

Frame f of a sequence shows the sheet turned, scaled and shifted; a pixel's material coordinate
and a material point's pixel are then each other's inverse, exactly. Half of one edge is hidden
by a strip that belongs to another object.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pliant.spec.arrays import FloatArray
from pliant.spec.io.exr import Surface
from pliant.spec.storage import layout
from tests.dataset_files import (
    FrameFiles,
    coordinate,
    listing_row,
    points_table,
    tier,
    write_dataset,
    write_frames,
)

SIDE_M = 0.5
GRID = 13


def sheet_map(seed: int, frame: int, size: tuple[int, int], step: float) -> FloatArray:
    """Return float64 (2, 3): pixel = M (m0, m1, 1)."""
    rng = np.random.default_rng([seed, 0 if step else frame])
    angle = rng.uniform(-0.6, 0.6) + step * frame
    scale = min(size) * rng.uniform(0.5, 0.62)
    cos, sin = scale * np.cos(angle), scale * np.sin(angle)
    linear = np.array([[cos, -sin], [sin, cos]])
    centre = np.array(size) / 2 + rng.uniform(-0.06, 0.06, 2) * min(size)
    return np.column_stack([linear, centre - linear @ [0.5, 0.5]])


def colour(material: FloatArray) -> FloatArray:
    """Return RGB (0 to 1) of the sheet's print: smooth, and different everywhere."""
    u, v = material[..., 0], material[..., 1]
    return np.stack(
        [0.15 + 0.7 * u, 0.15 + 0.7 * v, 0.5 + 0.35 * np.sin(9 * u) * np.cos(7 * v)], axis=-1
    )


def write_sheet_dataset(
    root: Path,
    splits: dict[str, int],
    *,
    frames: int = 1,
    temporal: bool = False,
    size: tuple[int, int] = (160, 120),
    symmetric: bool = False,
    grid: int = GRID,
) -> Path:
    """Write the dataset and return its folder."""
    root.mkdir(parents=True)
    symmetries = [("half-turn", [[-1, 0], [0, -1]], [1, 1])] if symmetric else []
    square = [coordinate(name, 0.0, 1.0, SIDE_M) for name in ("u", "v")]
    described = tier("sheet", "cloth", {"sheet": square, "strip": square}, symmetries)
    ticks = np.linspace(0, 1, grid)
    material = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    partners = np.arange(len(material))[::-1, None][:, : len(symmetries)]
    points = points_table(material, partners)
    rows = []
    for split, number in splits.items():
        for index in range(number):
            seed = 1000 * sorted(splits).index(split) + index
            name = f"sheet-{split}-{index:06d}"
            step = 0.05 if temporal else 0.0
            shown = [
                _frame(sheet_map(seed, frame, size, step), size, material)
                for frame in range(frames)
            ]
            write_frames(root / layout.sequence_name("sheet", name), points, shown)
            rows.append(listing_row(name, "sheet", split, frames, temporal=temporal, coverage=1.0))
    write_dataset(root, "sheets", rows, [described], size, splits=list(splits))
    return root


def _frame(affine: FloatArray, size: tuple[int, int], material: FloatArray) -> FrameFiles:
    width, height = size
    inverse = np.linalg.inv(affine[:, :2])
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    seen = (np.stack([u, v], axis=-1) - affine[:, 2]) @ inverse.T  # (H, W, 2)
    on = (seen >= 0).all(axis=-1) & (seen <= 1).all(axis=-1)
    strip = on & (seen[..., 0] > 0.9) & (seen[..., 1] < 0.5)
    rgb = np.where(on[..., None], colour(seen), 0.45)
    rgb[strip] = 0.1
    surface = Surface(
        np.where(on, 1.0 - 0.01 * strip, np.inf).astype(np.float32),
        np.where(on, seen[..., 0], 0.0).astype(np.float32),
        np.where(on, seen[..., 1], 0.0).astype(np.float32),
        (on.astype(np.uint32) + strip).astype(np.uint32),
    )
    uv = material @ affine[:, :2].T + affine[:, 2]
    hidden = (material[:, 0] > 0.9) & (material[:, 1] < 0.5)
    inside = (uv >= 0).all(axis=1) & (uv < size).all(axis=1)
    states = np.where(inside, np.where(hidden, "occluded", "visible"), "out_of_frame")
    xyz = np.column_stack([material, np.zeros(len(material))])
    pixels = (rgb * 255).round().astype(np.uint8)
    return FrameFiles(surface, pixels, uv, np.ones(len(material)), states.tolist(), xyz)
