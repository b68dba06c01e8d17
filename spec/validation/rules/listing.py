"""Rules of the lists of a dataset: sequences.parquet, `SHA256SUMS` and `manifest.json`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from pliant.spec.errors import SpecError
from pliant.spec.io import limits
from pliant.spec.io.reading import sha256_file
from pliant.spec.opening import is_name
from pliant.spec.storage import layout
from pliant.spec.storage.layout import SEQUENCES_DIR, SEQUENCES_TABLE
from pliant.spec.storage.manifest import read_checksums
from pliant.spec.validation.findings import FileProblems, Findings
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.files import read_document
from pliant.spec.validation.rules.structure import UNLISTED, WORKSHOPS, printable
from pliant.spec.validation.rules.tables import CheckedTable, check_table


def check_listing(
    context: Context, folders: dict[str, set[str]], findings: Findings
) -> dict[str, dict[str, Any]]:
    """Check the list of sequences against itself and against the folders.

    Args:
        context: The dataset.
        folders: Tier folder -> names of its sequence folders.
        findings: Gets the problems.

    Returns:
        Sequence id -> its row, for the rows that name a sequence once.
    """
    path, problems = context.root / SEQUENCES_TABLE, findings.at(SEQUENCES_TABLE)
    if not path.is_file():
        return {}  # the rules of the folders report it
    table = check_table(path, "sequences", problems, max_rows=limits.MAX_SEQUENCES)
    if table is None or not table.whole:
        return {}
    check_identity(context, table)
    rows: dict[str, dict[str, Any]] = {}
    listed = table.read()
    for number, row in enumerate([] if listed is None else listed.to_pylist()):
        where = f"row {number}"
        name = row["id"]
        if not is_name(name):
            problems.add("PATH_UNSAFE", where, f"{name[:80]!r} is not a sequence name")
            continue
        if name in rows:
            other = rows[name]["split"]
            code = "ROW_DUPLICATE" if other == row["split"] else "SPLIT_SHARED"
            text = f"{name} is listed a second time ({other} and {row['split']})"
            problems.add(code, where, text)
            continue
        rows[name] = row
        _check_row(context, row, where, problems)
    if listed is not None:
        for split in sorted(set(context.splits) - set(listed["split"].to_pylist())):
            text = f"dataset.json declares the split {split}, and no sequence is of it"
            problems.add("ROW_MISSING", "split", text)
    _compare_folders(context, rows, folders, findings)
    return rows


def check_identity(context: Context, table: CheckedTable) -> None:
    """Check that a footer's `dataset`, where it has one, names this dataset."""
    named = table.footer.get("dataset")
    if named is not None and named != context.identity:
        text = f"found {named}; dataset.json has {context.identity}"
        table.problems.add("IDENTITY_DIFFERS", "footer dataset", text)


def _check_row(context: Context, row: dict[str, Any], where: str, problems: FileProblems) -> None:
    for name, known in (("tier", context.tiers), ("split", context.splits)):
        if row[name] not in known:
            text = f"{row[name][:80]!r} is none of {list(known)}"
            problems.add(f"{name.upper()}_UNKNOWN", f"{where}, {name}", text)
    ranges: list[tuple[str, bool, str]] = [
        ("frames", 1 <= row["frames"] <= limits.MAX_FRAMES, f"1 to {limits.MAX_FRAMES}"),
        ("seed", row["seed"] >= 0, ">= 0"),
        ("seed", row["seed"] <= 0 or context.seeded, "0: provenance.seed of dataset.json is null"),
        ("style", is_name(row["style"]), "a name of letters, digits, ., _ and -"),
    ]
    for name, highest in (("coverage", math.inf), ("self_occluded", 1.0)):
        value = row[name]
        if value is None:
            continue
        if not math.isfinite(value):
            problems.add("VALUE_NOT_FINITE", f"{where}, {name}", f"found {value}")
        else:
            ranges.append((name, 0 <= value <= highest, f"0 to {highest}"))
    for name, good, allowed in ranges:
        if not good:
            text = f"found {row[name]!r:.80}; required: {allowed}"
            problems.add("VALUE_OUT_OF_RANGE", f"{where}, {name}", text)


