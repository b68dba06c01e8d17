"""Mutations of tables: footers, columns, keys and values."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from tests.conformance.edits import (
    BARE_TEST,
    CLOTH_TRAIN,
    ROPE_TRAIN,
    Edit,
    change_column,
    change_footer,
    change_rows,
    change_table,
    listed,
)

_TRACKS = f"{ROPE_TRAIN}/correspondences.parquet"
_POINTS = f"{ROPE_TRAIN}/points.parquet"
_CLOTH_POINTS = f"{CLOTH_TRAIN}/points.parquet"
_SEQUENCES = "sequences.parquet"

Rows = list[dict[str, Any]]


def _set(row: int, name: str, value: Any) -> Any:
    def change(rows: Rows) -> None:
        rows[row][name] = value

    return change


def _drop_row(rows: Rows) -> None:
    del rows[40]


def _drop_frame(rows: Rows) -> Rows:
    return [row for row in rows if row["frame"] == 0]


def _repeat_row(rows: Rows) -> None:
    rows.insert(40, dict(rows[40]))


def _swap_rows(rows: Rows) -> None:
    rows[3], rows[4] = rows[4], rows[3]


def _by_point(rows: Rows) -> Rows:
    return sorted(rows, key=lambda row: (row["point"], row["frame"]))


def _third_frame(rows: Rows) -> None:
    rows.append({**rows[-1], "frame": 2})


def _extra_point(rows: Rows) -> None:
    rows.append({**rows[-1], "point": 93})


def _renumber(rows: Rows) -> None:
    rows[0]["point"], rows[1]["point"] = 1, 0


def _shift_material(root: Path) -> None:
    """Move a point of one sequence along the rope: the tier's other sequences differ."""
    rows = change_rows(f"{BARE_TEST}/points.parquet", _move)
    listed(rows)(root)


def _move(rows: Rows) -> None:
    # A point on the far side of the tube, hidden in the only frame, and its partner with it.
    rows[0]["m0"] = float(np.float32(rows[0]["m0"] + 0.01))
    partner = rows[0]["partners"][0]
    rows[partner]["m0"] = float(np.float32(rows[partner]["m0"] - 0.01))


def _no_footer(table: pa.Table) -> pa.Table:
    return table.replace_schema_metadata({})


def _drop_column(table: pa.Table) -> pa.Table:
    return table.drop_columns(["v_px"])


def _add_column(table: pa.Table) -> pa.Table:
    return table.append_column("weight", pa.array(np.ones(table.num_rows, np.float32)))


def _nullable(table: pa.Table, name: str) -> pa.Table:
    index = table.column_names.index(name)
    values = table.column(name).to_pylist()
    values[5] = None
    field = table.schema.field(name).with_nullable(True)
    return table.set_column(index, field, pa.array(values, field.type))


def _null_partner(table: pa.Table) -> pa.Table:
    index = table.column_names.index("partners")
    values = table.column("partners").to_pylist()
    values[0] = [None, *values[0][1:]]
    array = pa.array(values, pa.list_(pa.int32()))
    return table.set_column(index, pa.field("partners", array.type), array)


def _as_text(column: pa.ChunkedArray) -> pa.Array:
    return pa.array([str(value) for value in column.to_pylist()])


EDITS: dict[str, Edit] = {
    "footer-missing": listed(change_table(_TRACKS, _no_footer)),
    "footer-no-json": listed(change_footer(_TRACKS, lambda _: b"{table: correspondences}")),
    "footer-is-list": listed(change_footer(_TRACKS, lambda footer: [footer])),
    "footer-other-table": listed(
        change_footer(_POINTS, lambda footer: footer.update(table="queries"))
    ),
    "footer-no-split": change_footer(
        "queries/test.parquet", lambda footer: footer.pop("split") and None
    ),
    "column-missing": listed(change_table(_TRACKS, _drop_column)),
    "column-float64": listed(
        change_column(_TRACKS, "u_px", lambda column: column.cast(pa.float64()))
    ),
    "column-int64": listed(change_column(_TRACKS, "point", lambda column: column.cast(pa.int64()))),
    "column-text-for-number": listed(change_column(_TRACKS, "depth_m", _as_text)),
    "column-list-of-floats": listed(
        change_column(_CLOTH_POINTS, "partners", lambda column: column.cast(pa.list_(pa.float32())))
    ),
    "column-extra": listed(change_table(_TRACKS, _add_column)),
    "null-value": listed(change_table(_TRACKS, lambda table: _nullable(table, "u_px"))),
    "null-state": listed(change_table(_TRACKS, lambda table: _nullable(table, "visibility"))),
    "null-in-list": listed(change_table(_CLOTH_POINTS, _null_partner)),
    "nan-value": listed(change_rows(_TRACKS, _set(7, "u_px", math.nan))),
    "infinite-value": listed(change_rows(_TRACKS, _set(7, "depth_m", math.inf))),
    "nan-position": listed(change_rows(_TRACKS, _set(9, "z_m", math.nan))),
    "nan-material": listed(change_rows(_POINTS, _set(7, "m0", math.nan))),
    "state-unknown": listed(change_rows(_TRACKS, _set(7, "visibility", "hidden"))),
    "state-capitals": listed(change_rows(_TRACKS, _set(7, "visibility", "Visible"))),
    "row-missing": listed(change_rows(_TRACKS, _drop_row)),
    "frame-missing": listed(change_rows(_TRACKS, _drop_frame)),
    "table-empty": listed(change_rows(_CLOTH_POINTS, lambda rows: rows.clear())),
    "row-twice": listed(change_rows(_TRACKS, _repeat_row)),
    "rows-swapped": listed(change_rows(_TRACKS, _swap_rows)),
    "rows-by-point": listed(change_rows(_TRACKS, _by_point)),
    "frame-unknown": listed(change_rows(_TRACKS, _third_frame)),
    "point-unknown": listed(change_rows(_TRACKS, _extra_point)),
    "point-negative": listed(change_rows(_TRACKS, _set(7, "point", -1))),
    "points-renumbered": listed(change_rows(_POINTS, _renumber)),
    "point-kind-unknown": listed(change_rows(_POINTS, _set(75, "kind", "axis"))),
    "point-object-unknown": listed(change_rows(_POINTS, _set(7, "object", 3))),
    "point-off-material": listed(change_rows(_POINTS, _set(7, "m0", 1.2))),
    "partners-too-few": listed(
        change_rows(_CLOTH_POINTS, lambda rows: rows[4]["partners"].pop() and None)
    ),
    "partner-unknown": listed(
        change_rows(_CLOTH_POINTS, lambda rows: rows[4]["partners"].__setitem__(0, 81))
    ),
    "partner-wrong": listed(change_rows(_CLOTH_POINTS, lambda rows: rows[1]["partners"].reverse())),
    "points-differ": _shift_material,
    "frames-zero": change_rows(_SEQUENCES, _set(0, "frames", 0)),
    "style-not-a-name": change_rows(_SEQUENCES, _set(0, "style", "a cartoon")),
    "coverage-negative": change_rows(_SEQUENCES, _set(0, "coverage", -0.5)),
    "summary-nan": change_rows(_SEQUENCES, _set(0, "self_occluded", math.nan)),
    "summary-wrong": change_rows(_SEQUENCES, _set(0, "self_occluded", 0.9)),
}
"""Every mutation of this kind."""
