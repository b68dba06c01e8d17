"""Importing from the command line, and what the imported dataset asks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.cli.main import run
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import read_table
from pliant.spec.validation.validate import validate


def rows_of(path: Path, name: str) -> dict[tuple[int, ...], dict[str, Any]]:
    """Rows of a table by what they ask: source frame, target frame and the like are in it."""
    return {(row["pair_id"], row["query_id"]): row for row in read_table(path, name).to_pylist()}


def asked_and_true(out: Path) -> list[tuple[Any, ...]]:
    """(frame a, u, v, frame b, u, v, state, box) of every query, by pair and u in frame a."""
    queries = rows_of(out / "queries" / "test.parquet", "queries")
    truth = rows_of(out.with_name(f"{out.name}-truth") / "test.parquet", "truth")
    return [
        (
            *(queries[key][name] for name in ("frame_a", "u_a", "v_a", "frame_b")),
            *(truth[key][name] for name in ("u_b", "v_b", "visibility_b", "box_px")),
        )
        for key in sorted(queries, key=lambda key: (key[0], queries[key]["u_a"]))
    ]


def marked(folder: Path, marks: Mapping[str, Mapping[str, tuple[float, float]]]) -> Path:
    """Write pictures of noise, 80 x 60, by name, with their marks, masks and depth images."""
    random, rows = np.random.default_rng(0), ["picture,point,x,y,visible"]
    for name, points in marks.items():
        images: dict[str, npt.NDArray[Any]] = {
            "": random.integers(0, 255, (60, 80, 3), np.uint8),
            "masks": np.full((60, 80), 255, np.uint8),
            "depth": np.tile(np.arange(800, 880, dtype=np.uint16), (60, 1)),
        }
        for kind, values in images.items():
            (folder / kind).mkdir(parents=True, exist_ok=True)
            Image.fromarray(values).save(folder / kind / name)
        rows += [f"{name},{point},{u},{v},1" for point, (u, v) in points.items()]
    (folder / "annotations.csv").write_text("\n".join(rows))
    return folder


def imported(source: Path, out: Path, *options: str, warned: str = "") -> Dataset:
    """Import, validate (with no issue but warnings of one code) and open a dataset."""
    assert run(["import", str(source), "--out", str(out), *options]) == 0
    result = validate(out)
    assert {issue.code for issue in result.issues} <= {warned}, list(map(str, result.issues))
    return Dataset.open(out)


def asked(out: Path) -> set[tuple[Any, ...]]:
    """(frame a, u, v, frame b, u, v, state) of every query."""
    return {row[:7] for row in asked_and_true(out)}
