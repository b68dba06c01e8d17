"""What a publication lists of its files: exactly these problems."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.listing import check_checksums
from tests.spec.validation.world import Found, context, found, make


def manifest(root: Path, **changes: Any) -> None:
    """Write SHA256SUMS over all files there, and the manifest."""
    names = sorted(p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file())
    lines = [f"{hashlib.sha256((root / n).read_bytes()).hexdigest()}  {n}\n" for n in names]
    (root / "SHA256SUMS").write_text("".join(lines))
    document: dict[str, Any] = {
        "spec_version": "1.0.0", "dataset": {"id": "d", "version": "1.0.0"}, "half": "public",
        "held_out": ["test", "val"], "other_sha256": None, "tools": {},
        "checksums_sha256": hashlib.sha256((root / "SHA256SUMS").read_bytes()).hexdigest(),
    }  # fmt: skip
    (root / "manifest.json").write_text(json.dumps(document | changes))


M, SUMS = "manifest.json", "SHA256SUMS"
OTHER_DATASET = [("IDENTITY_DIFFERS", M, "dataset, half")]


@pytest.mark.parametrize(
    ("changes", "after", "expected"),
    [
        ({}, None, []),
        ({"dataset": {"id": "e", "version": "1.0.0"}}, None, OTHER_DATASET),
        ({"dataset": {"id": "d", "version": "1.0.1"}}, None, OTHER_DATASET),
        ({"half": "private"}, None, OTHER_DATASET),
        ({"held_out": ["val", "test"]}, None, []),
        ({"held_out": ["test"]}, None, [("IDENTITY_DIFFERS", M, "held_out")]),
        ({"checksums_sha256": "0" * 64}, None, [("CHECKSUM_DIFFERS", SUMS, "")]),
        ({"half": None}, None, [("SCHEMA_INVALID", M, "half")]),
        ({}, lambda root: (root / M).unlink(), []),
        ({}, lambda root: (root / SUMS).unlink(), [("FILE_MISSING", SUMS, "")]),
        ({}, lambda root: (root / "a").write_text("other"), [("CHECKSUM_DIFFERS", "a", "")]),
        ({}, lambda root: (root / "a").unlink(), [("FILE_MISSING", "a", "")]),
        ({}, lambda root: (root / "z").touch(), [("FILE_UNLISTED", SUMS, "")]),
        ({}, lambda root: make(root, ".gitattributes", ".pliant/x", ".git/a/b"), []),
        ({}, lambda root: make(root, "y -> a", "folder/"), []),
        (
            {},
            lambda root: (root / SUMS).write_text("x"),
            [("FILE_UNREADABLE", SUMS, "line 1"), ("CHECKSUM_DIFFERS", SUMS, "")],
        ),
    ],
)
def test_what_a_publication_lists(
    changes: dict[str, Any], after: Callable[[Path], Any] | None, expected: Found, tmp_path: Path
) -> None:
    """Files a, b/c and d."""
    for name in ("a", "b/c", "d"):
        make(tmp_path, name)
        (tmp_path / name).write_text(name)
    manifest(tmp_path, **changes)
    if after is not None:
        after(tmp_path)
    assert _checked(tmp_path) == expected


def _checked(root: Path) -> Found:
    findings = Findings()
    check_checksums(context(root, held_out=frozenset({"val", "test"})), findings)
    return found(findings)


def test_each_file_of_a_publication_is_compared(tmp_path: Path) -> None:
    make(tmp_path, "a", "b", "c", "d")
    manifest(tmp_path)
    (tmp_path / "a").unlink()
    (tmp_path / "b").unlink()
    (tmp_path / "c").write_text("other")
    (tmp_path / "d").write_text("other")
    make(tmp_path, "e", "f")
    assert _checked(tmp_path) == [
        *[("FILE_UNLISTED", "SHA256SUMS", "")] * 2,
        ("FILE_MISSING", "a", ""), ("FILE_MISSING", "b", ""),
        ("CHECKSUM_DIFFERS", "c", ""), ("CHECKSUM_DIFFERS", "d", ""),
    ]  # fmt: skip
    shutil.copy(tmp_path / "SHA256SUMS", tmp_path / "copy")
    for name in ("SHA256SUMS", "manifest.json"):
        (tmp_path / name).unlink()
        (tmp_path / name).symlink_to("copy")
    assert _checked(tmp_path) == []  # links are reported elsewhere, and not followed
