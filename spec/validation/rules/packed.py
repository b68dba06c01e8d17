"""Rules of a packed dataset: its index, and each sequence as it is once taken out of the shards."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

from pliant.spec.dataset import is_name
from pliant.spec.io import limits
from pliant.spec.io.parquet import read_table
from pliant.spec.io.reading import FileRefusedError
from pliant.spec.storage import layout
from pliant.spec.storage.files import LocalFiles
from pliant.spec.storage.packed import Member, members_of
from pliant.spec.validation.findings import FileProblems, Findings
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.listing import check_identity
from pliant.spec.validation.rules.result import SequenceResult
from pliant.spec.validation.rules.sequences import check_sequence
from pliant.spec.validation.rules.structure import printable
from pliant.spec.validation.rules.tables import check_table

Members = dict[str, Member]


def check_index(context: Context, findings: Findings) -> dict[tuple[str, str], Members] | None:
    """Check the index of a packed dataset against its list of sequences.

    Args:
        context: The dataset.
        findings: Gets `INDEX_INVALID` and the codes of any table.

    Returns:
        (tier, id) -> the sequence's files, of every sequence; None if nothing can be found by
        this index.
    """
    path, problems = context.root / layout.INDEX_TABLE, findings.at(layout.INDEX_TABLE)
    table = check_table(path, "index", problems, max_rows=limits.MAX_SEQUENCES)
    if table is None or not table.whole:
        return None
    check_identity(context, table)
    try:
        rows = read_table(path, "index", max_rows=limits.MAX_SEQUENCES).to_pylist()
    except FileRefusedError as error:
        problems.refuse(error)
        return None
    try:
        listing = read_table(context.root / layout.SEQUENCES_TABLE, "sequences", ["id", "tier"])
    except FileRefusedError:
        return {}  # its own rules report it
    listed = listing.to_pylist()
    if [row["id"] for row in rows] != [row["id"] for row in listed]:
        problems.add(
            "INDEX_INVALID",
            "id",
            f"found {len(rows)} rows; required: the ids of sequences.parquet, {len(listed)}, in "
            "that order",
        )
        return None
    found = {}
    for row, entry in zip(listed, rows, strict=True):
        if is_name(row["id"]) and is_name(row["tier"]):
            found[row["tier"], row["id"]] = members_of(entry)
            if len(found[row["tier"], row["id"]]) != len(entry["files"]):
                problems.add("INDEX_INVALID", row["id"], "a file is listed twice")
    return found


def check_any_sequence(
    context: Context,
    tier: str,
    name: str,
    row: dict[str, Any] | None,
    members: Mapping[str, Member] | None,
) -> SequenceResult:
    """Check one sequence, loose or packed.

    Args:
        context: The dataset.
        tier: The folder of its tier.
        name: The sequence.
        row: Its row of sequences.parquet, None if it has none.
        members: Where its files are, None for a folder of its own.

    Returns:
        As `check_sequence`.
    """
    if members is None:
        return check_sequence(context, tier, name, row)
    with tempfile.TemporaryDirectory(prefix="pliant-") as scratch:
        result = SequenceResult(name, tier)
        folder = layout.sequence_dir(Path(scratch), tier, name)
        folder.mkdir(parents=True)
        problems = result.findings.at(layout.INDEX_TABLE)
        if not _unpack(context.root, members, folder, name, problems):
            return result
        return check_sequence(
            replace(context, root=Path(scratch), files=LocalFiles(Path(scratch))), tier, name, row
        )


def _unpack(
    root: Path, members: Mapping[str, Member], folder: Path, name: str, problems: FileProblems
) -> bool:
    """Write a sequence's files into a folder; return whether the index is right about all."""
    storage = LocalFiles(root)
    sound = True
    for path, (shard, offset, count) in members.items():
        where = printable(f"{name}, {path}")[:200]
        limit = limits.MAX_TABLE_BYTES if path.endswith(".parquet") else limits.MAX_IMAGE_FILE_BYTES
        pure = PurePosixPath(path)
        safe = str(pure) == path and not pure.is_absolute() and len(pure.parts) <= 2
        if not safe or ".." in pure.parts or "\\" in path or "\0" in path:
            problems.add("PATH_UNSAFE", where, "it does not stay in the folder")
            sound = False
            continue
        problem = None
        if not layout.is_shard_name(shard) or (root / shard).is_symlink():
            problem = f"{shard[:80]!r} is not a shard"
        elif offset < 0 or not 0 <= count <= limit:
            problem = f"{count} bytes from {offset}"
        else:
            try:
                data = storage.read_range(shard, offset, count)
            except FileRefusedError as error:
                problem = f"{shard}: {error.message}; found {error.found}"
        if problem is not None:
            problems.add("INDEX_INVALID", where, problem)
            sound = False
            continue
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_bytes(data)
    return sound
