"""Submissions that somebody might send: types, values and keys that are right or wrong.

Every case says which issue codes must be reported, all of them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from datetime import date
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

Build = Callable[[Any, Path], None]
CASES: dict[str, tuple[set[str], Build]] = {}


def case(name: str, *codes: str) -> Callable[[Build], Build]:
    """Register a case with the codes it must give."""

    def register(build: Build) -> Build:
        assert name not in CASES
        CASES[name] = (set(codes), build)
        return build

    return register


def table_case(name: str, change: Callable[[Any, pa.Table], pa.Table], *codes: str) -> None:
    case(name, *codes)(lambda scene, path: scene.submit(path, change(scene, scene.table())))


def replaced(column: str, values: Callable[[pa.Table], Any]) -> Callable[[Any, pa.Table], pa.Table]:
    """Return a change that puts other values into a column, or adds it."""

    def change(scene: Any, table: pa.Table) -> pa.Table:
        array = values(table)
        array = array if isinstance(array, pa.Array | pa.ChunkedArray) else pa.array(array)
        if column in table.column_names:
            return table.set_column(table.column_names.index(column), column, array)
        return table.append_column(column, array)

    return change


def edited(column: str, row: int, value: Any) -> Callable[[Any, pa.Table], pa.Table]:
    """Return a change of one value of a column."""
    return lambda scene, _: scene.edited(column, row, value)


def full(value: Any, kind: pa.DataType) -> Callable[[pa.Table], pa.Array]:
    return lambda table: pa.array([value] * table.num_rows, kind)


def dropped(column: str) -> Callable[[Any, pa.Table], pa.Table]:
    return lambda _, table: table.drop_columns([column])


def doubled(column: str) -> Callable[[Any, pa.Table], pa.Table]:
    return lambda _, table: pa.Table.from_arrays(
        [*table.columns, table[column]], names=[*table.column_names, column]
    )


def cast(column: str, kind: pa.DataType) -> Callable[[pa.Table], Any]:
    return lambda table: table[column].cast(kind)


def as_dictionary(column: str) -> Callable[[pa.Table], Any]:
    return lambda table: table[column].dictionary_encode()


def begun(column: str, value: int) -> Callable[[pa.Table], Any]:
    """Return a column whose first value is another one."""
    kind = pa.uint64() if value >= 2**63 else pa.int64()
    return lambda table: pa.array([value, *table[column].to_pylist()[1:]], kind)


# Types -------------------------------------------------------------------------------------

NOT_NUMBERS: dict[str, tuple[Any, pa.DataType]] = {
    "string": ("1", pa.string()),
    "binary": (b"1", pa.binary()),
    "decimal": (Decimal(1), pa.decimal128(10, 2)),
    "date": (date(2026, 1, 1), pa.date32()),
    "timestamp": (1, pa.timestamp("us")),
    "null": (None, pa.null()),
    "list": ([1], pa.list_(pa.int32())),
    "struct": ({"x": 1}, pa.struct([("x", pa.int32())])),
    "map": ([(1, 1)], pa.map_(pa.int32(), pa.int32())),
    "text dictionary": ("1", pa.dictionary(pa.int8(), pa.string())),
}
for _column in ("pair_id", "query_id", "u", "v", "visible", "sigma", "modes"):
    for _word, (_value, _kind) in NOT_NUMBERS.items():
        table_case(f"{_column} as {_word}", replaced(_column, full(_value, _kind)), "COLUMN_TYPE")
for _column in ("pair_id", "query_id"):
    table_case(f"{_column} as float", replaced(_column, full(0, pa.float64())), "COLUMN_TYPE")
    table_case(f"{_column} as bool", replaced(_column, full(True, pa.bool_())), "COLUMN_TYPE")
for _column in ("u", "v", "sigma"):
    table_case(f"{_column} as int", replaced(_column, full(1, pa.int32())), "COLUMN_TYPE")
    table_case(f"{_column} as bool", replaced(_column, full(True, pa.bool_())), "COLUMN_TYPE")
    half = np.float16(1)
    table_case(f"{_column} as float16", replaced(_column, full(half, pa.float16())), "COLUMN_TYPE")
for _column in ("pair_id", "query_id", "u", "v"):
    table_case(f"no {_column}", dropped(_column), "COLUMN_MISSING")
    table_case(f"{_column} twice", doubled(_column), "COLUMN_TYPE")
table_case("no column at all", lambda _, t: t.select([]), "COLUMN_MISSING")
table_case("other names", lambda _, t: t.rename_columns(["a", "b", "c", "d"]), "COLUMN_MISSING")

# What is accepted, and must score as the plain file does -----------------------------------

table_case("good", lambda _, t: t)
for _width in ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"):
    for _column in ("pair_id", "query_id"):
        table_case(
            f"{_column} as {_width}",
            replaced(_column, cast(_column, getattr(pa, _width)())),
        )
for _column in ("u", "v"):
    table_case(f"{_column} as float64", replaced(_column, cast(_column, pa.float64())))
for _column in ("pair_id", "query_id", "u", "v"):
    table_case(
        f"{_column} as dictionary",
        replaced(_column, as_dictionary(_column)),
    )
table_case("columns in another order", lambda _, t: t.select(["v", "query_id", "u", "pair_id"]))
table_case("rows in another order", lambda _, t: t.take(np.arange(t.num_rows)[::-1].copy()))
table_case("an extra text column", replaced("note", full("hello", pa.string())))
table_case("an extra nested column", replaced("extra", full([[{"x": [1]}]], None)))
table_case("an extra column of long texts", replaced("text", full("x" * 20_000, pa.string())))
table_case(
    "an extra column of large lists", replaced("list", full([1] * 500, pa.large_list(pa.int32())))
)
table_case("an empty extra name", replaced("", full(1, pa.int8())))
table_case("an extra name with a dot", replaced("u.v", full(1, pa.int8())))
table_case("an extra name that sounds like modes", replaced("modes.u", full(1.0, pa.float32())))
table_case("visible as bool", replaced("visible", full(True, pa.bool_())))


def rewrite(scene: Any, path: Path, **options: Any) -> None:
    """Write the good submission with other options of the format."""
    table = pq.read_table(scene.submit(path))
    footer = pq.read_metadata(path).metadata[b"pliant"]
    size = options.pop("row_group_size", None)
    table = table.replace_schema_metadata(None)
    with pq.ParquetWriter(path, table.schema, **options) as writer:
        writer.write_table(table, size)
        writer.add_key_value_metadata({b"pliant": footer})


WRITTEN: dict[str, dict[str, Any]] = {
    "row groups of 7": {"row_group_size": 7},
    "pages of 64 bytes": {"data_page_size": 64},
    "data pages of version 2": {"data_page_version": "2.0"},
    "format version 1": {"version": "1.0"},
    "no dictionaries": {"use_dictionary": False},
    "byte stream split": {"use_dictionary": False, "use_byte_stream_split": ["u", "v"]},
    "delta encoding": {
        "use_dictionary": False,
        "column_encoding": {"pair_id": "DELTA_BINARY_PACKED", "query_id": "DELTA_BINARY_PACKED"},
    },
    "page checksums": {"write_page_checksum": True},
    "no statistics": {"write_statistics": False},
    "no Arrow schema": {"store_schema": False},
}
for _codec in ("none", "snappy", "gzip", "brotli", "lz4", "zstd"):
    WRITTEN[f"compressed by {_codec}"] = {"compression": _codec}
for _name, _options in WRITTEN.items():
    case(_name)(functools.partial(rewrite, **_options))

# Values -----------------------------------------------------------------------------------

for _column in ("u", "v"):
    for _value in (np.nan, np.inf, -np.inf):
        table_case(f"{_column} {_value}", edited(_column, 5, _value), "VALUE_NOT_FINITE")
    for _value in (1e7, -1e7, 3e38):
        table_case(f"{_column} {_value:g}", edited(_column, 5, _value), "VALUE_OUT_OF_RANGE")
    table_case(
        f"{_column} all NaN", replaced(_column, full(np.nan, pa.float32())), "VALUE_NOT_FINITE"
    )
    table_case(f"{_column} outside the image", edited(_column, 5, -4000.0))
for _column in ("pair_id", "query_id", "u", "v"):
    # A null key is also a row of no query, and its query has none.
    _more = ("ROW_UNKNOWN", "ROW_MISSING") if _column.endswith("id") else ()
    table_case(f"{_column} null", edited(_column, 5, None), "VALUE_NULL", *_more)


def with_value(good: float, bad: Any) -> Callable[[pa.Table], pa.Array]:
    return lambda t: pa.array([bad, *[good] * (t.num_rows - 1)], pa.float32())


VALUE_CODES: tuple[list[str], ...] = (["VALUE_NOT_FINITE"], ["VALUE_OUT_OF_RANGE"], [])
# A column, a good value of it; values with these codes, the last of which are possible.
for _column, _good, _kinds in (
    ("visible", 0.5, ([np.nan, np.inf], [-0.01, 1.01], [0.0, 1.0])),
    ("sigma", 2.0, ([np.nan, np.inf], [-1.0, 0.0, -0.0, 1e7], [1e-30, 1e6])),
):
    table_case(f"{_column} None", replaced(_column, with_value(_good, None)), "VALUE_NULL")
    for _code, _values in zip(VALUE_CODES, _kinds, strict=True):
        for _value in _values:
            change = replaced(_column, with_value(_good, _value))
            table_case(f"{_column} {_value}", change, *_code)

MODE = {"u": 3.0, "v": 4.0, "sigma": 2.0, "weight": 1.0}
MODES_TYPE = pa.list_(pa.struct([(name, pa.float32()) for name in MODE]))


def modes(first: Any, kind: pa.DataType = MODES_TYPE) -> Callable[[Any, pa.Table], pa.Table]:
    return replaced("modes", lambda t: pa.array([first, *[[MODE]] * (t.num_rows - 1)], kind))


def halves(count: int) -> list[dict[str, float]]:
    return [MODE | {"weight": 1 / count}] * count


for _name, _first, _codes in (
    ("one mode", [MODE], set()),
    ("64 modes", halves(64), set()),
    ("65 modes", halves(65), {"MODES_INVALID"}),
    ("300 modes", halves(300), {"MODES_INVALID"}),
    ("no mode", [], {"MODES_INVALID"}),
    ("null modes", None, {"VALUE_NULL"}),
    ("a null mode", [None], {"VALUE_NULL"}),
    ("a null in a mode", [MODE | {"u": None}], {"VALUE_NULL"}),
    ("weights to 0.9", [MODE | {"weight": 0.9}], {"MODES_INVALID"}),
    ("weights to 1.2", [*halves(5), MODE | {"weight": 0.2}], {"MODES_INVALID"}),
    ("weights within the tolerance", [MODE | {"weight": 0.9995}], set()),
    ("a negative weight", [MODE | {"weight": -1.0}], {"VALUE_OUT_OF_RANGE"}),
    ("a NaN weight", [MODE | {"weight": np.nan}], {"VALUE_NOT_FINITE"}),
    ("a mode at infinity", [MODE | {"u": np.inf}], {"VALUE_NOT_FINITE"}),
    ("a mode far away", [MODE | {"v": 1e9}], {"VALUE_OUT_OF_RANGE"}),
    ("a mode of no width", [MODE | {"sigma": 0.0}], {"VALUE_OUT_OF_RANGE"}),
    ("a mode of negative width", [MODE | {"sigma": -2.0}], {"VALUE_OUT_OF_RANGE"}),
):
    table_case(_name, modes(_first), *_codes)
_item = MODES_TYPE.value_type
table_case("modes as large list", modes([MODE], pa.large_list(_item)))
table_case("modes as fixed-size list", modes([MODE], pa.list_(_item, 1)))
table_case("modes in double", modes([MODE], pa.list_(pa.struct([(n, pa.float64()) for n in MODE]))))
table_case(
    "modes with fields in another order",
    modes([MODE], pa.list_(pa.struct([(n, pa.float32()) for n in reversed(MODE)]))),
)
for _word, _kind in {
    "without weight": pa.list_(pa.struct([(n, pa.float32()) for n in ("u", "v", "sigma")])),
    "of integers": pa.list_(pa.struct([(n, pa.int32()) for n in MODE])),
    "of lists": pa.list_(pa.list_(pa.float32())),
    "with a nested field": pa.list_(
        pa.struct([*[(n, pa.float32()) for n in ("u", "v", "sigma")], ("weight", MODES_TYPE)])
    ),
}.items():
    table_case(
        f"modes {_word}", replaced("modes", full([], _kind)), "COLUMN_TYPE",
    )  # fmt: skip
case("sigma and modes", "MODES_INVALID")(
    lambda scene, path: scene.submit(
        path, modes([MODE])(scene, scene.table(sigma=np.ones(scene.rows, np.float32)))
    )
)

# Keys --------------------------------------------------------------------------------------


def rows(picker: Callable[[int], Any]) -> Callable[[Any, pa.Table], pa.Table]:
    return lambda _, t: t.take(pa.array(np.asarray(picker(t.num_rows), np.int64)))


table_case("0 rows", rows(lambda n: []), "ROW_MISSING")
table_case("1 row", rows(lambda n: [0]), "ROW_MISSING")
table_case("a row missing", rows(lambda n: range(1, n)), "ROW_MISSING")
table_case("half of the rows", rows(lambda n: range(0, n, 2)), "ROW_MISSING")
table_case("a row twice", rows(lambda n: [*range(n), 3]), "ROW_DUPLICATE")
table_case("every row twice", rows(lambda n: [*range(n), *range(n)]), "ROW_DUPLICATE")
table_case("one row n times", rows(lambda n: np.zeros(n)), "ROW_DUPLICATE", "ROW_MISSING")
table_case(
    "one missing, another twice", rows(lambda n: [*range(1, n), 4]), "ROW_DUPLICATE", "ROW_MISSING"
)
for _column in ("pair_id", "query_id"):
    for _value in (-1, -(2**31), 2**31 - 1, 1000):
        table_case(f"{_column} {_value}", edited(_column, 5, _value), "ROW_UNKNOWN", "ROW_MISSING")
    for _value in (2**62, 2**63 - 1, -(2**63), 2**64 - 1):
        change = replaced(_column, begun(_column, _value))
        table_case(f"{_column} {_value}", change, "ROW_UNKNOWN", "ROW_MISSING")


def _wrapping(scene: Any, table: pa.Table) -> pa.Table:
    """The first row of pair 3 plus this query id exceeds int64 and turns negative."""
    row = int(np.flatnonzero(scene.pair == 3)[0])
    query = [*table["query_id"].to_pylist()]
    query[row] = 2**63 - 1
    return table.set_column(1, "query_id", pa.array(query, pa.int64()))


table_case("pair 3, query 2**63 - 1", _wrapping, "ROW_UNKNOWN", "ROW_MISSING")
table_case(
    "pair and query swapped",
    lambda _, t: t.rename_columns(["query_id", "pair_id", "u", "v"]),
    "ROW_UNKNOWN",
    "ROW_MISSING",
)
table_case("an unknown row more", lambda _, t: pa.concat_tables([t, t.slice(0, 1).set_column(
    0, "pair_id", pa.array([999], pa.int32()))]), "ROW_UNKNOWN")  # fmt: skip


@case("a million rows too many", "ROW_UNKNOWN")
def _(scene: Any, path: Path) -> None:
    count = 1_100_000
    zeros = pa.array(np.zeros(count, np.int32))
    real = pa.array(np.zeros(count, np.float32))
    table = pa.table({"pair_id": zeros, "query_id": zeros, "u": real, "v": real})
    scene.submit(path, table)
