"""Every reader of a file answers damaged bytes with a value or an error of ours, never another."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pliant.spec.errors import PliantError
from pliant.spec.io import exr, jsonfiles, parquet, photo, png, yamlfiles
from pliant.spec.storage import manifest

BASE = Path(__file__).resolve().parents[3] / "spec" / "conformance" / "datasets" / "full"
ROPE = BASE / "sequences" / "rope" / "rope-train-000000"
SIZE = (32, 24)
PIXELS = np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)
YAML = b"a: &a {b: [1, 2.5, 'x']}\nc: *a\nd:\n  - !!str f\n"


def encoded(kind: str) -> bytes:
    stream = io.BytesIO()
    if kind == "NPZ":
        np.savez(stream, PIXELS)
    elif kind in ("float32", "complex64", "datetime64[s]", "f4,f4"):
        np.save(stream, np.zeros(SIZE[::-1], kind))
    else:
        Image.fromarray(PIXELS).save(stream, kind)
    return stream.getvalue()


def read_depth(path: Path) -> None:
    photo.read_depth(path, SIZE)


def read_picture(path: Path) -> None:
    photo.photo_size(path)
    photo.read_mask(path, SIZE)


READERS: dict[str, tuple[str, bytes, Callable[[Path], object]]] = {
    **{kind: ("a.png", encoded(kind), read_picture) for kind in ("JPEG", "TIFF", "WEBP", "GIF")},
    **{kind: ("a.npy", encoded(kind), read_depth) for kind in ("NPZ", "float32", "complex64")},
    **{kind: ("a.npy", encoded(kind), read_depth) for kind in ("datetime64[s]", "f4,f4")},
    "depth-png": ("a.png", encoded("PNG"), read_depth),
    "png": ("a.png", (ROPE / "rgb/000000.png").read_bytes(), png.read_rgb),
    "remarks": (
        "a.png",
        (ROPE / "rgb/000000.png").read_bytes(),
        lambda path: png.png_remarks(path.read_bytes()),
    ),
    "exr": ("a.exr", (ROPE / "depth/000000.exr").read_bytes(), exr.read_surface),
    "json": (
        "a.json",
        (BASE / "dataset.json").read_bytes(),
        lambda path: jsonfiles.read_json(path, "dataset"),
    ),
    "yaml": ("a.yaml", YAML, yamlfiles.read_yaml),
    "points": (
        "a.parquet",
        (ROPE / "points.parquet").read_bytes(),
        lambda path: parquet.read_table(path, "points"),
    ),
    "truth": (
        "a.parquet",
        (BASE / "truth/test.parquet").read_bytes(),
        lambda path: parquet.read_table(path, "truth"),
    ),
    "checksums": ("SHA256SUMS", b"0" * 64 + b"  a/b\n", manifest.read_checksums),
}


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    if rng.random() < 0.1:
        return data[: int(rng.integers(len(data) + 1))]
    found = bytearray(data)
    for _ in range(int(rng.choice([0, 1, 2, 4, 16]))):
        at = int(rng.integers(len(found)))
        new = [bytes([found[at] ^ 1 << int(rng.integers(8))]), b"\xff" * 4, b"\0" * 4, rng.bytes(3)]
        piece = new[int(rng.integers(len(new)))]
        found[at : at + len(piece)] = piece
    return bytes(found)


@pytest.mark.parametrize("count", [150, pytest.param(5000, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", list(READERS))
def test_damaged_file_is_read_or_refused(tmp_path: Path, name: str, count: int) -> None:
    file, data, read = READERS[name]
    path = tmp_path / file
    rng = np.random.default_rng(1)
    refusals: list[str] = []
    for _ in range(count):
        path.write_bytes(damaged(data, rng))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                read(path)
        except PliantError as error:
            refusals.append(str(error))
    assert all(file in text for text in refusals)
    assert refusals or name == "remarks"
