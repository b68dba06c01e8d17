"""Every reader of files from strangers, as a function of bytes, with right files to start from.

A reader may return, or raise a `PliantError`. Anything else is a finding.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from pliant.converters.formats import read_source
from pliant.converters.tapvid import read_npz
from pliant.evaluator import check
from pliant.evaluator.submission.loading import load_in_memory  # noqa: F401 - instrumented
from pliant.generator.config import GenerateConfig
from pliant.models.don.settings import DonSettings
from pliant.spec.configuration import read_settings
from pliant.spec.dataset import SAMPLE, Dataset
from pliant.spec.io.exr import read_camera_depth, read_surface
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.io.parquet import read_footer, read_table
from pliant.spec.io.photo import read_photo
from pliant.spec.io.png import read_mask, read_rgb
from pliant.spec.io.reading import AnyFile, read_bytes
from pliant.spec.tables import TABLES

ROOT: Final = Path(__file__).parents[2]
TINY: Final = ROOT / "tests" / "data" / "tiny-submission"
MAX_BYTES: Final = 1 << 16
"""Longest input that is tried; larger seeds are cut, as a broken download is."""


@dataclass(frozen=True)
class Reader:
    """A reader under test.

    Attributes:
        read: Reads a file at a path.
        seeds: Right files to change.
        suffix: Ending of the file's name.
    """

    read: Callable[[Path], object]
    seeds: Callable[[], Iterable[bytes]]
    suffix: str = ""


@cache
def sample() -> Dataset:
    return Dataset.open(SAMPLE)


@cache
def tiny() -> Dataset:
    return Dataset.open(TINY / "dataset")


def _of_sample(*names: str) -> Callable[[], list[bytes]]:
    def seeds() -> list[bytes]:
        sequence = sample().sequences[0]
        files: list[AnyFile] = [sequence.file(name) for name in names]
        return [read_bytes(file, 1 << 24) for file in files]

    return seeds


def _at_root(*names: str) -> Callable[[], list[bytes]]:
    return lambda: [(SAMPLE / name).read_bytes() for name in names]


def _texts(*texts: str) -> Callable[[], list[bytes]]:
    return lambda: [text.encode() for text in texts]


def _npz() -> list[bytes]:
    arrays = {
        "video": np.zeros((2, 4, 6, 3), np.uint8),
        "points": np.full((1, 2, 2), 0.5, np.float32),
        "occluded": np.zeros((1, 2), bool),
    }
    packed, plain = io.BytesIO(), io.BytesIO()
    np.savez_compressed(packed, **arrays)  # type: ignore[arg-type]
    np.savez(plain, **arrays)  # type: ignore[arg-type]
    empty = io.BytesIO()
    zipfile.ZipFile(empty, "w").close()
    return [packed.getvalue(), plain.getvalue(), empty.getvalue()]


def _packed(path: Path) -> object:
    """Open a packed dataset whose index is the file."""
    folder = path.with_suffix(".dataset")
    folder.mkdir(exist_ok=True)
    for entry in SAMPLE.iterdir():
        link = folder / entry.name
        if entry.name != "index.parquet" and not link.exists():
            link.symlink_to(entry)
    (folder / "index.parquet").unlink(missing_ok=True)
    (folder / "index.parquet").symlink_to(path)
    frame = Dataset.open(folder).frame("rope-train-000000", 0)
    return frame.rgb, frame.surface, frame.camera


def _tables(path: Path) -> object:
    """Read a table under each of the names that its columns may have."""
    read_footer(path)
    for name in TABLES:
        try:
            return read_table(path, name)
        except Exception as error:
            last = error
    raise last


_COCO: Final = json.dumps(
    {
        "images": [{"id": 1, "file_name": "a.png", "width": 6, "height": 4}],
        "categories": [{"id": 1, "name": "rope", "keypoints": ["end"]}],
        "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "keypoints": [1, 2, 2]}],
    }
)
_LABELME: Final = json.dumps(
    {
        "version": "5.0",
        "imagePath": "a.png",
        "imageWidth": 6,
        "imageHeight": 4,
        "shapes": [{"label": "end", "shape_type": "point", "points": [[1.0, 2.0]], "flags": {}}],
    }
)
_CONFIGS: Final = _texts(
    "tiers: [rope]\nseed: 3\nrope: {length_m: [1.1, 1.6], ball: false}\n",
    "width: 160\nsteps: 10\npairs: {views: 4, input: grey}\naugment: &a {scale: 0.1}\n",
)

READERS: Final[dict[str, Reader]] = {
    "json-dataset": Reader(
        lambda path: read_json(path, "dataset"), _at_root("dataset.json"), ".json"
    ),
    "json-sequence": Reader(
        lambda path: read_json(path, "sequence"), _of_sample("sequence.json"), ".json"
    ),
    "json-cameras": Reader(
        lambda path: read_json(path, "cameras"), _of_sample("cameras.json"), ".json"
    ),
    "parquet": Reader(_tables, _of_sample("points.parquet", "correspondences.parquet"), ".parquet"),
    "queries": Reader(
        lambda path: read_table(path, "queries"), _at_root("queries/val.parquet"), ".parquet"
    ),
    "submission": Reader(
        lambda path: check(path, tiny()),
        lambda: [(TINY / "submission.parquet").read_bytes()],
        ".parquet",
    ),
    "packed-index": Reader(_packed, _at_root("index.parquet"), ".parquet"),
    "exr": Reader(read_surface, _of_sample("depth/000000.exr"), ".exr"),
    "exr-depth": Reader(read_camera_depth, _of_sample("depth/000000.exr"), ".exr"),
    "png": Reader(read_rgb, _of_sample("rgb/000000.png"), ".png"),
    "png-mask": Reader(read_mask, _of_sample("rgb/000000.png"), ".png"),
    "photo": Reader(read_photo, _of_sample("rgb/000000.png"), ".jpg"),
    "generate-config": Reader(lambda path: read_settings(GenerateConfig, path), _CONFIGS, ".yaml"),
    "train-config": Reader(lambda path: read_settings(DonSettings, path), _CONFIGS, ".yaml"),
    "marks-csv": Reader(
        read_source, _texts("picture,point,x,y,visible\na.png,end,1.5,2.5,1\n"), ".csv"
    ),
    "coco": Reader(read_source, _texts(_COCO), ".json"),
    "labelme": Reader(read_source, _texts(_LABELME), ".json"),
    "tapvid": Reader(read_npz, _npz, ".npz"),
}
"""Name -> reader. The HTTP routes of the service are fuzzed by tests/service/test_fuzz.py."""
