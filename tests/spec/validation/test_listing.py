"""The list of sequences and what it says of them: exactly these problems."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.listing import check_listing
from tests.conformance.base import TIERS
from tests.dataset_files import listing_row, write_dataset
from tests.spec.validation.world import Found, context, found

FOLDERS = {"rope": {"a", "b"}}


def listed(root: Path, *rows: dict[str, Any], folders: dict[str, set[str]]) -> tuple[Any, Found]:
    """Write sequences.parquet and check it; return the ids that are used, and the problems."""
    tiers = [TIERS["rope"], TIERS["rope-bare"]]
    write_dataset(root, "d", rows, tiers, (64, 48))
    findings = Findings()
    used = check_listing(context(root, splits=("train",)), folders, findings)
    return used, found(findings)


def row(name: str, **changes: Any) -> dict[str, Any]:
    return listing_row(name, "rope", "train", 3) | changes


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"frames": 1, "seed": 0, "coverage": 0.0, "self_occluded": 0.0}, None),
        ({"frames": 100_000, "style": "my-style.2", "coverage": 7.5, "self_occluded": 1.0}, None),
        ({"tier": "cable"}, ("TIER_UNKNOWN", "tier")),
        ({"split": "val"}, ("SPLIT_UNKNOWN", "split")),
        ({"frames": 0}, ("VALUE_OUT_OF_RANGE", "frames")),
        ({"frames": 100_001}, ("VALUE_OUT_OF_RANGE", "frames")),
        ({"seed": -1}, ("VALUE_OUT_OF_RANGE", "seed")),
        ({"style": "my style"}, ("VALUE_OUT_OF_RANGE", "style")),
        ({"coverage": -0.01}, ("VALUE_OUT_OF_RANGE", "coverage")),
        ({"coverage": float("inf")}, ("VALUE_NOT_FINITE", "coverage")),
        ({"self_occluded": 1.01}, ("VALUE_OUT_OF_RANGE", "self_occluded")),
        ({"self_occluded": -0.01}, ("VALUE_OUT_OF_RANGE", "self_occluded")),
        ({"self_occluded": float("nan")}, ("VALUE_NOT_FINITE", "self_occluded")),
        # What follows a missing value is still checked.
        ({"coverage": None, "self_occluded": 1.01}, ("VALUE_OUT_OF_RANGE", "self_occluded")),
    ],
)
def test_a_row_of_the_list(
    change: dict[str, Any], expected: tuple[str, str] | None, tmp_path: Path
) -> None:
    folders = {"rope": {"a"}} if "tier" in change else FOLDERS
    used, problems = listed(tmp_path, row("a"), row("b", **change), folders=folders)
    assert set(used) == {"a", "b"}
    assert used["b"]["split"] == change.get("split", "train")
    table = "sequences.parquet"
    assert problems == ([] if expected is None else [(expected[0], table, f"row 1, {expected[1]}")])


def test_sequences_and_folders_are_the_same(tmp_path: Path) -> None:
    rows = (
        row("../up"), row("a"), row("a"), row("a", split="test"), row("b", tier="rope-bare"),
        row("c"), row("d"),
    )  # fmt: skip
    folders = {"rope": {"a", "b", "d"}, "other": {"e", "f"}}
    used, problems = listed(tmp_path, *rows, folders=folders)
    assert set(used) == {"a", "b", "c", "d"}
    table = "sequences.parquet"
    assert problems == [
        ("PATH_UNSAFE", table, "row 0"),
        ("ROW_DUPLICATE", table, "row 2"),
        ("SPLIT_SHARED", table, "row 3"),
        ("FILE_MISSING", "sequences/rope/c", ""),
        ("FILE_MISSING", "sequences/rope-bare/b", ""),
        *[("ROW_MISSING", table, "")] * 3,  # other/e, other/f, rope/b
    ]


def test_no_sequence_tells_a_seed_that_the_dataset_does_not(tmp_path: Path) -> None:
    rows = [row("a", seed=0), row("b", seed=3)]
    write_dataset(tmp_path, "d", rows, [TIERS["rope"]], (64, 48))
    findings = Findings()
    check_listing(context(tmp_path, splits=("train",), seeded=False), FOLDERS, findings)
    assert found(findings) == [("VALUE_OUT_OF_RANGE", "sequences.parquet", "row 1, seed")]


def test_each_declared_split_has_a_sequence(tmp_path: Path) -> None:
    write_dataset(tmp_path, "d", [row("a")], [TIERS["rope"]], (64, 48))
    findings, where = Findings(), ("sequences.parquet", "split")
    check_listing(context(tmp_path, splits=("val", "train", "test")), {"rope": {"a"}}, findings)
    assert found(findings) == [("ROW_MISSING", *where)] * 2


def test_a_list_that_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "sequences.parquet").write_bytes(b"x")
    findings = Findings()
    assert check_listing(context(tmp_path), FOLDERS, findings) == {}
    assert found(findings) == [("FILE_UNREADABLE", "sequences.parquet", "")]


def test_the_footer_names_this_dataset(tmp_path: Path) -> None:
    write_dataset(tmp_path, "d", [row("a")], [TIERS["rope"]], (64, 48))
    for name, version, wrong in (("d", "1.0.0", 0), ("e", "1.0.0", 1), ("d", "1.0.1", 1)):
        findings = Findings()
        identity = {"id": name, "version": version}
        facts = context(tmp_path, identity=identity, splits=("train",))
        check_listing(facts, {"rope": {"a"}}, findings)
        expected = [("IDENTITY_DIFFERS", "sequences.parquet", "footer dataset")] * wrong
        assert found(findings) == expected
