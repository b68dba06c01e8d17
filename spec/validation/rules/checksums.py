"""Rules of `SHA256SUMS` and `manifest.json`, where a dataset has them."""

from __future__ import annotations

from pliant.spec.errors import SpecError
from pliant.spec.io.checksums import sha256_file
from pliant.spec.io.reading import FileRefusedError
from pliant.spec.storage import layout
from pliant.spec.storage.manifest import read_checksums
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.files import read_document
from pliant.spec.validation.rules.structure import UNLISTED, WORKSHOPS, printable


def check_checksums(context: Context, findings: Findings) -> None:
    """Check that the dataset is the one its checksums and its manifest speak of.

    Args:
        context: The dataset.
        findings: Gets `CHECKSUM_DIFFERS`, `FILE_UNLISTED`, `FILE_MISSING`, `IDENTITY_DIFFERS`.
    """
    root = context.root
    sums = root / layout.CHECKSUMS
    if sums.is_file() and not sums.is_symlink():
        _check_sums(context, findings)
    manifest = root / layout.MANIFEST_JSON
    if not manifest.is_file() or manifest.is_symlink():
        return
    problems = findings.at(layout.MANIFEST_JSON)
    document = read_document(manifest, "manifest", problems)
    if document is None:
        return
    named = {"id": context.id, "version": context.version}
    if document["dataset"] != named or document["half"] != "public":
        text = f"found {document['dataset']}, {document['half']}; required: {named}, public"
        problems.add("IDENTITY_DIFFERS", "dataset, half", text)
    if sorted(document["held_out"]) != sorted(context.held_out):
        text = f"found {document['held_out']}; dataset.json has {sorted(context.held_out)}"
        problems.add("IDENTITY_DIFFERS", "held_out", text)
    if not sums.is_file():
        findings.add("FILE_MISSING", layout.CHECKSUMS, "", "manifest.json names its checksum")
    elif (found := sha256_file(sums)) != document["checksums_sha256"]:
        text = f"found sha256 {found}; manifest.json names {document['checksums_sha256']}"
        findings.add("CHECKSUM_DIFFERS", layout.CHECKSUMS, "", text)


def _check_sums(context: Context, findings: Findings) -> None:
    root = context.root
    try:
        listed = read_checksums(root / layout.CHECKSUMS)
    except FileRefusedError as error:
        findings.at(layout.CHECKSUMS).refuse(error)
        return
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
