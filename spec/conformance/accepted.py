"""Changes that leave a dataset valid: what other writers do, and what a publisher leaves out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

from pliant.spec.conformance.edits import (
    ROPE_TRAIN,
    Case,
    both,
    change_exr,
    change_json,
    change_rows,
    change_table,
    listed,
    remove,
    write,
)

_TRACKS = f"{ROPE_TRAIN}/correspondences.parquet"
_EXR = f"{ROPE_TRAIN}/depth/000001.exr"


def _rewritten(**options: Any) -> Any:
    def edit(root: Path) -> None:
        pq.write_table(pq.read_table(root / _TRACKS), root / _TRACKS, **options)

    return edit


def _large_strings(table: pa.Table) -> pa.Table:
    index = table.column_names.index("visibility")
    column = table.column("visibility").cast(pa.large_string())
    return table.set_column(index, "visibility", column)


def _dictionaries(table: pa.Table) -> pa.Table:
    index = table.column_names.index("visibility")
    column = table.column("visibility").dictionary_encode()
    return table.set_column(index, "visibility", column)


def _optional(table: pa.Table) -> pa.Table:
    fields = [field.with_nullable(True) for field in table.schema]
    return table.cast(pa.schema(fields, metadata=table.schema.metadata))


def _reversed_columns(table: pa.Table) -> pa.Table:
    return table.select(table.column_names[::-1])


def _other_png(root: Path) -> None:
    """Write the images again with every filter and the highest compression."""
    for path in sorted(root.rglob("*.png")):
        with Image.open(path) as image:
            image.load()
            image.save(path, "PNG", optimize=True)


def held_out(root: Path) -> None:
    """Hold the test split out: take away all that tells its truth."""
    change_json("dataset.json", lambda document: document.update(held_out=["test"]))(root)
    remove("truth")(root)
    names = []
    for path in sorted(root.glob("sequences/*/*-test-*")):
        for name in ("points.parquet", "correspondences.parquet", "depth"):
            remove(f"{path.relative_to(root)}/{name}")(root)
        relative = f"{path.relative_to(root)}/sequence.json"
        change_json(relative, lambda document: document.update(seed=0, parameters={}))(root)
        names.append(path.name)

    def unseed(rows: list[dict[str, Any]]) -> None:
        for row in rows:
            row["seed"] = 0 if row["id"] in names else row["seed"]

    listed(change_rows("sequences.parquet", unseed))(root)


def _nothing(_: Any) -> None:
    return None


CASES = [
    Case("unchanged-full", "full", "nothing is changed", (), _nothing),
    Case("unchanged-minimal", "minimal", "nothing is changed", (), _nothing),
    Case("truth-left-out", "full", "the truth is left out", (), remove("truth")),
    Case(
        "held-out",
        "full",
        "the test split is held out: colour images and cameras alone",
        (),
        held_out,
    ),
    Case(
        "no-queries",
        "full",
        "queries and truth are left out",
        (),
        both(remove("truth"), remove("queries")),
    ),
    Case(
        "papers",
        "minimal",
        "README.md, LICENSE, CITATION.cff and croissant.json lie in the root",
        (),
        both(
            *[
                write(name, b"text\n")
                for name in ("README.md", "LICENSE", "CITATION.cff", "croissant.json")
            ]
        ),
    ),
    Case(
        "workshop",
        "minimal",
        "a generator's folder .pliant lies in the root",
        (),
        write(".pliant/logs/run.log", b"text\n"),
    ),
    Case(
        "other-png-writer",
        "full",
        "the PNG files come from another encoder",
        (),
        listed(_other_png),
    ),
    Case(
        "exr-piz",
        "full",
        "a depth image is compressed by PIZ",
        (),
        listed(change_exr(_EXR, _nothing, "PIZ_COMPRESSION")),
    ),
    Case(
        "exr-uncompressed",
        "full",
        "a depth image is not compressed",
        (),
        listed(change_exr(_EXR, _nothing, "NO_COMPRESSION")),
    ),
    Case(
        "parquet-snappy",
        "full",
        "a table has other compression, small row groups, no statistics",
        (),
        listed(_rewritten(compression="snappy", row_group_size=17, write_statistics=False)),
    ),
    Case(
        "parquet-v2-pages",
        "full",
        "a table has data pages of version 2 and no dictionaries",
        (),
        listed(_rewritten(data_page_version="2.0", use_dictionary=False)),
    ),
    Case(
        "text-64-bit-offsets",
        "full",
        "a text column has 64-bit offsets",
        (),
        listed(change_table(_TRACKS, _large_strings)),
    ),
    Case(
        "text-dictionary",
        "full",
        "a text column is a dictionary",
        (),
        listed(change_table(_TRACKS, _dictionaries)),
    ),
    Case(
        "columns-optional",
        "full",
        "every column is marked optional, and holds no null",
        (),
        listed(change_table(_TRACKS, _optional)),
    ),
    Case(
        "columns-reversed",
        "full",
        "the columns are in the reverse order",
        (),
        listed(change_table(_TRACKS, _reversed_columns)),
    ),
    Case(
        "minor-version",
        "minimal",
        "dataset.json is of version 1.1.0 with a field that 1.0 does not know",
        ("SPEC_VERSION_NEWER",),
        change_json(
            "dataset.json", lambda document: document.update(spec_version="1.1.0", funding="none")
        ),
    ),
]
"""Every change that leaves a dataset valid; the last gives a warning."""
