"""The small edits that mutations are made of."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR
import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.conventions import FOOTER_KEY
from pliant.spec.storage import layout
from tests.conformance.base import relist

Edit = Callable[[Path], None]

ROPE_TRAIN = "sequences/rope/rope-train-000000"
ROPE_TEST = "sequences/rope/rope-test-000000"
BARE_TEST = "sequences/rope-bare/rope-bare-test-000000"
CLOTH_TEST = "sequences/cloth-1/cloth-1-test-000000"
CLOTH_TRAIN = "sequences/cloth-1/cloth-1-train-000000"


def remove(path: str) -> Edit:
    """Remove a file or a folder with all it holds."""

    def edit(root: Path) -> None:
        target = root / path
        if target.is_dir():
            for inner in sorted(target.rglob("*"), reverse=True):
                inner.rmdir() if inner.is_dir() else inner.unlink()
            target.rmdir()
        else:
            target.unlink()

    return edit


def write(path: str, data: bytes) -> Edit:
    """Write a file of the given bytes."""

    def edit(root: Path) -> None:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_bytes(data)

    return edit


def link(path: str, target: str) -> Edit:
    """Replace a file by a symbolic link."""

    def edit(root: Path) -> None:
        (root / path).unlink(missing_ok=True)
        (root / path).symlink_to(target)

    return edit


def change_bytes(path: str, change: Callable[[bytes], bytes]) -> Edit:
    """Rewrite a file's bytes."""

    def edit(root: Path) -> None:
        (root / path).write_bytes(change((root / path).read_bytes()))

    return edit


def change_json(path: str, change: Callable[[Any], Any]) -> Edit:
    """Change a JSON document in place, or replace it by what `change` returns."""

    def edit(root: Path) -> None:
        document = json.loads((root / path).read_text())
        replaced = change(document)
        text = json.dumps(document if replaced is None else replaced, indent=1, sort_keys=True)
        (root / path).write_text(text + "\n")

    return edit


def change_table(path: str, change: Callable[[pa.Table], pa.Table]) -> Edit:
    """Replace a table by another, with the footer the new one carries."""

    def edit(root: Path) -> None:
        pq.write_table(change(pq.read_table(root / path)), root / path, compression="zstd")

    return edit


def change_rows(path: str, change: Callable[[list[dict[str, Any]]], Any]) -> Edit:
    """Change the rows of a table in place, or replace them; types and footer stay."""

    def rewrite(table: pa.Table) -> pa.Table:
        rows = table.to_pylist()
        replaced = change(rows)
        return pa.Table.from_pylist(rows if replaced is None else replaced, schema=table.schema)

    return change_table(path, rewrite)


def change_column(path: str, name: str, change: Callable[[pa.ChunkedArray], Any]) -> Edit:
    """Replace a column by another, of any type."""

    def rewrite(table: pa.Table) -> pa.Table:
        index = table.column_names.index(name)
        array = change(table.column(name))
        return table.set_column(index, pa.field(name, array.type), array)

    return change_table(path, rewrite)


def change_footer(path: str, change: Callable[[dict[str, Any]], Any]) -> Edit:
    """Change the `pliant` footer object; None as result keeps the change made in place."""

    def rewrite(table: pa.Table) -> pa.Table:
        footer = json.loads(table.schema.metadata[FOOTER_KEY])
        replaced = change(footer)
        content = footer if replaced is None else replaced
        text = content if isinstance(content, bytes) else json.dumps(content).encode()
        return table.replace_schema_metadata({FOOTER_KEY: text})

    return change_table(path, rewrite)


def change_exr(
    path: str,
    change: Callable[[dict[str, npt.NDArray[Any]]], Any],
    compression: str = "ZIP_COMPRESSION",
) -> Edit:
    """Change the channels of an EXR file in place, or replace them."""

    def edit(root: Path) -> None:
        with OpenEXR.File(str(root / path), True, False, 1) as image:
            channels = {name: part.pixels.copy() for name, part in image.channels().items()}
        replaced = change(channels)
        header = {
            "compression": getattr(OpenEXR, compression),
            "type": OpenEXR.scanlineimage,
        }
        with OpenEXR.File(header, channels if replaced is None else replaced, 1) as image:
            image.write(str(root / path))

    return edit


def listed(*edits: Edit) -> Edit:
    """Make edits, then bring the checksums of every sequence.json up to date."""

    def edit(root: Path) -> None:
        for one in edits:
            one(root)
        for path in sorted(root.rglob(layout.SEQUENCE_JSON)):
            relist(path.parent, json.loads(path.read_text()))

    return edit


def both(*edits: Edit) -> Edit:
    """Make several edits."""

    def edit(root: Path) -> None:
        for one in edits:
            one(root)

    return edit


def rebound(path: str, *edits: Edit) -> Edit:
    """Make edits to a queries file, then name its new sha256 in the truth's footer."""
    from pliant.spec.io.reading import sha256_file

    def edit(root: Path) -> None:
        for one in edits:
            one(root)
        truth = path.replace(layout.QUERIES_DIR, layout.TRUTH_DIR)
        digest = sha256_file(root / path)
        change_footer(truth, lambda footer: footer.update(queries_sha256=digest))(root)

    return edit


def to_float32(values: Any) -> pa.Array:
    """Return a float32 array."""
    return pa.array(np.asarray(values, np.float32))
