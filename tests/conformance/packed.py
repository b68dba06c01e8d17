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
from tests.conformance.edits import Edit, both, change_rows, remove, write


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


EDITS: dict[str, Edit] = {
    "packed": pack,
    "packed-held-out": both(held_out, pack),
    "published": both(pack, _publish),
    "packed-beyond-the-shard": _index(_beyond),
    "packed-outside": _index(_elsewhere),
    "packed-path-upwards": _index(_upwards),
    "packed-shifted": _index(_shifted),
    "packed-index-order": _index(lambda rows: rows.reverse()),
    "packed-extra-file": both(pack, write("frames/notes.txt", b"text\n")),
    "published-changed": both(
        write("README.md", b"text\n"), pack, _publish, _appended("README.md")
    ),
    "published-unlisted": both(pack, _publish, write("README.md", b"text\n")),
    "published-gone": both(write("README.md", b"text\n"), pack, _publish, remove("README.md")),
}
"""Packed and published datasets."""
