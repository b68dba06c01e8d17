"""Packed datasets and published ones: as they should be, and what can be wrong with them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pliant.spec.dataset import Dataset
from pliant.spec.storage import layout
from pliant.spec.storage.manifest import write_checksums, write_manifest
from pliant.spec.storage.packing import FolderToPack, Packer
from tests.conformance.accepted import held_out
from tests.conformance.edits import Case, Edit, both, change_rows, remove, write


def pack(root: Path) -> None:
    """Replace the folder `sequences` by shards and an index."""
    dataset = Dataset.open(root)
    with Packer(root, {"id": dataset.id, "version": dataset.version}) as packer:
        for sequence in dataset.sequences:
            files = {
                path.relative_to(sequence.dir).as_posix(): path.read_bytes()
                for path in sorted(sequence.dir.rglob("*"))
                if path.is_file()
            }
            packer.add(
                FolderToPack(
                    sequence.id,
                    sequence.tier,
                    sequence.split,
                    sequence.shape,
                    sequence.frames,
                    files,
                )
            )
    shutil.rmtree(root / layout.SEQUENCES_DIR)


def _publish(root: Path) -> None:
    """Add the checksums and the manifest of a publication."""
    dataset = Dataset.open(root)
    write_manifest(
        root,
        "public",
        dataset={"id": dataset.id, "version": dataset.version},
        held_out=dataset.held_out,
        checksums_sha256=write_checksums(root),
        other_sha256=None,
        tools={},
    )


def _index(change: Callable[[list[dict[str, Any]]], None]) -> Edit:
    return both(pack, change_rows(layout.INDEX_TABLE, change))


def _beyond(rows: list[dict[str, Any]]) -> None:
    rows[0]["files"][0]["offset"] = 2**40


def _elsewhere(rows: list[dict[str, Any]]) -> None:
    rows[0]["files"][0]["shard"] = "../frames/train-00000.parquet"


def _upwards(rows: list[dict[str, Any]]) -> None:
    rows[0]["files"][0]["path"] = "../cameras.json"


def _shifted(rows: list[dict[str, Any]]) -> None:
    next(f for f in rows[0]["files"] if f["path"].endswith(".png"))["offset"] += 1


def _appended(path: str) -> Edit:
    def edit(root: Path) -> None:
        with open(root / path, "ab") as stream:
            stream.write(b"\n")

    return edit


CASES = [
    Case("packed", "full", "the sequences are packed into shards", (), pack),
    Case(
        "packed-held-out",
        "full",
        "the test split is held out and the sequences are packed",
        (),
        both(held_out, pack),
    ),
    Case(
        "published",
        "minimal",
        "the dataset is packed and has SHA256SUMS and manifest.json",
        (),
        both(pack, _publish),
    ),
    Case(
        "packed-beyond-the-shard",
        "minimal",
        "the index names a place behind a shard's end",
        ("INDEX_INVALID",),
        _index(_beyond),
    ),
    Case(
        "packed-outside",
        "minimal",
        "the index names a shard outside the dataset",
        ("INDEX_INVALID",),
        _index(_elsewhere),
    ),
    Case(
        "packed-path-upwards",
        "minimal",
        "the index gives a file a path that leaves its folder",
        ("PATH_UNSAFE",),
        _index(_upwards),
    ),
    Case(
        "packed-shifted",
        "minimal",
        "the index names a place one byte behind an image's",
        ("CHECKSUM_DIFFERS",),
        _index(_shifted),
    ),
    Case(
        "packed-index-order",
        "full",
        "the index lists the sequences in another order",
        ("INDEX_INVALID",),
        _index(lambda rows: rows.reverse()),
    ),
    Case(
        "packed-extra-file",
        "minimal",
        "a file that is no shard lies among the shards",
        ("FILE_EXTRA",),
        both(pack, write("frames/notes.txt", b"text\n")),
    ),
    Case(
        "published-changed",
        "minimal",
        "a paper was changed after SHA256SUMS was written",
        ("CHECKSUM_DIFFERS",),
        both(write("README.md", b"text\n"), pack, _publish, _appended("README.md")),
    ),
    Case(
        "published-unlisted",
        "minimal",
        "a paper was added after SHA256SUMS was written",
        ("FILE_UNLISTED",),
        both(pack, _publish, write("README.md", b"text\n")),
    ),
    Case(
        "published-gone",
        "minimal",
        "a paper that SHA256SUMS lists is gone",
        ("FILE_MISSING",),
        both(write("README.md", b"text\n"), pack, _publish, remove("README.md")),
    ),
]
"""Packed and published datasets."""
