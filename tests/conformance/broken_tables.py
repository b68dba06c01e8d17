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
    Case,
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


CASES = [
    Case(
        "footer-missing",
        "full",
        "a correspondence table has no pliant footer",
        ("FOOTER_MISSING",),
        listed(change_table(_TRACKS, _no_footer)),
    ),
    Case(
        "footer-no-json",
        "full",
        "the pliant footer is no JSON",
        ("FOOTER_INVALID",),
        listed(change_footer(_TRACKS, lambda _: b"{table: correspondences}")),
    ),
    Case(
        "footer-is-list",
        "full",
        "the pliant footer is a list",
        ("FOOTER_INVALID",),
        listed(change_footer(_TRACKS, lambda footer: [footer])),
    ),
    Case(
        "footer-other-table",
        "full",
        "the footer of a point table says queries",
        ("FOOTER_INVALID",),
        listed(change_footer(_POINTS, lambda footer: footer.update(table="queries"))),
    ),
    Case(
        "footer-no-split",
        "full",
        "the footer of the queries lacks the split",
        ("FOOTER_INVALID", "QUERIES_MISMATCH"),
        change_footer("queries/test.parquet", lambda footer: footer.pop("split") and None),
    ),
    Case(
        "column-missing",
        "full",
        "a correspondence table lacks v_px",
        ("COLUMN_MISSING",),
        listed(change_table(_TRACKS, _drop_column)),
    ),
    Case(
        "column-float64",
        "full",
        "u_px is float64",
        ("COLUMN_TYPE",),
        listed(change_column(_TRACKS, "u_px", lambda column: column.cast(pa.float64()))),
    ),
    Case(
        "column-int64",
        "full",
        "point is int64",
        ("COLUMN_TYPE",),
        listed(change_column(_TRACKS, "point", lambda column: column.cast(pa.int64()))),
    ),
    Case(
        "column-text-for-number",
        "full",
        "depth_m is text",
        ("COLUMN_TYPE",),
        listed(change_column(_TRACKS, "depth_m", _as_text)),
    ),
    Case(
        "column-list-of-floats",
        "minimal",
        "partners are lists of float32",
        ("COLUMN_TYPE",),
        listed(
            change_column(
                _CLOTH_POINTS, "partners", lambda column: column.cast(pa.list_(pa.float32()))
            )
        ),
    ),
    Case(
        "column-extra",
        "full",
        "a correspondence table has a column weight",
        ("COLUMN_EXTRA",),
        listed(change_table(_TRACKS, _add_column)),
    ),
    Case(
        "null-value",
        "full",
        "one u_px is null",
        ("VALUE_NULL",),
        listed(change_table(_TRACKS, lambda table: _nullable(table, "u_px"))),
    ),
    Case(
        "null-state",
        "full",
        "one visibility is null",
        ("VALUE_NULL",),
        listed(change_table(_TRACKS, lambda table: _nullable(table, "visibility"))),
    ),
    Case(
        "null-in-list",
        "minimal",
        "one partner is null",
        ("VALUE_NULL",),
        listed(change_table(_CLOTH_POINTS, _null_partner)),
    ),
    Case(
        "nan-value",
        "full",
        "one u_px is NaN",
        ("VALUE_NOT_FINITE",),
        listed(change_rows(_TRACKS, _set(7, "u_px", math.nan))),
    ),
    Case(
        "infinite-value",
        "full",
        "one depth_m is infinite",
        ("VALUE_NOT_FINITE",),
        listed(change_rows(_TRACKS, _set(7, "depth_m", math.inf))),
    ),
    Case(
        "nan-position",
        "full",
        "one z_m is NaN",
        ("VALUE_NOT_FINITE",),
        listed(change_rows(_TRACKS, _set(9, "z_m", math.nan))),
    ),
    Case(
        "nan-material",
        "full",
        "the m0 of a point is NaN",
        ("VALUE_NOT_FINITE",),
        listed(change_rows(_POINTS, _set(7, "m0", math.nan))),
    ),
    Case(
        "state-unknown",
        "full",
        "one visibility is `hidden`",
        ("VALUE_OUT_OF_RANGE",),
        listed(change_rows(_TRACKS, _set(7, "visibility", "hidden"))),
    ),
    Case(
        "state-capitals",
        "full",
        "one visibility is `Visible`",
        ("VALUE_OUT_OF_RANGE",),
        listed(change_rows(_TRACKS, _set(7, "visibility", "Visible"))),
    ),
    Case(
        "row-missing",
        "full",
        "one row of a correspondence table is dropped",
        ("ROW_MISSING",),
        listed(change_rows(_TRACKS, _drop_row)),
    ),
    Case(
        "frame-missing",
        "full",
        "the second frame's rows are dropped",
        ("ROW_MISSING",),
        listed(change_rows(_TRACKS, _drop_frame)),
    ),
    Case(
        "table-empty",
        "minimal",
        "a point table has no rows",
        ("ROW_MISSING",),
        listed(change_rows(_CLOTH_POINTS, lambda rows: rows.clear())),
    ),
    Case(
        "row-twice",
        "full",
        "one row of a correspondence table is repeated",
        ("ROW_DUPLICATE",),
        listed(change_rows(_TRACKS, _repeat_row)),
    ),
    Case(
        "rows-swapped",
        "full",
        "two rows of a frame change places",
        ("ROW_ORDER",),
        listed(change_rows(_TRACKS, _swap_rows)),
    ),
    Case(
        "rows-by-point",
        "full",
        "the rows are ordered by point, then by frame",
        ("ROW_ORDER",),
        listed(change_rows(_TRACKS, _by_point)),
    ),
    Case(
        "frame-unknown",
        "full",
        "a row of a third frame is added",
        ("ROW_UNKNOWN",),
        listed(change_rows(_TRACKS, _third_frame)),
    ),
    Case(
        "point-unknown",
        "full",
        "a row of a point that does not exist is added",
        ("ROW_UNKNOWN",),
        listed(change_rows(_TRACKS, _extra_point)),
    ),
    Case(
        "point-negative",
        "full",
        "the point of one row is -1",
        ("ROW_MISSING", "ROW_UNKNOWN"),
        listed(change_rows(_TRACKS, _set(7, "point", -1))),
    ),
    Case(
        "points-renumbered",
        "full",
        "the first two points change numbers",
        ("ROW_ORDER",),
        listed(change_rows(_POINTS, _renumber)),
    ),
    Case(
        "point-kind-unknown",
        "full",
        "the kind of a point is `axis`",
        ("VALUE_OUT_OF_RANGE",),
        listed(change_rows(_POINTS, _set(75, "kind", "axis"))),
    ),
    Case(
        "point-object-unknown",
        "full",
        "the object of a point is 3",
        ("VALUE_OUT_OF_RANGE",),
        listed(change_rows(_POINTS, _set(7, "object", 3))),
    ),
    Case(
        "point-off-material",
        "full",
        "the m0 of a point is 1.2",
        ("VALUE_OUT_OF_RANGE",),
        listed(change_rows(_POINTS, _set(7, "m0", 1.2))),
    ),
    Case(
        "partners-too-few",
        "minimal",
        "a point has six partners for seven symmetries",
        ("VALUE_OUT_OF_RANGE",),
        listed(change_rows(_CLOTH_POINTS, lambda rows: rows[4]["partners"].pop() and None)),
    ),
    Case(
        "partner-unknown",
        "minimal",
        "a partner is no point",
        ("VALUE_OUT_OF_RANGE",),
        listed(change_rows(_CLOTH_POINTS, lambda rows: rows[4]["partners"].__setitem__(0, 81))),
    ),
    Case(
        "partner-wrong",
        "minimal",
        "two partners of a point change places",
        ("PARTNER_DISAGREES",),
        listed(change_rows(_CLOTH_POINTS, lambda rows: rows[1]["partners"].reverse())),
    ),
    Case(
        "points-differ",
        "full",
        "a point and its partner lie elsewhere than in the tier's other sequences",
        ("POINTS_DIFFER",),
        _shift_material,
    ),
    Case(
        "frames-zero",
        "full",
        "sequences.parquet says a sequence has 0 frames",
        ("VALUE_OUT_OF_RANGE", "IDENTITY_DIFFERS"),
        change_rows(_SEQUENCES, _set(0, "frames", 0)),
    ),
    Case(
        "style-not-a-name",
        "full",
        "the style of a row is `a cartoon`",
        ("VALUE_OUT_OF_RANGE", "IDENTITY_DIFFERS"),
        change_rows(_SEQUENCES, _set(0, "style", "a cartoon")),
    ),
    Case(
        "coverage-negative",
        "full",
        "the coverage of a row is negative",
        ("VALUE_OUT_OF_RANGE",),
        change_rows(_SEQUENCES, _set(0, "coverage", -0.5)),
    ),
    Case(
        "summary-nan",
        "full",
        "self_occluded of a row is NaN",
        ("VALUE_NOT_FINITE",),
        change_rows(_SEQUENCES, _set(0, "self_occluded", math.nan)),
    ),
    Case(
        "summary-wrong",
        "full",
        "self_occluded of a row is 0.9",
        ("SUMMARY_DISAGREES",),
        change_rows(_SEQUENCES, _set(0, "self_occluded", 0.9)),
    ),
]
"""Every mutation of this kind."""
