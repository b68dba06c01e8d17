"""What is in which folder, what sequence.json and the lists say of it: exactly these problems."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest

from pliant.spec.io import limits
from pliant.spec.io.reading import Blob
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules import files as files_module
from pliant.spec.validation.rules.files import (
    SequenceFiles,
    check_files,
    is_safe,
    list_sequence,
    read_document,
)
from pliant.spec.validation.rules.structure import check_root, list_folder
from tests.spec.validation.world import Found, found, make

LOOSE = ("dataset.json", "sequences.parquet", "sequences/t/a/", "sequences/t/b/", "sequences/u/c/")
PACKED = (
    *("dataset.json", "sequences.parquet", "index.parquet", "frames/train-00000.parquet"),
    *("folders/val-00001.parquet", "correspondences/test-00000.parquet"),
)


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        (LOOSE, []),
        (PACKED, []),
        (LOOSE[:1] + LOOSE[2:], [("FILE_MISSING", "sequences.parquet")]),
        (LOOSE[1:], [("FILE_MISSING", "dataset.json")]),
        (LOOSE[:2], [("FILE_MISSING", "sequences")]),
        ((*LOOSE[1:], "dataset.json -> x"), [("PATH_UNSAFE", "dataset.json")]),
        ((*LOOSE[:2], "sequences -> x"), [("PATH_UNSAFE", "sequences")]),
        ((*LOOSE, "x -> dataset.json", "y"), [("PATH_UNSAFE", "x"), ("FILE_EXTRA", "y")]),
        ((*LOOSE, "README.md/"), [("FILE_EXTRA", "README.md")]),
        ((*LOOSE, "pairs"), [("FILE_EXTRA", "pairs")]),
        ((*LOOSE, "frames/x"), [("FILE_EXTRA", "frames")]),
        ((*PACKED, "sequences/t/a/"), [("FILE_EXTRA", "sequences")]),
        (
            (*PACKED, "frames/x", "folders/train-0.parquet", "correspondences/test-00001.parquet/"),
            [
                ("FILE_EXTRA", "frames/x"),
                ("FILE_EXTRA", "folders/train-0.parquet"),
                ("FILE_EXTRA", "correspondences/test-00001.parquet"),
            ],
        ),
        (
            (*LOOSE, "queries/val.parquet", "queries/dev.parquet", "queries/val", "queries/a/"),
            [("FILE_EXTRA", f"queries/{name}") for name in ("a", "dev.parquet", "val")],
        ),
        (
            (*PACKED, "truth/train.parquet", "truth/test.csv", "truth/train.parquet.parquet"),
            [("FILE_EXTRA", f"truth/{name}") for name in ("test.csv", "train.parquet.parquet")],
        ),
        ((*LOOSE, "sequences/x"), [("FILE_EXTRA", "sequences/x")]),
        ((*LOOSE, "sequences/u/x"), [("FILE_EXTRA", "sequences/u/x")]),
        ((*LOOSE, "sequences/u/x -> c"), [("PATH_UNSAFE", "sequences/u/x")]),
        (
            (
                *(*LOOSE, "README.md", "LICENSE", "CITATION.cff", "croissant.json", "eval.yaml"),
                *(".gitattributes", ".zenodo.json", ".pliant/x", ".cache/y", ".git/z", ".private/"),
                *("SHA256SUMS", "manifest.json", "webdataset/x", "pictures/y", "pairs/z"),
            ),
            [],
        ),
    ],
)
def test_the_root(
    entries: tuple[str, ...], expected: list[tuple[str, str]], tmp_path: Path
) -> None:
    findings = Findings()
    tiers = check_root(make(tmp_path, *entries), findings)
    assert found(findings) == [(*each, "") for each in expected]
    loose = "sequences/t/a/" in entries and "index.parquet" not in entries
    assert tiers == ({"t": {"a", "b"}, "u": {"c"}} if loose else {})


def test_what_a_folder_lists(tmp_path: Path) -> None:
    make(tmp_path, "a", "b/c", "d -> a", os.fsdecode(b"\xff -> a"))
    os.mkfifo(tmp_path / "e")
    findings = Findings()
    assert list_folder(tmp_path, "in", findings) == ({"a"}, {"b"})
    assert {(i.path, i.message.split("found ")[1]) for i in findings.issues} == {
        ("in/d", "a link"), ("in/e", "a special file"), ("in/\\udcff", "a link"),
    }  # fmt: skip
    for shown, path in (("in", "in"), ("", ".")):
        findings = Findings()
        assert list_folder(tmp_path / "x", shown, findings) == (set(), set())
        assert found(findings) == [("FILE_UNREADABLE", path, "")]


def test_a_sequence_folder(tmp_path: Path) -> None:
    make(tmp_path, "a", "rgb/0", "rgb/x/", "depth/1", "masks/2", "camera_depth/3", "other/4")
    findings = Findings()
    files = list_sequence(tmp_path, "s", findings)
    assert files.present == {"a", "rgb/0", "depth/1", "masks/2", "camera_depth/3"}
    assert found(findings) == [("FILE_EXTRA", "s/other", ""), ("FILE_EXTRA", "s/rgb/x", "")]


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        *[("a", True), ("a/b", True), ("a..b", True), (".a", True), ("/a", False), ("..", False)],
        *[("a/../b", False), ("a/./b", False), ("./a", False), ("a//b", False), ("a/", False)],
        *[("a\\b", False), ("a\0b", False), ("", False), (".", False)],
    ],
)
def test_a_path_stays_in_its_folder(name: str, safe: bool) -> None:
    assert is_safe(name) is safe


TABLES = ("points.parquet", "correspondences.parquet", "cameras.json")
PICTURES = ("rgb/000000.png", "rgb/000001.png")
DEPTHS = ("depth/000000.exr", "depth/000001.exr")
WHOLE = (*TABLES, *PICTURES, *DEPTHS)
MASKS = ("masks/000000.png", "masks/000001.png")
CAMERA_DEPTHS = ("camera_depth/000000.exr", "camera_depth/000001.exr")


def missing(*names: str) -> Found:
    return [("FILE_MISSING", f"s/{name}", "") for name in names]


UNLISTED = ("FILE_UNLISTED", "s/sequence.json", "files")


@pytest.mark.parametrize(
    ("present", "listed", "held_out", "expected"),
    [
        (WHOLE, WHOLE, False, []),
        (WHOLE[1:], WHOLE, False, missing("points.parquet")),
        (WHOLE[1:], WHOLE[1:], False, missing("points.parquet")),
        (WHOLE, WHOLE[:-2], False, [UNLISTED] * 2),
        (
            WHOLE,
            (*WHOLE, WHOLE[0], "a/../b", "c"),
            False,
            [
                ("FILE_UNLISTED", "s/sequence.json", "files[7]"),
                ("PATH_UNSAFE", "s/sequence.json", "files[8]"),
                *missing("c"),
            ],
        ),
        ((*WHOLE, "x"), (*WHOLE, "x"), False, [("FILE_EXTRA", "s/x", "")]),
        (
            WHOLE, (*WHOLE, "sequence.json"), False,
            [("FILE_UNLISTED", "s/sequence.json", "files[7]")],
        ),
        (
            (*WHOLE, *MASKS), (*WHOLE, *MASKS), False, [("FILE_EXTRA", f"s/{m}", "") for m in MASKS]
        ),
        (PICTURES, PICTURES, True, []),
        ((*PICTURES, "cameras.json"), (*PICTURES, "cameras.json"), True, []),
        ((*PICTURES, "cameras.json"), PICTURES, True, [UNLISTED]),
        ((*PICTURES, *MASKS, *CAMERA_DEPTHS), (*PICTURES, *MASKS, *CAMERA_DEPTHS), True, []),
        (PICTURES[1:], PICTURES, True, missing(PICTURES[0])),
        (
            WHOLE, WHOLE, True,
            [("HELD_OUT_LEAKS", f"s/{name}", "") for name in sorted({*WHOLE[:2], *DEPTHS})],
        ),
        ((*PICTURES, *MASKS), PICTURES, True, [UNLISTED] * 2),
        ((*PICTURES, MASKS[1]), (*PICTURES, MASKS[1]), True, missing(MASKS[0])),
        (
            (*PICTURES, *MASKS, CAMERA_DEPTHS[0]), (*PICTURES, *MASKS), True,
            [*missing(CAMERA_DEPTHS[1]), UNLISTED],
        ),
        (
            (*PICTURES, "masks/000002.png"), (*PICTURES, "masks/000002.png"), True,
            [("FILE_EXTRA", "s/masks/000002.png", "")],
        ),
    ],
)  # fmt: skip
def test_files_listed_and_present(
    present: tuple[str, ...], listed: tuple[str, ...], held_out: bool, expected: Found
) -> None:
    findings = Findings()
    files = SequenceFiles(Path(), "s", findings, {"sequence.json", *present})
    entries = [{"path": name, "sha256": name, "bytes": len(name)} for name in listed]
    check_files(files, {"frames": 2, "files": entries, "split": "test"}, held_out=held_out)
    assert found(findings) == expected
    assert files.hashes == {
        name: (name, len(name)) for name in listed if name in {*present, *WHOLE} and is_safe(name)
    }


def test_a_link_is_not_called_missing_as_well() -> None:
    findings = Findings()
    findings.add("PATH_UNSAFE", "s/points.parquet", "", "a link")
    files = SequenceFiles(Path(), "s", findings, {*WHOLE[1:]})
    entries = [{"path": name, "sha256": "", "bytes": 0} for name in WHOLE]
    check_files(files, {"frames": 2, "files": entries, "split": "test"}, held_out=False)
    assert found(findings) == [("PATH_UNSAFE", "s/points.parquet", "")]


def test_only_files_with_their_checksum_are_looked_into(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, digest = b"1234567", hashlib.sha256(b"1234567").hexdigest()
    names = ("a.png", "a.parquet", "b.png")
    for name in names:
        (tmp_path / name).write_bytes(data)
    findings = Findings()
    files = SequenceFiles(tmp_path, "s", findings, {*names, "gone.png"})
    assert files.contents("b.png") == tmp_path / "b.png"  # not listed, reported elsewhere
    assert files.contents("nowhere") is None
    files.hashes = {name: (digest, 7) for name in (*names, "gone.png")}
    assert files.contents("a.png") == Blob(str(tmp_path / "a.png"), data)
    assert files.sound == {"a.png"}
    monkeypatch.setattr(limits, "MAX_TABLE_BYTES", 7)
    monkeypatch.setattr(limits, "MAX_IMAGE_FILE_BYTES", 6)
    assert files.contents("a.parquet") == tmp_path / "a.parquet"
    assert files.contents("b.png") is None
    assert files.contents("gone.png") is None
    assert files.sound == {"a.png", "a.parquet"}
    files.hashes["a.parquet"] = (hashlib.sha256(b"").hexdigest(), 7)
    assert files.contents("a.parquet") is None
    files.hashes["a.parquet"] = (digest, 8)
    assert files.contents("a.parquet") is None
    assert [issue.message[:40] for issue in findings.issues[-2:]] == [
        "found sha256 8bb0cf6eb9b17d0f7d22b456f12",
        "found 7 bytes; sequence.json lists 8",
    ]

    def fails(path: Path, limit: int) -> int:
        raise OSError("broken disk")

    monkeypatch.setattr(files_module, "check_regular", fails)
    assert files.contents("a.parquet") is None
    assert found(findings) == [
        ("FILE_TOO_LARGE", "s/b.png", ""),
        ("FILE_MISSING", "s/gone.png", ""),
        *[("CHECKSUM_DIFFERS", "s/a.parquet", "")] * 2,
        ("FILE_UNREADABLE", "s/a.parquet", ""),
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{", [("FILE_UNREADABLE", "x", "")]),
        ('{"spec_version": "2.0.0"}', [("SPEC_VERSION_UNSUPPORTED", "x", "spec_version")]),
        ('{"spec_version": "1.0.0", "width": 3, "height": 2}', [("SCHEMA_INVALID", "x", "")]),
        (
            '{"spec_version": 1, "width": 3.5, "height": 2, "frames": []}',
            [("SCHEMA_INVALID", "x", where) for where in ("frames", "spec_version", "width")],
        ),
        ('["spec_version"]', [("SCHEMA_INVALID", "x", "")]),
    ],
)
def test_a_document_that_breaks_a_rule_is_not_used(
    text: str, expected: Found, tmp_path: Path
) -> None:
    (tmp_path / "x.json").write_text(text)
    findings = Findings()
    assert read_document(tmp_path / "x.json", "cameras", findings.at("x")) is None
    assert sorted(found(findings)) == sorted(expected)
