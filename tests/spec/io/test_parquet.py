"""Tables: what is written, what is read whoever wrote it, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.spec.io import limits
from pliant.spec.io.parquet import open_table, read_footer, read_table, write_table
from pliant.spec.io.reading import FileRefusedError
from pliant.spec.tables import POINTS, TABLES


def points(count: int = 4) -> pa.Table:
    return pa.table(
        {
            "point": np.arange(count),
            "object": np.ones(count, np.int64),
            "kind": ["surface"] * count,
            "m0": np.linspace(0, 1, count),
            "m1": np.zeros(count),
            "partners": [[i] for i in range(count)],
        }
    )


def test_round_trip_in_declared_types(tmp_path: Path) -> None:
    path = tmp_path / "points.parquet"
    write_table(path, points(), "points", {"sequence": "rope-train-000000"})
    found = read_table(path, "points")
    assert found.schema.equals(POINTS)
    assert found.column("partners").to_pylist() == [[0], [1], [2], [3]]
    footer = read_footer(path)
    assert footer == {"spec_version": "1.0.0", "table": "points", "sequence": "rope-train-000000"}
    assert read_table(path, "points", ["m1", "point"]).column_names == ["m1", "point"]
    write_table(tmp_path / "again", points(), "points", {"sequence": "rope-train-000000"})
    assert (tmp_path / "again").read_bytes() == path.read_bytes()
    # Units and meaning travel with the file.
    assert pq.read_schema(path).field("m0").metadata[b"doc"]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (points().drop_columns(["m0"]), "m0"),
        (points().drop_columns(["partners"]), "partners"),
        (points().set_column(3, "m0", pa.array([0.0, None, 1.0, 1.0])), "null"),
        (points().append_column("weight", pa.array([1] * 4)), "no column weight"),
    ],
)
def test_writer_refuses_other_columns_and_nulls(
    tmp_path: Path, table: pa.Table, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        write_table(tmp_path / "a", table, "points")


def test_a_submission_keeps_its_extra_columns(tmp_path: Path) -> None:
    rows = {name: np.zeros(2) for name in TABLES["answers"].names}
    table = pa.table(rows).append_column("note", pa.array(["x", "y"]))
    write_table(tmp_path / "a", table, "answers")
    assert pq.read_table(tmp_path / "a").column("note").to_pylist() == ["x", "y"]


def refusal(path: Path, name: str = "points", **options: Any) -> FileRefusedError:
    with pytest.raises(FileRefusedError) as caught:
        read_table(path, name, **options)
    return caught.value


def test_column_type_is_refused_by_name(tmp_path: Path) -> None:
    wide = [field.with_type(pa.float64()) if field.name == "m0" else field for field in POINTS]
    table = points().cast(pa.schema(wide))
    pq.write_table(table, tmp_path / "a")
    error = refusal(tmp_path / "a")
    assert (error.code, error.where) == ("COLUMN_TYPE", "m0")
    assert "double" in str(error)
    assert "float" in str(error)


PARTNERS = [[0], [1], [2], [3, None]]
WORDS = pa.array(["surface", None, "surface", "surface"]).dictionary_encode()


@pytest.mark.parametrize(
    ("place", "name", "column", "group_rows"),
    [
        (5, "partners", pa.array(PARTNERS, pa.list_(pa.int32())), 4),
        (5, "partners", pa.array(PARTNERS, pa.large_list(pa.int32())), 1),
        (2, "kind", WORDS, 4),
    ],
    ids=["list", "list of another row group", "dictionary"],
)
def test_nulls_inside_lists_and_dictionaries_count(
    tmp_path: Path, place: int, name: str, column: pa.Array, group_rows: int
) -> None:
    table = points().cast(POINTS).set_column(place, name, column)
    pq.write_table(table, tmp_path / "a", row_group_size=group_rows)
    assert refusal(tmp_path / "a").code == "VALUE_NULL"


def test_row_limit_is_checked_by_the_metadata(tmp_path: Path) -> None:
    write_table(tmp_path / "a", points(50), "points")
    assert open_table(tmp_path / "a", max_rows=50).metadata.num_rows == 50
    with pytest.raises(FileRefusedError) as caught:
        open_table(tmp_path / "a", max_rows=49)
    assert caught.value.code == "FILE_TOO_LARGE"


def test_long_text_repeated_in_every_row_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = 2000
    ones = pa.array(np.zeros(count, np.int32))
    kinds = pa.DictionaryArray.from_arrays(ones, pa.array(["x" * 10**6]))
    table = points(count).cast(POINTS).set_column(2, "kind", kinds)
    # Without Arrow's own schema the file says plain text: 2 GB of it, in a file of some kB.
    pq.write_table(table, tmp_path / "a", compression="zstd", store_schema=False)
    assert (tmp_path / "a").stat().st_size < 100_000
    monkeypatch.setattr(limits, "MAX_TEXT_BYTES", 10**9)
    assert refusal(tmp_path / "a").code == "FILE_TOO_LARGE"


def delta_text(path: Path, column: str, texts: list[str]) -> None:
    """Write a truth whose texts share long prefixes, which DELTA_BYTE_ARRAY stores once."""
    modes = [[{"u": 0.0, "v": 0.0, "visibility": text}] for text in texts]
    numbers = np.zeros(len(texts))
    columns: dict[str, Any] = {name: numbers for name in TABLES["truth"].names}
    columns |= {"tier": texts, "visibility_b": texts, "alternatives": modes}
    table = pa.table(columns).cast(TABLES["truth"])
    pq.write_table(
        table,
        path,
        use_dictionary=False,
        compression="none",
        column_encoding={column: "DELTA_BYTE_ARRAY"},
    )


def test_text_that_a_delta_encoding_expands_is_decoded_in_bounded_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = ["x" * 1000 + str(i) for i in range(300)]
    delta_text(tmp_path / "a", "tier", texts)
    assert read_table(tmp_path / "a", "truth", ["tier"]).column("tier").to_pylist() == texts
    monkeypatch.setattr(limits, "MAX_TEXT_BYTES", 100_000)
    rows: list[int] = []
    decoded = pq.ParquetFile.iter_batches

    def watched(self: pq.ParquetFile, batch_size: int, **options: Any) -> Any:
        rows.append(batch_size)
        return decoded(self, batch_size, **options)

    monkeypatch.setattr(pq.ParquetFile, "iter_batches", watched)
    error = refusal(tmp_path / "a", "truth", columns=["tier"])
    assert (error.code, error.where) == ("FILE_TOO_LARGE", "tier")
    assert max(rows) * 1003 <= 100_000


def test_text_in_a_list_that_a_delta_encoding_may_expand_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leaf = "alternatives.list.element.visibility"
    delta_text(tmp_path / "a", leaf, ["visible"] * 300)
    assert read_table(tmp_path / "a", "truth", ["alternatives"]).num_rows == 300
    monkeypatch.setattr(limits, "MAX_TEXT_BYTES", 10_000)
    error = refusal(tmp_path / "a", "truth", columns=["alternatives"])
    assert (error.code, error.where) == ("FILE_TOO_LARGE", leaf)
