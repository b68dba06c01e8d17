"""Queries and their truth: each rule broken alone, and the problems that are reported, exactly.

`full` has three pairs of five queries each: rows 0 to 4, 5 to 9 and 10 to 14.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.spec.model import Tier
from pliant.spec.tables import TRUTH
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.answers import has_few_alternatives
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.queries import check_split_queries
from pliant.spec.validation.rules.result import SequenceResult
from tests.conformance.edits import change_footer, change_rows, rebind, rewrite
from tests.spec.conftest import DATASETS
from tests.spec.validation.world import Found, found

QUERIES, TRUTHS = "queries/test.parquet", "truth/test.parquet"
ROPE, BARE, SHEET = "rope-test-000000", "rope-bare-test-00000{}", "cloth-1-test-000000"
Rows = list[dict[str, Any]]
Edit = Callable[[Path], Any]


@pytest.fixture
def root(tmp_path: Path) -> Path:
    ignored = shutil.ignore_patterns("*.png", "*.exr", "*-train-*")
    return Path(shutil.copytree(DATASETS / "full", tmp_path / "full", ignore=ignored))


def known(**changes: Any) -> dict[str, SequenceResult]:
    """Return what the rules of sequences say about them; the boxes are those of the truth."""
    boxes: dict[str, list[float]] = {
        ROPE: [np.nan, 45],
        BARE.format(0): [np.nan],
        BARE.format(1): [63],
        SHEET: [0, 48],
    }
    return {
        name: SequenceResult(
            name, name.split("-test-")[0], "test", len(box), boxes_px=np.array(box, np.float32),
            **{"tables_sound": True} | changes,
        )
        for name, box in boxes.items()
    }  # fmt: skip


def checked(
    root: Path,
    *edits: Edit,
    sequences: dict[str, SequenceResult] | None = None,
    split: str = "test",
    **facts: Any,
) -> Found:
    for edit in edits:
        edit(root)
    info = json.loads((root / "dataset.json").read_text()) | facts
    context = Context.of(root, info, map(Tier.from_document, info["tiers"]), False)
    given = known() if sequences is None else sequences
    return found(check_split_queries(context, split, given))


def asked(change: Callable[[Rows], Any]) -> Edit:
    """Change the queries; the truth still belongs to them."""

    def edit(root: Path) -> None:
        change_rows(QUERIES, change)(root)
        if (root / TRUTHS).exists():
            rebind(QUERIES)(root)

    return edit


def answered(change: Callable[[Rows], Any]) -> Edit:
    return change_rows(TRUTHS, change)


def both(change: Callable[[Rows], Any]) -> Edit:
    return lambda root: (answered(change)(root), asked(change)(root))


def at(rows: range | int, **values: Any) -> Callable[[Rows], None]:
    """Change some rows; a function takes the value before."""

    def change(table: Rows) -> None:
        for index in rows if isinstance(rows, range) else [rows]:
            for name, value in values.items():
                before = table[index][name]
                table[index][name] = value(before) if callable(value) else value

    return change


def queries(code: str, *where: str) -> Found:
    return [(code, QUERIES, each) for each in where]


def truth(code: str, *where: str) -> Found:
    return [(code, TRUTHS, each) for each in where]


CASES: list[tuple[Edit, Found]] = [
    (asked(at(0)), []),
    # Keys: pairs from 0, queries of a pair from 0.
    (both(at(range(5), pair_id=7)), [*queries("ROW_ORDER", "row 0", "row 5")]),
    (both(at(range(5), query_id=lambda q: q + 1)), queries("ROW_ORDER", "row 0")),
    (both(at(4, query_id=0)), queries("ROW_ORDER", "row 0")),
    (both(at(range(10, 15), pair_id=3)), queries("ROW_ORDER", "row 10")),
    # Frames of a pair.
    (asked(at(range(5), sequence_a="nowhere")), queries("QUERY_INVALID", "pair 0")),
    (asked(at(range(5), sequence_b=SHEET, frame_b=0)), queries("QUERY_INVALID", "pair 0")),
    (asked(at(range(5), tier="cloth-1")), queries("QUERY_INVALID", "pair 0", "pair 0")),
    (asked(at(range(5), frame_a=-1)), queries("QUERY_INVALID", "pair 0")),
    (asked(at(range(5), frame_a=2, frame_b=-1)), queries("QUERY_INVALID", "pair 0", "pair 0")),
    (asked(at(range(5), frame_b=2)), queries("QUERY_INVALID", "pair 0")),  # after the last
    (asked(at(range(5), frame_b=0)), queries("QUERY_INVALID", "pair 0")),
    *[
        (asked(at(row, **{name: value})), queries("QUERY_INVALID", "pair 1"))
        for row in (5, 9)
        for name, value in (
            ("tier", "x"), ("frame_a", 1), ("frame_b", 1), ("sequence_a", "x"), ("sequence_b", "x"),
        )
    ],
    # Sources.
    (asked(at(1, u_a=np.nan)), queries("VALUE_NOT_FINITE", "pair 0, query 1")),
    (asked(at(14, v_a=np.inf)), queries("VALUE_NOT_FINITE", "pair 2, query 4")),
    (asked(at(1, u_a=lambda u: u + 1e-5)), queries("QUERY_NOT_VISIBLE", "pair 0, query 1")),
    (asked(at(5, v_a=lambda v: v - 1e-5)), queries("QUERY_NOT_VISIBLE", "pair 1, query 0")),
    # Truth: keys, tier, box, point, position, state, partners.
    (answered(at(3, query_id=4)), truth("ROW_ORDER", "pair 0, query 3")),
    (answered(at(3, pair_id=1, u_b=0.0)), truth("ROW_ORDER", "pair 0, query 3")),
    (answered(at(9, tier="rope")), truth("TRUTH_DISAGREES", "pair 1, query 4")),
    (answered(at(0, box_px=44.0)), truth("TRUTH_DISAGREES", "pair 0, query 0")),
    (answered(at(14, box_px=49.0)), truth("TRUTH_DISAGREES", "pair 2, query 4")),
    (answered(at(0, box_px=np.nan)), truth("VALUE_NOT_FINITE", "pair 0, query 0, box_px")),
    (answered(at(0, box_px=np.inf)), truth("VALUE_NOT_FINITE", "pair 0, query 0, box_px")),
    (answered(at(0, box_px=-45.0)), truth("VALUE_OUT_OF_RANGE", "pair 0, query 0, box_px")),
    (answered(at(0, point=lambda p: p + 1)), truth("TRUTH_DISAGREES", "pair 0, query 0")),
    (answered(at(0, point=-1)), truth("TRUTH_DISAGREES", "pair 0, query 0")),
    (answered(at(0, point=93)), truth("TRUTH_DISAGREES", "pair 0, query 0")),
    (answered(at(0, point=10**9)), truth("TRUTH_DISAGREES", "pair 0, query 0")),
    (answered(at(7, u_b=lambda u: u + 1e-5)), truth("TRUTH_DISAGREES", "pair 1, query 2")),
    (answered(at(7, v_b=lambda v: v + 1e-5)), truth("TRUTH_DISAGREES", "pair 1, query 2")),
    (answered(at(7, visibility_b="occluded")), truth("TRUTH_DISAGREES", "pair 1, query 2")),
    (answered(at(7, alternatives=[])), truth("TRUTH_DISAGREES", "pair 1, query 2")),
    (answered(at(8, alternatives=lambda a: a * 2)), truth("TRUTH_DISAGREES", "pair 1, query 3")),
    # One answer too few or too many: the others are not compared.
    (answered(lambda rows: rows[1:]), truth("ROW_MISSING", "")),
    (answered(lambda rows: [*rows[:1], *rows]), truth("ROW_UNKNOWN", "")),
    # Footers.
    (change_footer(TRUTHS, lambda f: f.update(queries_sha256="0" * 64)),
     truth("QUERIES_MISMATCH", "footer queries_sha256")),
    (change_footer(TRUTHS, lambda f: f.update(split="val")),
     truth("IDENTITY_DIFFERS", "footer split")),
    (change_footer(TRUTHS, lambda f: f["dataset"].update(id="x")),
     truth("IDENTITY_DIFFERS", "footer dataset")),
    (lambda root: (change_footer(QUERIES, lambda f: f.update(split="val"))(root),
                   rebind(QUERIES)(root)), queries("IDENTITY_DIFFERS", "footer split")),
    (lambda root: (change_footer(QUERIES, lambda f: f["dataset"].update(version="2.0.0"))(root),
                   rebind(QUERIES)(root)), queries("IDENTITY_DIFFERS", "footer dataset")),
    # Files.
    (lambda root: (root / TRUTHS).unlink(), []),
    (lambda root: (root / QUERIES).unlink(), queries("FILE_MISSING", "")),
    (lambda root: (root / QUERIES).write_bytes(b"x"), queries("FILE_UNREADABLE", "")),
    (lambda root: (root / TRUTHS).write_bytes(b"x"), truth("FILE_UNREADABLE", "")),
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(CASES)))
def test_a_rule_that_is_broken_alone(number: int, root: Path) -> None:
    edit, expected = CASES[number]
    assert checked(root, edit) == expected


@pytest.mark.parametrize("groups", [(1, 1), (3, 2), (4, 7), (15, 4)])
def test_tables_may_be_divided_anywhere(groups: tuple[int, int], root: Path) -> None:
    """Rows of a pair in several row groups, and answers in others than their queries."""

    def divide(root: Path) -> None:
        for path, size in zip((QUERIES, TRUTHS), groups, strict=True):
            rewrite(path, row_group_size=size)(root)
        rebind(QUERIES)(root)
        rewrite(TRUTHS, row_group_size=groups[1])(root)

    assert checked(root, divide) == []
    wrong = answered(at(13, box_px=1.0))
    assert checked(root, wrong, divide) == truth("TRUTH_DISAGREES", "pair 2, query 3")
    (root / TRUTHS).unlink()
    wrong = asked(at(4, query_id=0, frame_a=1, frame_b=0))
    assert checked(root, wrong, rewrite(QUERIES, row_group_size=groups[0])) == [
        *queries("ROW_ORDER", "row 0"),
        *queries("QUERY_INVALID", "pair 0"),
    ]


def test_links_are_not_followed(root: Path) -> None:
    for path in (QUERIES, TRUTHS):
        shutil.move(root / path, root / "elsewhere.parquet")
        (root / path).symlink_to(root / "elsewhere.parquet")
        assert checked(root) == []
        shutil.copy(DATASETS / "full" / path, root / "copy.parquet")
        (root / path).unlink()
        shutil.move(root / "copy.parquet", root / path)


def test_splits(root: Path) -> None:
    assert checked(root, splits=["train"]) == queries("SPLIT_UNKNOWN", "")
    assert checked(root, held_out=["test"]) == truth("HELD_OUT_LEAKS", "")
    assert checked(root, held_out=["train"]) == []
    other = {name: replace(each, split="train") for name, each in known().items()}
    assert checked(root, sequences=other) == queries(
        "QUERY_INVALID", *[f"pair {k}" for k in (0, 0, 1, 1, 2, 2)]
    )


def test_sources_of_tables_that_are_not_known_are_in_the_image(root: Path) -> None:
    """Width 64, height 48: what is on the right or lower border is outside."""
    (root / TRUTHS).unlink()
    outside = [(64.0, 3.0), (3.0, 48.0), (-0.01, 3.0), (3.0, -0.01)]
    inside = [(0.0, 0.0), (63.99, 47.99), (np.nan, 3.0)]

    def change(rows: Rows) -> None:
        for row, (u, v) in zip(rows, outside + inside, strict=False):
            row.update(u_a=u, v_a=v)

    assert checked(root, asked(change), sequences=known(tables_sound=False)) == [
        *queries("VALUE_OUT_OF_RANGE", *[f"pair 0, query {k}" for k in range(4)]),
        *queries("VALUE_NOT_FINITE", "pair 1, query 1"),
    ]


def test_boxes_that_are_not_known_are_not_compared(root: Path) -> None:
    sequences = known(tables_sound=False)
    for each in sequences.values():
        each.boxes_px[:] = np.nan
    nonsense = answered(at(range(15), box_px=1.0, u_b=0.0, point=3))
    assert checked(root, nonsense, sequences=sequences) == []
    sequences[ROPE].boxes_px[:] = [np.nan, 45]
    expected = truth("TRUTH_DISAGREES", *[f"pair 0, query {k}" for k in range(5)])
    assert checked(root, sequences=sequences) == expected


@pytest.mark.parametrize("box", [0.0, np.nan])
def test_a_target_that_does_not_show_the_object_has_no_box(box: float, root: Path) -> None:
    """Neither where the image shows none, nor where it was not looked at."""
    sequences = known()
    sequences[SHEET].boxes_px[1] = box
    wrong = answered(at(range(10, 15), box_px=0.0))
    places = [f"pair 2, query {k}, box_px" for k in range(5)]
    assert checked(root, wrong, sequences=sequences) == truth("VALUE_OUT_OF_RANGE", *places)


@pytest.mark.parametrize("change", ["none", "state", "kind", "object", "place"])
def test_the_truth_says_which_of_two_points_at_a_place_is_meant(change: str, root: Path) -> None:
    """Of two visible points of the rope at one place either may be answered, another one not."""
    table = f"sequences/rope/{ROPE}/correspondences.parquet"
    rows = pq.read_table(root / table).to_pylist()
    (first,) = (row["point"] for row in pq.read_table(root / TRUTHS).to_pylist()[:1])
    here = rows[first]
    others = [first - 1, first + 1]

    def together(rows: Rows) -> None:
        for other in others:
            rows[other].update({name: here[name] for name in ("u_px", "v_px", "visibility")})
            if change == "state":
                rows[other]["visibility"] = "occluded"
            if change == "place":
                rows[other]["u_px"] += 1e-5

    def marked(points: Rows) -> None:
        for other in others:
            points[other].update({"kind": {"kind": "centreline"}, "object": {"object": 2}}.get(
                change, {}))  # fmt: skip

    change_rows(table, together)(root)
    change_rows(f"sequences/rope/{ROPE}/points.parquet", marked)(root)
    for point in (first, *others):
        target = rows[93 + point]
        values = {"u_b": target["u_px"], "v_b": target["v_px"]}
        values |= {"point": point, "visibility_b": target["visibility"]}
        wrong = change != "none" and point != first
        expected = truth("TRUTH_DISAGREES", "pair 0, query 0") if wrong else []
        assert checked(root, answered(at(0, **values))) == expected


@pytest.mark.parametrize(("count", "few"), [(64, True), (65, False)])
def test_no_answer_has_more_alternatives_than_a_tier_symmetries(count: int, few: bool) -> None:
    place = {"u": 0.0, "v": 0.0, "visibility": "visible"}
    row: dict[str, Any] = dict.fromkeys(("pair_id", "query_id", "point", "u_b", "v_b", "box_px"), 0)
    row |= dict.fromkeys(("tier", "visibility_b"), "")
    rows = [row | {"alternatives": [place] * number} for number in (2 * count, 0)]
    table = pa.Table.from_pylist(rows, schema=TRUTH)
    findings = Findings()
    assert has_few_alternatives(table, findings.at(TRUTHS)) is few
    assert found(findings) == ([] if few else truth("VALUE_OUT_OF_RANGE", "alternatives"))
