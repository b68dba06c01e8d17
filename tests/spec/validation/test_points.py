"""Tables of points, their footers and columns: each rule broken alone."""

from __future__ import annotations

import json
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.spec.model import Tier
from pliant.spec.tables import POINTS
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.points import PointSet, check_points
from pliant.spec.validation.rules.tables import CheckedTable, check_table
from tests.spec.validation.world import DOCUMENT, places

Rows = list[dict[str, Any]]
Found = list[tuple[str, str]]

TIER = Tier.from_document(DOCUMENT)

# Points 0 to 3 are an orbit of the surface, 4 and 5 are on the centre line, 6 is on the box.
_WHERE = [(0.5, 0.3), (0.5, -1.7), (1.5, -0.3), (1.5, 1.7), (0.25, 1.0), (1.75, 0.5), (1.5, 0.5)]
_PARTNERS = [[1, 2, 3], [0, 3, 2], [3, 0, 1], [2, 1, 0], [4, 5, 5], [5, 4, 4], [6, 6, 6]]
ROWS: Rows = [
    {
        "point": k, "object": 2 if k == 6 else 1, "m0": m0, "m1": m1, "partners": partners,
        "kind": "centreline" if k in (4, 5) else "surface",
    }
    for k, ((m0, m1), partners) in enumerate(zip(_WHERE, _PARTNERS, strict=True))
]  # fmt: skip
FOOTER = {"spec_version": "1.0.0", "table": "points"}


def write(path: Path, rows: Rows, footer: Any = FOOTER, **options: Any) -> Path:
    table = pa.Table.from_pylist(rows, schema=POINTS)
    text = footer if isinstance(footer, str) else json.dumps(footer)
    pq.write_table(
        table.replace_schema_metadata({"pliant": text}), path / "points.parquet", **options
    )
    return path / "points.parquet"


def checked(path: Path, rows: Rows, **options: Any) -> tuple[PointSet | None, Found]:
    """Write a table of points and check it."""
    findings = Findings()
    points = check_points(write(path, rows, **options), TIER, findings.at("x"))
    return points, places(findings)


def opened(path: Path, max_rows: int = 7) -> tuple[CheckedTable | None, Found]:
    findings = Findings()
    table = check_table(path, "points", findings.at("x"), max_rows=max_rows)
    return table, places(findings)


def changed(*changes: tuple[int, dict[str, Any]]) -> Rows:
    rows = deepcopy(ROWS)
    for index, change in changes:
        rows[index].update(change)
    return rows


RANGE = "VALUE_OUT_OF_RANGE"


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (ROWS, []),
        (changed((6, {"m0": 3.0 + 1.9e-5})), []),  # 1e-5 of a range of 2
        (changed((6, {"m0": 3.0 + 2.1e-5})), [(RANGE, "row 6, m0, m1")]),
        (changed((6, {"m0": 1.0 - 2.1e-5})), [(RANGE, "row 6, m0, m1")]),
        (changed((6, {"m1": -1.1e-5})), [(RANGE, "row 6, m0, m1")]),
        (changed((6, {"m1": np.nan})), [("VALUE_NOT_FINITE", "row 6, m1")]),
        (changed((6, {"m0": np.inf, "object": 3})),
         [(RANGE, "row 6, object"), ("VALUE_NOT_FINITE", "row 6, m0")]),
        (changed((6, {"kind": "axis"})), [(RANGE, "row 6, kind")]),
        (changed((6, {"kind": "centreline"})), [(RANGE, "row 6, kind")]),
        (changed((0, {"point": 1})), [("ROW_ORDER", "row 0, point")]),
        (changed((0, {"partners": [1, 2]})), [(RANGE, "row 0, partners")]),
        (changed((6, {"partners": [6, 6, 6, 6]})), [(RANGE, "row 6, partners")]),
        (changed((6, {"partners": [6, 6, 7]})), [(RANGE, "row 6, partners")]),
        (changed((0, {"partners": [-1, 2, 3]})), [(RANGE, "row 0, partners")]),
        ([], [("ROW_MISSING", "")]),
    ],
)  # fmt: skip
def test_a_row(rows: Rows, expected: Found, tmp_path: Path) -> None:
    points, found = checked(tmp_path, rows)
    assert found == expected
    assert (points is None) is bool(expected)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        # The tube's range is 2 along s and 4 around: a partner may be off by 2e-5 and 4e-5.
        (changed((1, {"m0": 0.5 + 1.9e-5})), []),
        (changed((1, {"m0": 0.5 + 2.1e-5})), [(0, 0), (1, 0), (1, 1), (1, 2), (2, 2), (3, 1)]),
        (changed((1, {"m1": -1.7 + 3.8e-5})), []),
        # The tube's coordinate has a period of 4, so 1.7 and -2.3 are equal; the box's has none.
        (changed((3, {"m1": -2.0}), (0, {"m1": 0.0}), (1, {"m1": -2.0}), (2, {"m1": 0.0})), []),
        # On the centre line only s counts.
        (changed((4, {"m1": -0.9})), []),
        (changed((4, {"m0": 0.26})), [(4, 1), (4, 2), (5, 1), (5, 2)]),
        (changed((0, {"partners": [0, 2, 3]})), [(0, 0)]),
        (changed((0, {"partners": [1, 2, 6]})), [(0, 2)]),
        (changed((6, {"partners": [6, 0, 6]})), [(6, 1)]),
        (changed((4, {"m0": 1.0}), (5, {"m0": 1.0}), (4, {"partners": [5, 5, 5]})), []),
    ],
)
def test_partners(rows: Rows, expected: list[tuple[int, int]], tmp_path: Path) -> None:
    points, found = checked(tmp_path, rows)
    assert points is not None
    where = {("PARTNER_DISAGREES", f"row {row}, partners[{n}]") for row, n in expected}
    assert set(found) == where


