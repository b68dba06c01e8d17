"""Writes datasets whose truth is worked out by hand, for tests that say what is in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.arrays import FloatArray, Rgb
from pliant.spec.conventions import CONVENTIONS, SPEC_VERSION
from pliant.spec.io.exr import Surface, write_surface
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.parquet import write_table
from pliant.spec.io.png import write_rgb
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage import layout
from pliant.spec.tables import CORRESPONDENCES, POINTS, QUERIES, SEQUENCES, TRUTH

Document = dict[str, Any]


def coordinate(
    name: str, low: float, high: float, metres: float, period: float | None = None
) -> Document:
    """Return a material coordinate of `dataset.json`."""
    return {"name": name, "min": low, "max": high, "metres_per_unit": metres, "period": period}


def tier(
    name: str,
    kind: str,
    objects: Mapping[str, Sequence[Document]],
    symmetries: Sequence[tuple[str, Any, Any]] = (),
    variant: str = "plain",
) -> Document:
    """Return a tier of `dataset.json`.

    Args:
        name: Its name.
        kind: `rope` or `cloth`.
        objects: Name -> two coordinates; ids count from 1, and the first is asked about.
        symmetries: (name, matrix, offset) each.
        variant: Appearance that the symmetries depend on.
    """
    return {
        "name": name,
        "kind": kind,
        "variant": variant,
        "queried_object": 1,
        "objects": [
            {"id": number, "name": each, "material": list(material)}
            for number, (each, material) in enumerate(objects.items(), 1)
        ],
        "symmetries": [
            {"name": label, "matrix": matrix, "offset": offset}
            for label, matrix, offset in symmetries
        ],
    }


def points_table(
    material: FloatArray,
    partners: npt.NDArray[np.int64],
    object_id: npt.NDArray[np.int64] | None = None,
    centreline: npt.NDArray[np.bool_] | None = None,
) -> pa.Table:
    """Return a table of points.

    Args:
        material: float (P, 2).
        partners: int64 (P, S).
        object_id: int64 (P,), or None for 1.
        centreline: bool (P,), or None for surface points alone.
    """
    count = len(material)
    line = np.zeros(count, np.bool_) if centreline is None else centreline
    return pa.table(
        {
            "point": np.arange(count, dtype=np.int32),
            "object": np.broadcast_to(1 if object_id is None else object_id, count).astype("int32"),
            "kind": ["centreline" if each else "surface" for each in line],
            "m0": material[:, 0].astype(np.float32),
            "m1": material[:, 1].astype(np.float32),
            "partners": pa.array(partners.tolist(), POINTS.field("partners").type),
        }
    )


class FrameFiles(NamedTuple):
    """What the files of one frame say.

    Attributes:
        surface: Depth and surface image.
        rgb: Colour image.
        uv_px: float (P, 2), where the points are seen.
        depth_m: float (P,), their depth.
        states: P visibility states.
        xyz_m: float (P, 3), their positions.
    """

    surface: Surface
    rgb: Rgb
    uv_px: FloatArray
    depth_m: FloatArray
    states: Sequence[str]
    xyz_m: FloatArray


def write_frames(folder: Path, points: pa.Table, frames: Sequence[FrameFiles]) -> None:
    """Write the images and the two tables of a sequence."""
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    tables = []
    for number, frame in enumerate(frames):
        write_rgb(folder / layout.rgb_name(number), frame.rgb)
        write_surface(folder / layout.depth_name(number), frame.surface)
        numbers = np.column_stack([frame.uv_px, frame.depth_m, frame.xyz_m]).astype(np.float32).T
        count = len(frame.states)
        columns = [
            np.full(count, number, np.int32),
            np.arange(count, dtype=np.int32),
            *numbers[:3],
            frame.states,
            *numbers[3:],
        ]
        arrays = [pa.array(c, f.type) for c, f in zip(columns, CORRESPONDENCES, strict=True)]
        tables.append(pa.Table.from_arrays(arrays, schema=CORRESPONDENCES))
    write_table(folder / layout.POINTS_TABLE, points, "points")
    write_table(folder / layout.CORRESPONDENCES_TABLE, pa.concat_tables(tables), "correspondences")


def listing_row(name: str, tier: str, split: str, frames: int, **changes: Any) -> Document:
    """Return a row of sequences.parquet."""
    return {
        "id": name,
        "tier": tier,
        "split": split,
        "shape": None,
        "frames": frames,
        "temporal": False,
        "seed": 0,
        "style": "external",
        "coverage": None,
        "self_occluded": 0.0,
        **changes,
    }


def write_dataset(
    root: Path,
    name: str,
    rows: Sequence[Document],
    tiers: Sequence[Document],
    size: tuple[int, int],
    **changes: Any,
) -> None:
    """Write sequences.parquet and dataset.json; `changes` are fields of the latter."""
    identity = {"id": name, "version": "1.0.0"}
    table = pa.Table.from_pylist(list(rows), schema=SEQUENCES)
    write_table(root / layout.SEQUENCES_TABLE, table, "sequences", {"dataset": identity})
    document = {
        "spec_version": SPEC_VERSION,
        **identity,
        "title": name,
        "description": "Scenes in closed form, for testing readers and validators.",
        "licence": "CC0-1.0",
        "conventions": CONVENTIONS,
        "image_size": {"width": size[0], "height": size[1]},
        "tiers": list(tiers),
        "splits": sorted({row["split"] for row in rows}, reverse=True),
        "provenance": {"generator": "tests", "seed": 0, "config": {}, "tools": {}},
        **changes,
    }
    write_json(root / layout.DATASET_JSON, document, "dataset")


def write_queries(
    root: Path, name: str, split: str, queries: Sequence[Document], truth: Sequence[Document]
) -> tuple[pa.Table, pa.Table]:
    """Write the queries and the truth of a split of the dataset `name`; return both tables."""
    asked = pa.Table.from_pylist(list(queries), schema=QUERIES)
    true = pa.Table.from_pylist(list(truth), schema=TRUTH)
    footer = {"dataset": {"id": name, "version": "1.0.0"}, "split": split}
    path, truth_path = root / layout.queries_name(split), root / layout.truth_name(split)
    for each in (path, truth_path):
        each.parent.mkdir(exist_ok=True)
    write_table(path, asked, "queries", footer)
    write_table(truth_path, true, "truth", {**footer, "queries_sha256": sha256_file(path)})
    return asked, true