def _compare_folders(
    context: Context,
    rows: dict[str, dict[str, Any]],
    folders: dict[str, set[str]],
    findings: Findings,
) -> None:
    listed = {(row["tier"], name) for name, row in rows.items() if row["tier"] in context.tiers}
    present = {(tier, name) for tier, names in folders.items() for name in names}
    for tier, name in sorted(listed - present):
        text = "sequences.parquet lists this sequence, and it has no folder"
        findings.add("FILE_MISSING", f"{SEQUENCES_DIR}/{tier}/{name}", "", text)
    for tier, name in sorted(present - listed):
        text = f"the folder {SEQUENCES_DIR}/{tier}/{name} is not listed"[:200]
        findings.add("ROW_MISSING", SEQUENCES_TABLE, "", text)


def check_checksums(context: Context, findings: Findings) -> bool:
    """Check that the dataset is the one its checksums and its manifest speak of.

    Args:
        context: The dataset.
        findings: Gets `CHECKSUM_DIFFERS`, `FILE_UNLISTED`, `FILE_MISSING`, `IDENTITY_DIFFERS`.

    Returns:
        Whether anything else can be checked: a private half is not a dataset.
    """
    root = context.root
    sums = root / layout.CHECKSUMS
    if sums.is_file() and not sums.is_symlink():
        with findings.at(layout.CHECKSUMS).refusals():
            _compare_checksums(root, read_checksums(sums), findings)
    manifest = root / layout.MANIFEST_JSON
    if not manifest.is_file() or manifest.is_symlink():
        return True
    problems = findings.at(layout.MANIFEST_JSON)
    document = read_document(manifest, "manifest", problems)
    if document is None:
        return True
    if document["half"] != "public":
        text = "this is the private half of a published dataset, with the answers alone"
        problems.add("IDENTITY_DIFFERS", "dataset, half", f"{text}; required: the public half")
        return False
    found, required = document["dataset"], context.identity
    if found != required:
        text = f"found {found}; required: {required}"
        problems.add("IDENTITY_DIFFERS", "dataset, half", text)
    if sorted(document["held_out"]) != sorted(context.held_out):
        text = f"found {document['held_out']}; dataset.json has {sorted(context.held_out)}"
        problems.add("IDENTITY_DIFFERS", "held_out", text)
    if not sums.is_file():
        findings.add("FILE_MISSING", layout.CHECKSUMS, "", "manifest.json names its checksum")
    elif (found := sha256_file(sums)) != document["checksums_sha256"]:
        text = f"found sha256 {found}; manifest.json names {document['checksums_sha256']}"
        findings.add("CHECKSUM_DIFFERS", layout.CHECKSUMS, "", text)
    return True


def _compare_checksums(root: Path, listed: dict[str, str], findings: Findings) -> None:
    present = {
        path.relative_to(root).as_posix()
        for path in root.rglob("*")
        if path.is_file()
        and not path.is_symlink()
        and path.relative_to(root).parts[0] not in WORKSHOPS
    }
    for name in sorted(present - set(listed) - UNLISTED):
        findings.add("FILE_UNLISTED", layout.CHECKSUMS, "", f"{printable(name)[:200]} is missing")
    for name in sorted(listed):
        if name not in present:
            findings.add("FILE_MISSING", printable(name)[:200], "", "SHA256SUMS lists it")
            continue
        try:
            found = sha256_file(root / name)
        except SpecError as error:
            findings.add("FILE_UNREADABLE", name, "", str(error)[:300])
            continue
        if found != listed[name]:
            text = f"found sha256 {found}; SHA256SUMS lists {listed[name]}"
            findings.add("CHECKSUM_DIFFERS", name, "", text)