def test_a_partner_is_of_the_same_object_and_kind(tmp_path: Path) -> None:
    """A point in the middle of the tube is its own image, on the surface and on the line."""
    middle = {"m0": 1.0, "m1": 0.0}
    line = {"kind": "centreline"}
    base = changed((0, middle | {"partners": [1, 0, 1]}), (1, {"m0": 1.0, "m1": 2.0} | {
        "partners": [0, 1, 0]}), (2, middle | line | {"partners": [2, 2, 2]}), (3, middle | line | {
        "partners": [3, 2, 2]}))  # fmt: skip
    for change, expected in (
        ((3, {}), []),
        ((0, {"partners": [1, 2, 1]}), ["row 0, partners[1]"]),
        ((3, {"partners": [3, 0, 2]}), ["row 3, partners[1]"]),
        ((6, {"partners": [6, 6, 0]}), ["row 6, partners[2]"]),
    ):
        rows = deepcopy(base)
        rows[change[0]].update(change[1])
        assert [where for _, where in checked(tmp_path, rows)[1]] == expected


def test_what_identifies_a_table_of_points(tmp_path: Path) -> None:
    def read(rows: Rows, **options: Any) -> PointSet:
        points, _ = checked(tmp_path, rows, **options)
        assert points is not None
        return points

    first = read(ROWS)
    assert len(first) == 7
    assert first.object_id.tolist() == [1] * 6 + [2]
    assert first.centreline.tolist() == [False] * 4 + [True] * 2 + [False]
    np.testing.assert_allclose(first.material, _WHERE, rtol=1e-6)
    assert first.partners.tolist() == _PARTNERS
    same = [ROWS, [*ROWS[:6], ROWS[6] | {"partners": (6, 6, 6)}]]
    assert {read(rows).digest for rows in same} == {first.digest}
    others = [
        changed((row, {name: value}))
        for row, name, value in (
            (6, "m0", 1.25), (6, "m1", 0.25), (3, "kind", "centreline"), (6, "object", 1)
        )
    ]  # fmt: skip
    others.append(changed((0, {"partners": [1, 2, 1]})))
    digests = {read(rows).digest for rows in others} | {first.digest}
    assert len(digests) == 6


@pytest.mark.parametrize(
    ("footer", "expected"),
    [
        (FOOTER, []),
        (FOOTER | {"spec_version": "1.7.3", "later": 1}, None),
        (FOOTER | {"spec_version": "2.0.0"}, [("SPEC_VERSION_UNSUPPORTED", "spec_version")]),
        (FOOTER | {"spec_version": 1}, [("FOOTER_INVALID", "footer spec_version")]),
        (FOOTER | {"table": "truth"}, [("FOOTER_INVALID", "footer table")]),
        ("[]", [("FOOTER_INVALID", "")]),
        ({"table": "truth"}, [("FOOTER_INVALID", "footer"), ("FOOTER_INVALID", "footer table")]),
    ],
)
def test_a_footer(footer: Any, expected: Found | None, tmp_path: Path) -> None:
    """A column more is an error, unless the footer says that a later version wrote it."""
    path = write(tmp_path, ROWS, footer)
    table, found = opened(path)
    assert table is not None
    assert found == (expected or [])
    assert dict(table.footer) == (footer if not expected else {})
    assert table.whole
    assert table.rows == 7
    more = pq.read_table(path).append_column("b", pa.array([0] * 7)).append_column(
        "a", pa.array([0] * 7))  # fmt: skip
    pq.write_table(more, path)
    extra = [("COLUMN_EXTRA", "a"), ("COLUMN_EXTRA", "b")]
    assert opened(path)[1] == ([] if expected is None else expected + extra)


def test_columns(tmp_path: Path) -> None:
    path = write(tmp_path, ROWS)
    rows = pq.read_table(path).drop_columns(["m1"])
    wide = rows.column("object").cast(pa.int64())
    pq.write_table(rows.set_column(1, "object", wide), path)
    table, found = opened(path)
    assert table is not None
    assert not table.whole
    assert found == [("COLUMN_TYPE", "object"), ("COLUMN_MISSING", "m1")]
    assert check_points(path, TIER, Findings().at("x")) is None
    assert opened(path, 6) == (None, [("FILE_TOO_LARGE", "")])


def test_batches_carry_the_number_of_their_first_row(tmp_path: Path) -> None:
    path = write(tmp_path, ROWS, row_group_size=3)
    table, _ = opened(path)
    assert table is not None
    parts = [(start, batch.to_pydict()) for start, batch in table.batches(["m0"])]
    assert [start for start, _ in parts] == [0, 3, 6]
    assert [value for _, part in parts for value in part["m0"]] == [m0 for m0, _ in _WHERE]
