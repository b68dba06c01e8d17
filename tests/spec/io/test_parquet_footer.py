"""Our reading of a Parquet footer says what pyarrow says, and survives what ends pyarrow."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.spec.io.parquet import open_table
from pliant.spec.io.parquet_footer import read_column_chunks
from pliant.spec.io.reading import FileRefusedError


def sample(path: Path, **options: object) -> Path:
    rng = np.random.default_rng(0)
    table = pa.table(
        {
            "number": rng.integers(0, 9, 1000),
            "flag": rng.random(1000) < 0.5,
            "text": [f"row {i % 7}" for i in range(1000)],
            "list": [[{"x": float(i), "y": None}] * (i % 3) for i in range(1000)],
        }
    )
    pq.write_table(table, path, **options)
    return path


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"row_group_size": 64},
        {"compression": "none", "use_dictionary": False, "write_statistics": False},
        {"write_page_index": True, "store_decimal_as_integer": True},
        {"sorting_columns": [pq.SortingColumn(0)], "version": "1.0"},
    ],
)
def test_it_agrees_with_pyarrow(options: dict[str, object], tmp_path: Path) -> None:
    path = sample(tmp_path / "t.parquet", **options)
    metadata = pq.read_metadata(path)
    expected = [
        (i, chunk.path_in_schema, chunk.num_values, chunk.total_uncompressed_size)
        for i in range(metadata.num_row_groups)
        for group in [metadata.row_group(i)]
        for chunk in [group.column(j) for j in range(group.num_columns)]
    ]
    found = [
        (c.row_group, ".".join(c.path), c.values, c.uncompressed_bytes)
        for c in read_column_chunks(path)
    ]
    assert found == expected


def test_a_footer_that_ends_pyarrow_is_refused_or_read(tmp_path: Path) -> None:
    """Flip a bit in every second byte of the footer, in a child: none ends that process."""
    path = sample(tmp_path / "t.parquet")
    program = """
import sys
from pathlib import Path
from pliant.spec.io.parquet import open_table
from pliant.spec.io.reading import FileRefusedError
path, target = map(Path, sys.argv[1:])
good = path.read_bytes()
length = int.from_bytes(good[-8:-4], "little")
refused = 0
for place in range(len(good) - 8 - length, len(good), 2):
    data = bytearray(good)
    data[place] ^= 1 << place % 8
    target.write_bytes(data)
    try:
        open_table(target)
    except FileRefusedError:
        refused += 1
print(refused)
"""
    command = [sys.executable, "-c", program, str(path), str(tmp_path / "bad.parquet")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 20


@pytest.mark.parametrize(
    "data", [b"", b"PAR1", b"a,b\n1,2\n", b"PAR1" + b"\xff" * 40 + b"\x20\0\0\0PAR1"]
)
def test_what_is_no_footer_is_refused(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "t.parquet"
    path.write_bytes(data)
    with pytest.raises(FileRefusedError) as caught:
        read_column_chunks(path)
    assert caught.value.code == "FILE_UNREADABLE"
    with pytest.raises(FileRefusedError):
        open_table(path)
