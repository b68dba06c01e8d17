"""Every reader of files and requests from strangers, with right ones to start from.

A reader may return, or raise a `PliantError`. Anything else is a finding.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Final

from pliant.evaluator import check
from pliant.evaluator.submission.loading import load_in_memory  # noqa: F401 - instrumented
from pliant.spec.dataset import Dataset
from pliant.spec.io.exr import read_camera_depth, read_surface
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.io.parquet import read_footer, read_table
from pliant.spec.io.parquet_footer import read_column_chunks
from pliant.spec.io.photo import read_photo
from pliant.spec.io.png import read_mask, read_rgb
from pliant.spec.opening import SAMPLE
from pliant.spec.storage.manifest import read_checksums
from pliant.spec.tables import TABLES
from tests.fuzz.foreign import FOREIGN
from tests.fuzz.reader import TINY, Reader, files, in_folder, of_sample, texts, tiny
from tests.fuzz.requests import service_requests, to_service, to_viewer, viewer_requests


def _packed(path: Path) -> object:
    """Open a packed dataset whose index is the file."""
    folder = in_folder(path, "index.parquet", SAMPLE)
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


_MANIFEST: Final = """{"spec_version": "1.0.0", "half": "public", "held_out": ["test"],
 "dataset": {"id": "a", "version": "1"}, "tools": {"pliant": "0.1"},
 "checksums_sha256": "%s", "other_sha256": null}""" % ("0" * 64)

READERS: Final[dict[str, Reader]] = {
    **{
        f"json-{schema}": Reader(partial(read_json, schema=schema), seeds, ".json")
        for schema, seeds in {
            "dataset": files(SAMPLE, "dataset.json"),
            "sequence": of_sample("sequence.json"),
            "cameras": of_sample("cameras.json"),
            "manifest": texts(_MANIFEST),
        }.items()
    },
    "checksums": Reader(read_checksums, texts(f"{'0' * 64}  a/b\n{'1' * 64}  c d\n")),
    "parquet": Reader(_tables, of_sample("points.parquet", "correspondences.parquet"), ".parquet"),
    "parquet-footer": Reader(read_column_chunks, of_sample("points.parquet"), ".parquet"),
    "queries": Reader(
        lambda path: read_table(path, "queries"), files(SAMPLE, "queries/val.parquet"), ".parquet"
    ),
    "submission": Reader(
        lambda path: check(path, tiny()), files(TINY, "submission.parquet"), ".parquet"
    ),
    "packed-index": Reader(_packed, files(SAMPLE, "index.parquet"), ".parquet"),
    "exr": Reader(read_surface, of_sample("depth/000000.exr"), ".exr"),
    "exr-depth": Reader(read_camera_depth, of_sample("depth/000000.exr"), ".exr"),
    "png": Reader(read_rgb, of_sample("rgb/000000.png"), ".png"),
    "png-mask": Reader(read_mask, of_sample("rgb/000000.png"), ".png"),
    "photo": Reader(read_photo, of_sample("rgb/000000.png"), ".jpg"),
    **FOREIGN,
    "http-service": Reader(to_service, service_requests),
    "http-viewer": Reader(to_viewer, viewer_requests),
}
