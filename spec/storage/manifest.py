"""Checksums of a published dataset: `SHA256SUMS`, and `manifest.json`, which links both halves.

`SHA256SUMS` is what `sha256sum -c` reads, a line a file, sorted by path. `manifest.json` names the
checksum of that list, and that of the other half's list. So each half proves itself whole, and
the two that they are of one publication.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, Literal

from pliant.spec.conventions import SPEC_VERSION
from pliant.spec.errors import SpecError
from pliant.spec.io.jsonfiles import read_json, write_json
from pliant.spec.io.reading import AnyFile, FileRefusedError, read_bytes, sha256_file
from pliant.spec.storage import layout
from pliant.spec.storage.files import Files

Half = Literal["public", "private"]

MAX_CHECKSUMS_BYTES: Final = 2**30

_LINE = re.compile(r"([0-9a-f]{64})  (.+)")
_NOT_LISTED = frozenset({layout.CHECKSUMS, layout.MANIFEST_JSON})


def write_checksums(root: Path) -> str:
    """Write `SHA256SUMS` over every other file below a folder.

    Args:
        root: The folder; its `manifest.json`, if there, is left out.

    Returns:
        The sha256 of the list.
    """
    names = sorted(path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file())
    lines = [f"{sha256_file(root / name)}  {name}\n" for name in names if name not in _NOT_LISTED]
    path = root / layout.CHECKSUMS
    path.write_bytes("".join(lines).encode())
    return sha256_file(path)


def read_checksums(path: AnyFile) -> dict[str, str]:
    """Return path -> sha256 of a `SHA256SUMS`.

    Args:
        path: The file.

    Raises:
        FileRefusedError: It cannot be read, or a line is not `SHA256  PATH`.
    """
    try:
        text = read_bytes(path, MAX_CHECKSUMS_BYTES).decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileRefusedError("FILE_UNREADABLE", "this is not UTF-8 text", path=path) from error
    found: dict[str, str] = {}
    for number, line in enumerate(text.splitlines(), 1):
        match = _LINE.fullmatch(line)
        if match is None or match[2] in found:
            raise FileRefusedError(
                "FILE_UNREADABLE",
                "a line is not a checksum, or repeats a file",
                path=path,
                where=f"line {number}",
                found=repr(line[:100]),
                required="64 hexadecimal digits, two spaces, a path",
            )
        found[match[2]] = match[1]
    return found


def write_manifest(
    root: Path,
    half: Half,
    *,
    dataset: Mapping[str, str],
    held_out: Iterable[str],
    checksums_sha256: str,
    other_sha256: str | None,
    tools: Mapping[str, str],
) -> None:
    """Write a half's `manifest.json`.

    Args:
        root: The half.
        half: Which it is.
        dataset: `id` and `version`.
        held_out: The splits whose truth is in the private half.
        checksums_sha256: Of the half's own `SHA256SUMS`.
        other_sha256: Of the other half's, None if there is no other.
        tools: Name and version of what wrote the files.
    """
    document = {
        "spec_version": SPEC_VERSION,
        "half": half,
        "dataset": dict(dataset),
        "held_out": list(held_out),
        "checksums_sha256": checksums_sha256,
        "other_sha256": other_sha256,
        "tools": dict(tools),
    }
    write_json(root / layout.MANIFEST_JSON, document, "manifest")


def check_halves(public: Files, private: Files) -> None:
    """Check by their manifests that a private half belongs to a public one.

    Args:
        public: The public half; where it has no manifest (a copy of parts of it), the dataset's
            id and version are compared alone.
        private: The private half.

    Raises:
        SpecError: It is not a private half, or another dataset's.
    """
    path = private.get(layout.MANIFEST_JSON)
    if not private.has(layout.MANIFEST_JSON):
        raise SpecError(
            "this is not a private half of a published dataset",
            path=path,
            required=f"a folder with a {layout.MANIFEST_JSON}, made by `pliant publish`; for "
            "--truth also SPLIT.parquet or its folder",
        )
    own: dict[str, Any] = read_json(path, "manifest")
    if own["half"] != "private":
        raise SpecError(
            "this is the public half of a published dataset, not the private one", path=path
        )
    info = read_json(public.get(layout.DATASET_JSON))
    named = {name: info[name] for name in ("id", "version")}
    if own["dataset"] != named:
        raise _foreign(path, "dataset", own["dataset"], named)
    if not public.has(layout.MANIFEST_JSON):
        return
    other: dict[str, Any] = read_json(public.get(layout.MANIFEST_JSON), "manifest")
    # Not the reverse: corrected answers are published again, and the public half stays the same.
    if own["other_sha256"] != other["checksums_sha256"]:
        raise _foreign(path, "other_sha256", own["other_sha256"], other["checksums_sha256"])


def _foreign(path: AnyFile, field: str, found: object, required: object) -> SpecError:
    return SpecError(
        "the private half belongs to another publication",
        path=path,
        where=field,
        found=found,
        required=f"{required}, the public half's",
        fix="Give the two folders that one `pliant publish` made.",
    )
