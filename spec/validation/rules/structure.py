"""What may be where in a dataset: names, kinds of file, nothing extra, no links."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from pliant.spec.conventions import SPLITS
from pliant.spec.storage import layout
from pliant.spec.validation.findings import Findings

PAPERS: Final = frozenset(
    {
        "README.md",
        "LICENSE",
        "CITATION.cff",
        "croissant.json",
        ".zenodo.json",
        "eval.yaml",
        ".gitattributes",
    }
)
"""Files for people and catalogues that may be in the root; their contents have no rules."""

WORKSHOPS: Final = frozenset({".pliant", ".cache", ".git", layout.PRIVATE_DIR})
"""Working folders in the root, of a generator, of a download, of git; not part of the dataset,
never looked into."""

_SPLIT_FILES: Final = {f"{split}.parquet" for split in SPLITS}

UNLISTED: Final = frozenset({layout.CHECKSUMS, layout.MANIFEST_JSON, ".gitattributes"})
"""Files that `SHA256SUMS` leaves out."""


def list_folder(folder: Path, shown: str, findings: Findings) -> tuple[set[str], set[str]]:
    """List a folder without following links.

    Args:
        folder: The folder.
        shown: Its path in issues, relative to the dataset; empty for the root.
        findings: Gets `PATH_UNSAFE` for links and special files, `FILE_UNREADABLE` for a
            folder that cannot be listed.

    Returns:
        Names of its files, names of its folders.
    """
    files: set[str] = set()
    folders: set[str] = set()
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_file(follow_symlinks=False):
                    files.add(entry.name)
                elif entry.is_dir(follow_symlinks=False):
                    folders.add(entry.name)
                else:
                    kind = "a link" if entry.is_symlink() else "a special file"
                    findings.add(
                        "PATH_UNSAFE",
                        printable(f"{shown}/{entry.name}" if shown else entry.name),
                        "",
                        f"a dataset contains regular files and folders only; found {kind}",
                    )
    except OSError as error:
        findings.add("FILE_UNREADABLE", shown or ".", "", f"cannot be listed: {error.strerror}")
    return files, folders


def printable(path: str) -> str:
    """Return a path as text that can be encoded, whatever bytes its name holds."""
    return path.encode("utf-8", "backslashreplace").decode("utf-8")


def report_extra(findings: Findings, shown: str, extra: set[str], allowed: str) -> None:
    """Report entries that the layout does not provide for.

    Args:
        findings: Gets `FILE_EXTRA`.
        shown: The folder's path in issues; empty for the root.
        extra: Names.
        allowed: What may be there, in words.
    """
    for name in sorted(extra):
        path = printable(f"{shown}/{name}" if shown else name)
        findings.add("FILE_EXTRA", path, "", f"nothing of this name belongs here; {allowed}")


def check_root(root: Path, findings: Findings) -> dict[str, set[str]]:
    """Check the folders above the sequences.

    Args:
        root: The dataset.
        findings: Gets the problems.

    Returns:
        Tier folder -> the names of its sequence folders; none for a packed dataset.
    """
    files, folders = list_folder(root, "", findings)
    required = {layout.DATASET_JSON, layout.SEQUENCES_TABLE}
    linked = {issue.path for issue in findings.issues if issue.code == "PATH_UNSAFE"}
    for name in sorted(required - files - linked):
        findings.add("FILE_MISSING", name, "", "a dataset must hold this file")
    packed = layout.INDEX_TABLE in files
    if layout.SEQUENCES_DIR not in folders | linked and not packed:
        findings.add("FILE_MISSING", layout.SEQUENCES_DIR, "", "a dataset must hold this folder")
    known = {layout.QUERIES_DIR, layout.TRUTH_DIR, layout.PICTURES_DIR}
    known |= {layout.WEBDATASET_DIR, layout.PAIRS_DIR}
    known |= {*WORKSHOPS, *(layout.SHARD_DIRS if packed else (layout.SEQUENCES_DIR,))}
    free = PAPERS | {layout.INDEX_TABLE, layout.CHECKSUMS, layout.MANIFEST_JSON}
    report_extra(findings, "", (files - required - free) | (folders - known), "see SPEC.md, Files")
    shards = layout.SHARD_DIRS if packed else ()
    for name in (*shards, layout.QUERIES_DIR, layout.TRUTH_DIR):
        if name in folders:
            inside, deeper = list_folder(root / name, name, findings)
            own, words = _SPLIT_FILES, "SPLIT.parquet"
            if name in shards:
                own = {each for each in inside if layout.is_shard_name(f"{name}/{each}")}
                words = "SPLIT-NUMBER.parquet"
            report_extra(findings, name, deeper | inside - own, f"{words} alone does")
    if packed or layout.SEQUENCES_DIR not in folders:
        return {}
    loose, tiers = list_folder(root / layout.SEQUENCES_DIR, layout.SEQUENCES_DIR, findings)
    report_extra(findings, layout.SEQUENCES_DIR, loose, "folders of tiers alone do")
    found: dict[str, set[str]] = {}
    for tier in sorted(tiers):
        shown = f"{layout.SEQUENCES_DIR}/{tier}"
        loose, found[tier] = list_folder(root / layout.SEQUENCES_DIR / tier, shown, findings)
        report_extra(findings, shown, loose, "folders of sequences alone do")
    return found
