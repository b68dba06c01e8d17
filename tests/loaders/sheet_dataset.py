"""A dataset whose truth is an affine map: a coloured square sheet on a grey table, seen from above.

Frame f of a sequence shows the sheet turned, scaled and shifted; a pixel's material coordinate
and a material point's pixel are then each other's inverse, exactly. Half of one edge is hidden
by a strip that belongs to another object.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pliant.spec.arrays import FloatArray
from pliant.spec.conventions import CONVENTIONS, SPEC_VERSION
from pliant.spec.io.exr import Surface, write_surface
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.parquet import write_table
from pliant.spec.io.png import write_rgb
from pliant.spec.storage import layout
from pliant.spec.tables import CORRESPONDENCES, POINTS, SEQUENCES

SIDE_M = 0.5
GRID = 13
FOCAL_PX = 200.0


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
    matrix, offset = [[-1, 0], [0, -1]], [1, 1]
    symmetries = [{"name": "half-turn", "matrix": matrix, "offset": offset}] if symmetric else []
    coordinate = {"min": 0.0, "max": 1.0, "metres_per_unit": SIDE_M, "period": None}
    tier: dict[str, Any] = {
        "name": "sheet",
        "kind": "cloth",
        "variant": "plain",
        "queried_object": 1,
        "objects": [
            {
                "id": number,
                "name": name,
                "material": [{"name": "u", **coordinate}, {"name": "v", **coordinate}],
            }
            for number, name in ((1, "sheet"), (2, "strip"))
        ],
        "symmetries": symmetries,
    }
    ticks = np.linspace(0, 1, grid)
    material = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    count = len(material)
    partners = [[count - 1 - i] if symmetric else [] for i in range(count)]
    points = pa.Table.from_arrays(
        [
            pa.array(np.arange(count, dtype=np.int32)),
            pa.array(np.ones(count, np.int32)),
            pa.array(["surface"] * count),
            pa.array(material[:, 0].astype(np.float32)),
            pa.array(material[:, 1].astype(np.float32)),
            pa.array(partners, POINTS.field("partners").type),
        ],
        schema=POINTS,
    )
    rows = []
    for split, number in splits.items():
        for index in range(number):
            seed = 1000 * sorted(splits).index(split) + index
            name = f"sheet-{split}-{index:06d}"
            folder = layout.sequence_dir(root, "sheet", name)
            (folder / "rgb").mkdir(parents=True)
            (folder / "depth").mkdir()
            tables = []
            for frame in range(frames):
                affine = sheet_map(seed, frame, size, 0.05 if temporal else 0.0)
                tables.append(_write_frame(folder, frame, affine, size, material))
            write_table(folder / layout.POINTS_TABLE, points, "points")
            write_table(
                folder / layout.CORRESPONDENCES_TABLE, pa.concat_tables(tables), "correspondences"
            )
            rows.append(
                {
                    "id": name,
                    "tier": "sheet",
                    "split": split,
                    "shape": None,
                    "frames": frames,
                    "temporal": temporal,
                    "seed": 0,
                    "style": "external",
                    "coverage": 1.0,
                    "self_occluded": 0.0,
                }
            )
    write_table(
        root / layout.SEQUENCES_TABLE, pa.Table.from_pylist(rows, schema=SEQUENCES), "sequences"
    )
    write_json(
        root / layout.DATASET_JSON,
        {
            "spec_version": SPEC_VERSION,
            "id": "sheets",
            "version": "1.0.0",
            "title": "Sheets",
            "description": "Coloured sheets seen from above.",
            "licence": "CC-BY-4.0",
            "conventions": CONVENTIONS,
            "image_size": {"width": size[0], "height": size[1]},
            "tiers": [tier],
            "splits": list(splits),
            "provenance": {"generator": "test", "seed": 0, "config": {}, "tools": {}},
        },
        "dataset",
    )
    return root


def _write_frame(
    folder: Path, frame: int, affine: FloatArray, size: tuple[int, int], material: FloatArray
) -> pa.Table:
    width, height = size
    inverse = np.linalg.inv(affine[:, :2])
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    seen = (np.stack([u, v], axis=-1) - affine[:, 2]) @ inverse.T  # (H, W, 2)
    on = (seen >= 0).all(axis=-1) & (seen <= 1).all(axis=-1)
    strip = on & (seen[..., 0] > 0.9) & (seen[..., 1] < 0.5)
    rgb = np.where(on[..., None], colour(seen), 0.45)
    rgb[strip] = 0.1
    write_rgb(folder / layout.rgb_name(frame), (rgb * 255).round().astype(np.uint8))
    write_surface(
        folder / layout.depth_name(frame),
        Surface(
            np.where(on, 1.0 - 0.01 * strip, np.inf).astype(np.float32),
            np.where(on, seen[..., 0], 0.0).astype(np.float32),
            np.where(on, seen[..., 1], 0.0).astype(np.float32),
            (on.astype(np.uint32) + strip).astype(np.uint32),
        ),
    )
    uv = material @ affine[:, :2].T + affine[:, 2]
    hidden = (material[:, 0] > 0.9) & (material[:, 1] < 0.5)
    inside = (uv >= 0).all(axis=1) & (uv < size).all(axis=1)
    states = np.where(inside, np.where(hidden, "occluded", "visible"), "out_of_frame")
    count = len(material)
    columns: list[Any] = [
        np.full(count, frame, np.int32),
        np.arange(count, dtype=np.int32),
        uv[:, 0].astype(np.float32),
        uv[:, 1].astype(np.float32),
        np.ones(count, np.float32),
        pa.array(states.tolist(), pa.string()),
        *(material[:, axis].astype(np.float32) for axis in (0, 1)),
        np.zeros(count, np.float32),
    ]
    return pa.Table.from_arrays([pa.array(c) for c in columns], schema=CORRESPONDENCES)
