"""From problems to a report: counts, limits, order, causes; frames and points of all sequences."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.spec.camera import Camera
from pliant.spec.io.reading import FileRefusedError
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.result import SequenceResult, compare_frames, shape_key
from pliant.spec.validation.validate import Report, _crashed, validate
from tests.conformance.edits import ROPE_TEST, ROPE_TRAIN
from tests.conformance.steps import perform
from tests.spec.validation.world import Found, rows_at, words

Copy = Callable[[str], Path]


def some(code: str, path: str, count: int, most: int = 20) -> Findings:
    findings = Findings(listed_per_code=most)
    for number in range(count):
        findings.add(code, path, str(number), "x")
    return findings


def test_as_many_problems_of_a_code_are_listed_as_asked_for() -> None:
    findings = some("FILE_EXTRA", "a", 4, most=3)
    assert [issue.where for issue in findings.issues] == ["0", "1", "2"]
    bad = np.array([False, True, True, False, True, True])
    findings.at("b").add_rows("VALUE_NULL", bad[:4], lambda i: (f"row {i}", "x"))
    findings.at("b").add_rows("VALUE_NULL", bad, lambda i: (f"row {i}", "y"))
    findings.at("b").add_rows("VALUE_NULL", bad, lambda i: (f"row {i}", "z"))
    findings.at("b").add_rows("ROW_ORDER", ~bad & bad, lambda i: ("", ""))
    assert [issue.where for issue in findings.issues[3:]] == ["row 1", "row 2", "row 1"]
    assert findings.counts == {"FILE_EXTRA": 4, "VALUE_NULL": 10}
    assert findings.total == 14
    other = some("VALUE_NULL", "c", 1)
    for number in range(2):
        other.add("ROW_ORDER", "c", str(number), "x")
    findings.merge(other)
    assert [issue.where for issue in findings.issues[6:]] == ["0", "1"]
    assert findings.counts == {"FILE_EXTRA": 4, "VALUE_NULL": 11, "ROW_ORDER": 2}


def test_parts_are_merged_up_to_the_limit() -> None:
    findings = some("FILE_EXTRA", "a", 18)
    findings.merge(some("FILE_EXTRA", "b", 5))
    assert [issue.path for issue in findings.issues] == ["a"] * 18 + ["b"] * 2
    findings.merge(some("FILE_EXTRA", "c", 1))
    assert len(findings.issues) == 20
    assert findings.counts == {"FILE_EXTRA": 24}
    # Of a part that counted more than it lists, those that it lists are taken.
    findings = some("FILE_EXTRA", "a", 1, most=5)
    findings.merge(some("FILE_EXTRA", "b", 9, most=2))
    assert [issue.path for issue in findings.issues] == ["a", "b", "b"]
    assert findings.counts == {"FILE_EXTRA": 10}


def test_a_cause_stands_for_all_rows_of_a_file() -> None:
    findings = some("DEPTH_DISAGREES", "a", 1234)
    findings.add("ROW_ORDER", "a", "", "x")
    findings.at("a").diagnose("DEPTH_DISAGREES", "are too deep")
    findings.at("a").diagnose("OFFSET_DISAGREES", "all is shifted")
    assert words(findings) == [
        ("DEPTH_DISAGREES", "a", "", "all 1,234 rows are too deep"),
        ("OFFSET_DISAGREES", "a", "", "all is shifted"),
        ("ROW_ORDER", "a", "", "x"),
    ]
    assert findings.counts == {"DEPTH_DISAGREES": 1234, "ROW_ORDER": 1, "OFFSET_DISAGREES": 1}
    for path in "bc":
        other = some("DEPTH_DISAGREES", path, 10)
        other.at(path).diagnose("DEPTH_DISAGREES", "are too deep")
        findings.merge(other)
    assert words(findings)[0] == (
        "DEPTH_DISAGREES", "a", "and 2 more files", "all 1,254 rows are too deep",
    )  # fmt: skip
    assert findings.total == 1256


def test_the_refusal_of_a_file_is_one_sentence() -> None:
    findings = Findings()
    for error in (
        FileRefusedError("FILE_UNREADABLE", "is broken", where="line 3", found=0, required=""),
        FileRefusedError("FILE_TOO_LARGE", "is large", fix="Cut it."),
    ):
        with findings.at("a").refusals():
            raise error
    assert words(findings) == [
        ("FILE_UNREADABLE", "a", "line 3", "is broken; found 0; required: "),
        ("FILE_TOO_LARGE", "a", "", "is large. Cut it."),
    ]
    assert findings.at("b").counts == {"FILE_UNREADABLE": 1, "FILE_TOO_LARGE": 1}


def codes(report: Report) -> Found:
    assert len(report.issues) == report.total
    return [(issue.code, issue.path, issue.where) for issue in report.issues]


def spoil(root: Path) -> None:
    """Three codes: 2 extra files, 3 wrong seeds, 4 rows of points without order."""
    steps: list[dict[str, Any]] = [
        *[{"write": name} for name in ("y", "x")],
        {"rows": LISTING, "set": {f"{k}.seed": -1 for k in range(3)}},
        *[{"rows": table, "exchange": ["0"]} for table in ROPES],
        {"relist": "sequences"},
    ]
    perform(root, steps)


def test_a_report_keeps_some_problems_of_every_code(copy_of: Copy) -> None:
    root = copy_of("full")
    spoil(root)
    counts = {"FILE_EXTRA": 2, "IDENTITY_DIFFERS": 3, "ROW_ORDER": 4, "VALUE_OUT_OF_RANGE": 3}
    steps: list[tuple[int, int]] = []
    for limit, listed_ in ((12, (2, 3, 4, 3)), (9, (2, 2, 2, 3)), (3, (1, 1, 0, 1))):
        report = validate(
            root, quick=True, limit=limit, progress=lambda done, of: steps.append((done, of))
        )
        assert report.counts == counts
        assert list(report.counts) == sorted(counts)
        found = [issue.code for issue in report.issues]
        assert tuple(found.count(code) for code in counts) == listed_, limit
        places = [(issue.path, issue.where, issue.code) for issue in report.issues]
        assert places == sorted(places)
        assert (report.errors, report.total, report.valid) == (12, 12, False)
        assert (report.sequences, report.frames) == (5, 8)
    assert steps[:5] == [(k, 5) for k in range(1, 6)]
    assert [issue.path for issue in report.issues]== [
        "sequences.parquet", f"{ROPE_TEST}/sequence.json", "x",
    ]  # fmt: skip
    document = json.loads(json.dumps(report.as_dict()))
    issues = document.pop("issues")
    assert document == {
        "dataset": str(root), "spec_version": "1.0.0", "quick": True, "valid": False,
        "sequences": 5, "frames": 8, "total": 12, "listed": 3, "counts": counts,
    }  # fmt: skip
    assert [each["code"] for each in issues] == [issue.code for issue in report.issues]


INDEX, LISTING, CLOTH = "index.parquet", "sequences.parquet", "cloth-1-train-000000"
TWO = ("cameras.json", "correspondences.parquet")


PACKED: list[tuple[list[dict[str, Any]], Found]] = [
    ([{"write": INDEX, "text": "x"}], [("FILE_UNREADABLE", INDEX, "")]),
    ([{"table": INDEX, "by": ["with_null", "id", 0]}], [("VALUE_NULL", INDEX, "id")]),
    (
        [{"footer": INDEX, "set": {"dataset.id": "other"}}, {"remove": LISTING}],
        [("IDENTITY_DIFFERS", INDEX, "footer dataset"), ("FILE_MISSING", LISTING, "")],
    ),
    (
        [{"rows": INDEX, "repeat": {"0.files.0": {"path": "a/b/c"}}}],
        [("PATH_UNSAFE", INDEX, f"{CLOTH}, a/b/c")],
    ),
    (
        [{"rows": INDEX, "repeat": {"0.files.0": {"path": "notes"}}}],
        [("FILE_EXTRA", f"sequences/cloth-1/{CLOTH}/notes", "")],
    ),
    (
        [{"rows": INDEX, "set": {f"0.files.{k}.offset": 2**40 for k in range(2)}}],
        [("INDEX_INVALID", INDEX, f"{CLOTH}, {name}") for name in TWO],
    ),
    ([{"rows": INDEX, "double": ["0.files.0"]}], [("INDEX_INVALID", INDEX, CLOTH)]),
    # A sequence whose name is not safe is left packed.
    (
        [{"rows": LISTING, "set": {"0.tier": "../../up"}}],
        [("TIER_UNKNOWN", LISTING, "row 0, tier")],
    ),
    (
        [{"rows": each, "set": {"0.id": "../up"}} for each in (LISTING, INDEX)],
        [("PATH_UNSAFE", LISTING, "row 0")],
    ),
]
"""Steps after a dataset was packed -> the problems."""

ROPES = f"{ROPE_TRAIN}/points.parquet", f"{ROPE_TEST}/points.parquet"
QUERIES, TRUTH = "queries/test.parquet", "truth/test.parquet"


@pytest.mark.parametrize(
    ("base", "steps", "expected"),
    [
        (
            "minimal",
            [{"copy": "dataset.json", "to": "x"}, {"link": "dataset.json", "to": "x"}],
            [("PATH_UNSAFE", "dataset.json", ""), ("FILE_EXTRA", "x", "")],
        ),
        # Of the sequence after one without sound points the points are the first.
        (
            "full",
            [
                *[{"rows": ROPES[k], "set": {"80.m0": m0}} for k, m0 in enumerate((0.955, 7.0))],
                *[{"relist": "sequences"}, {"remove": "queries"}, {"remove": "truth"}],
            ],
            [("VALUE_OUT_OF_RANGE", ROPES[1], "row 80, m0, m1")],
        ),
        # The row of another tier is not compared with the sequence.json, whose seed is another.
        (
            "full",
            [{"rows": LISTING, "set": {"0.tier": "cloth-1", "0.seed": 99}}],
            [
                ("ROW_MISSING", LISTING, ""),
                ("FILE_MISSING", "sequences/cloth-1/rope-train-000000", ""),
            ],
        ),
        (
            "full",
            [{"copy": QUERIES, "to": "queries/val.parquet"}, {"remove": TRUTH}],
            [
                ("SPLIT_UNKNOWN", "queries/val.parquet", ""),
                ("IDENTITY_DIFFERS", "queries/val.parquet", "footer split"),
                *[("QUERY_INVALID", "queries/val.parquet", f"pair {k // 2}") for k in range(6)],
            ],
        ),
        (
            "full",
            [{"remove": QUERIES}, {"link": TRUTH, "to": "nowhere"}],
            [("FILE_MISSING", QUERIES, ""), ("PATH_UNSAFE", TRUTH, "")],
        ),
        *[("minimal", [{"call": "pack"}, *steps], expected) for steps, expected in PACKED],
    ],
)
def test_a_dataset_as_a_whole(
    base: str, steps: list[dict[str, Any]], expected: Found, copy_of: Copy
) -> None:
    root = copy_of(base)
    perform(root, steps)
    report = validate(root, quick=True)
    assert codes(report) == sorted(expected, key=lambda each: (each[1], each[2], each[0]))


def test_a_killed_process_is_a_problem_of_its_sequence() -> None:
    result = _crashed("rope", "a")
    assert (result.id, result.tier, result.split) == ("a", "rope", None)
    ((code, path, where, _),) = words(result.findings)
    assert (code, path, where) == ("FILE_UNREADABLE", "sequences/rope/a", "")


def result(name: str, split: str = "train", temporal: bool = False, **keys: Any) -> SequenceResult:
    found = SequenceResult(name, name[0], split, 9, temporal=temporal)
    for kind, values in keys.items():
        setattr(found.keys, kind, values)
    return found


def compared(*sequences: SequenceResult) -> list[tuple[str, str, str, str]]:
    findings = Findings()
    compare_frames(list(sequences), findings)
    return words(findings)


def test_frames_of_two_splits_and_frames_that_repeat() -> None:
    table = "sequences.parquet"
    assert compared(result("a", pictures={0: 5, 1: 6}), result("b", pictures={0: 7, 1: 0})) == []
    ((code, path, where, text),) = compared(
        result("a", pictures={0: 5, 1: 6, 3: 0, 4: 0}),
        result("b", "test", pictures={3: 0}, depths={2: 8}),
        result("c", "val"),
        result("d", depths={1: 8}),
    )
    assert (code, path, where) == ("SPLIT_SHARED", table, "test, train")
    assert text.startswith("1 pairs of frames have the same depth and surface pixels: b frame 2")
    ((_, _, first, text), (_, _, second, other)) = compared(
        result("a", pictures={0: 5, 1: 6}, depths={4: 8}),
        result("b", "test", pictures={2: 6, 5: 6}, depths={2: 8}),
        result("c", "val", pictures={3: 5}),
    )
    assert (first, second) == ("train, test", "train, val")
    assert text == (
        "2 pairs of frames have the same colour pixels; 1 pairs of frames have the same depth and "
        "surface pixels: a frame 1 and b frame 2"
    )
    assert other.endswith(": a frame 0 and c frame 3")
    ((code, path, where, text),) = compared(result("a", pictures={0: 5, 1: 5, 2: 5}))
    assert (code, path, where) == ("FRAME_REPEATED", table, "")
    assert text.startswith("2 pairs of frames of one split have the same colour pixels, such as a")
    assert compared(result("a", temporal=True, pictures={0: 5, 1: 5})) == []
    episodes = [result(name, temporal=True, pictures={0: 5}) for name in "ab"]
    assert [each[0] for each in compared(*episodes)] == ["FRAME_REPEATED"]


@pytest.mark.parametrize(("apart", "same"), [(0.9e-6, True), (1.1e-6, False), (-0.9e-6, True)])
@pytest.mark.parametrize("axis", range(6))
def test_shapes_agree_to_a_micrometre(apart: float, same: bool, axis: int) -> None:
    shape = np.array([0.0, 0.1, 1.0, 0.2, 0.2, 0.2])
    other = shape + apart * (np.arange(6) == axis)
    # Frames between the two in the order of the first number, which do not differ in it.
    between = {k: shape + 0.01 * k * (np.arange(6) == 1) for k in range(2, 9)}
    found = compared(result("a1", shapes={0: shape, **between}), result("a2", shapes={1: other}))
    expected = ["1 pairs of frames of one split have the same point positions before the camera"]
    assert [text.split(",")[0] for _, _, _, text in found] == (expected if same else [])
    assert compared(result("a", shapes={0: shape}), result("b", shapes={1: other})) == []
    assert compared(result("a", shapes={0: shape})) == []


def test_a_ring_that_turned_in_its_plane_has_another_shape() -> None:
    camera = Camera(np.eye(3), np.eye(4), (64, 48))
    turns = np.arange(24) / 24 * 2 * np.pi
    one, other = (
        shape_key(camera, rows_at(0, xyz, xyz))
        for angle in (0.0, 1.1)
        for xyz in [np.stack([np.cos(turns + angle), np.sin(turns + angle), 0 * turns + 2], 1)]
    )
    assert compared(result("a1", shapes={0: one}), result("a2", "test", shapes={0: other})) == []


def test_a_shape_is_that_before_the_camera() -> None:
    """A scene in other axes of the world is the same, and the same object seen elsewhere is not."""
    pose = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    xyz = np.random.default_rng(0).normal(0, 1, (1024, 3))
    moved = rows_at(0, xyz, xyz @ pose[:3, :3].T + pose[:3, 3])
    here, elsewhere = (Camera(np.eye(3), each, (64, 48)) for each in (np.eye(4), pose))
    same = shape_key(elsewhere, rows_at(0, xyz, xyz))
    np.testing.assert_allclose(shape_key(here, moved), same)
    assert not np.allclose(shape_key(elsewhere, moved), same)
