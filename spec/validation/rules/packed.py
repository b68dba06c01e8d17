"""Rules of a packed dataset: its index, and each sequence as it is once taken out of the shards."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pliant.spec.io import limits
from pliant.spec.io.parquet import read_table
from pliant.spec.io.reading import FileRefusedError, read_bytes
from pliant.spec.storage import layout
from pliant.spec.storage.files import LocalFiles
from pliant.spec.storage.packed import PackedFiles, members_of
from pliant.spec.validation.findings import FileProblems, Findings
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.files import is_safe
from pliant.spec.validation.rules.listing import check_identity
from pliant.spec.validation.rules.result import SequenceResult
from pliant.spec.validation.rules.sequences import check_sequence
from pliant.spec.validation.rules.structure import printable
from pliant.spec.validation.rules.tables import check_table


def check_index(context: Context, findings: Findings) -> list[tuple[str, str]] | None:
    """Check the index of a packed dataset against its list of sequences.

    Args:
        context: The dataset.
        findings: Gets `INDEX_INVALID` and the codes of any table.

    Returns:
        (tier, id) of every row of the list; None if nothing can be found by this index.
    """
    path, problems = context.root / layout.INDEX_TABLE, findings.at(layout.INDEX_TABLE)
    table = check_table(path, "index", problems, max_rows=limits.MAX_SEQUENCES)
    if table is None or not table.whole:
        return None
    check_identity(context, table)
    index = table.read()
    if index is None:
        return None
    rows = index.to_pylist()
    try:
        listing = read_table(context.root / layout.SEQUENCES_TABLE, "sequences", ["id", "tier"])
    except FileRefusedError:
        return []  # its own rules report it
    listed = listing.to_pylist()
    if [row["id"] for row in rows] != [row["id"] for row in listed]:
        problems.add(
            "INDEX_INVALID",
            "id",
            f"found {len(rows)} rows; required: the ids of sequences.parquet, {len(listed)}, in "
            "that order",
        )
        return None
    for entry in rows:
        if len(members_of(entry)) != len(entry["files"]):
            problems.add("INDEX_INVALID", entry["id"], "a file is listed twice")
    return [(row["tier"], row["id"]) for row in listed]


@np.errstate(all="ignore")  # absurd values break a rule or none; NumPy's warnings would say neither
def check_any_sequence(
    context: Context, tier: str, name: str, row: dict[str, Any] | None
) -> SequenceResult:
    """Check one sequence, loose or packed.

    Args:
        context: The dataset.
        tier: The folder of its tier.
        name: The sequence.
        row: Its row of sequences.parquet, None if it has none.

    Returns:
        As `check_sequence`.
    """
    if not isinstance(context.files, PackedFiles):
        return check_sequence(context, tier, name, row)
    with tempfile.TemporaryDirectory(prefix="pliant-") as scratch:
        result = SequenceResult(name, tier)
        root = Path(scratch)
        if not _unpack(context.files, root, tier, name, result.findings.at(layout.INDEX_TABLE)):
            return result
        return check_sequence(replace(context, root=root, files=LocalFiles(root)), tier, name, row)


def _unpack(files: PackedFiles, root: Path, tier: str, name: str, problems: FileProblems) -> bool:
    """Write a sequence's files below a folder; return whether the index is right about all."""
    folder = root / layout.sequence_name(tier, name)
    folder.mkdir(parents=True)
    sound = True
    for path, (shard, _, _) in files.members(name).items():
        where = printable(f"{name}, {path}")[:200]
        if not is_safe(path) or path.count("/") > 1:
            problems.add("PATH_UNSAFE", where, "it does not stay in the folder")
            sound = False
            continue
        try:
            data = read_bytes(
                files.get(f"{layout.sequence_name(tier, name)}/{path}"), limits.MAX_TABLE_BYTES
            )
        except FileRefusedError as error:
            problems.add("INDEX_INVALID", where, f"{shard[:80]}: {error.without_place()}")
            sound = False
            continue
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_bytes(data)
    return sound
