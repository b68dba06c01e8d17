"""Rules of a sequence's folder: its sequence.json, the files it lists, their checksums."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from pliant.spec.errors import SpecError
from pliant.spec.io import limits
from pliant.spec.io.jsonfiles import parse_json, schema_errors
from pliant.spec.io.reading import (
    AnyFile,
    Blob,
    FileRefusedError,
    check_regular,
    read_bytes,
    sha256_file,
)
from pliant.spec.opening import check_version
from pliant.spec.storage import layout
from pliant.spec.validation.findings import FileProblems, Findings
from pliant.spec.validation.rules.structure import list_folder, printable, report_extra


@dataclass
class SequenceFiles:
    """The files of a sequence as its sequence.json lists them and as they are there.

    Attributes:
        folder: The sequence's folder.
        shown: Its path in issues.
        findings: Gets its problems.
        present: Paths of the regular files, relative to the folder.
        sound: Those whose size and checksum are as listed; only they are looked into.
        hashes: Path -> listed sha256.
    """

    folder: Path
    shown: str
    findings: Findings
    present: set[str]
    sound: set[str] = field(default_factory=set)
    hashes: dict[str, tuple[str, int]] = field(default_factory=dict)

    def at(self, name: str) -> FileProblems:
        """Return what adds problems of one of the files."""
        return self.findings.at(f"{self.shown}/{name}")

    def contents(self, name: str) -> AnyFile | None:
        """Return a file with the right checksum: an image's bytes, or a path.

        Reports `CHECKSUM_DIFFERS`, `FILE_TOO_LARGE` and `FILE_UNREADABLE`.

        Args:
            name: Path relative to the folder.
        """
        file: AnyFile = self.folder / name
        if name not in self.present:
            return None
        if name not in self.hashes:
            return file
        limit = limits.max_file_bytes(name)
        listed, listed_size = self.hashes[name]
        found = None
        try:
            size = check_regular(file, limit)
            if size == listed_size:
                if name.endswith((".png", ".exr")):  # read once for checksum and decoding
                    file = Blob(str(file), (self.folder / name).read_bytes())
                found = sha256_file(file)
        except (SpecError, OSError) as error:
            code = error.code if isinstance(error, FileRefusedError) else "FILE_UNREADABLE"
            self.at(name).add(code, "", str(error)[:300])
            return None
        if found == listed:
            self.sound.add(name)
            return file
        self.at(name).add(
            "CHECKSUM_DIFFERS",
            "",
            f"found {size} bytes; sequence.json lists {listed_size}"
            if found is None
            else f"found sha256 {found}; sequence.json lists {listed}",
        )
        return None


def read_document(path: AnyFile, schema: str, problems: FileProblems) -> Any:
    """Read a JSON file of the dataset; return it, or None if it breaks a rule.

    Args:
        path: The file.
        schema: Name of its schema.
        problems: Gets the problems.
    """
    with problems.refusals():
        document = parse_json(read_bytes(path, limits.MAX_JSON_BYTES), path)
        version = document.get("spec_version") if isinstance(document, dict) else None
        if isinstance(version, str):
            check_version(version, path)
        errors = list(schema_errors(document, schema))
        for where, message in errors:
            problems.add("SCHEMA_INVALID", where, message)
        if not errors:
            return document
    return None


def list_sequence(folder: Path, shown: str, findings: Findings) -> SequenceFiles:
    """List a sequence's folder, reporting what does not belong there.

    Args:
        folder: The sequence's folder.
        shown: Its path in issues.
        findings: Gets `FILE_EXTRA` and `PATH_UNSAFE`.
    """
    files, folders = list_folder(folder, shown, findings)
    present = set(files)
    known = {"rgb", "depth", "masks", "camera_depth"}
    report_extra(findings, shown, folders - known, f"only folders {', '.join(sorted(known))} do")
    for name in sorted(folders & known):
        inside, deeper = list_folder(folder / name, f"{shown}/{name}", findings)
        report_extra(findings, f"{shown}/{name}", deeper, "images alone do")
        present |= {f"{name}/{entry}" for entry in inside}
    return SequenceFiles(folder, shown, findings, present)


def check_files(files: SequenceFiles, info: dict[str, Any], *, held_out: bool) -> None:
    """Compare the files listed in sequence.json, those required, and those there.

    Args:
        files: The folder; gets the listed checksums.
        info: The sequence.json, valid by its schema.
        held_out: True if the sequence's split is published without its truth.
    """
    pictures = {layout.rgb_name(frame) for frame in range(info["frames"])}
    telling = {layout.POINTS_TABLE, layout.CORRESPONDENCES_TABLE}
    telling |= {layout.depth_name(frame) for frame in range(info["frames"])}
    required = pictures if held_out else pictures | telling | {layout.CAMERAS_JSON}
    document = files.at(layout.SEQUENCE_JSON)
    for index, entry in enumerate(info["files"]):
        name = entry["path"]
        where = f"files[{index}]"
        if not is_safe(name):
            document.add("PATH_UNSAFE", where, f"{name[:120]!r} does not stay in the folder")
        elif name in files.hashes:
            document.add("FILE_UNLISTED", where, f"{name[:120]} is listed twice")
        elif name == layout.SEQUENCE_JSON:
            text = f"{name} lists itself; required: every other file"
            document.add("FILE_UNLISTED", where, text)
        elif name not in required and name not in files.present:
            files.at(printable(name)[:200]).add("FILE_MISSING", "", "listed, not there")
        else:
            files.hashes[name] = (entry["sha256"], entry["bytes"])
    unsafe = {issue.path for issue in files.findings.issues if issue.code == "PATH_UNSAFE"}
    for name in sorted(required):
        if name not in files.present and f"{files.shown}/{name}" not in unsafe:
            text = f"a sequence of {info['frames']} frames must hold this file"
            files.at(name).add("FILE_MISSING", "", text)
    extra = files.present - required - {layout.SEQUENCE_JSON}
    if held_out:
        for name in sorted(extra & telling):
            text = f"the split {info['split']} is held out, and this file tells its truth"
            files.at(name).add("HELD_OUT_LEAKS", "", text)
        extra -= telling | {layout.CAMERAS_JSON}
        extra -= _recorded(files, info, extra)
    for name in sorted(files.present - extra - {layout.SEQUENCE_JSON} - set(files.hashes)):
        document.add("FILE_UNLISTED", "files", f"{name} is not listed")
    report_extra(files.findings, files.shown, extra, f"{info['frames']} frames need no such file")


def _recorded(files: SequenceFiles, info: dict[str, Any], extra: set[str]) -> set[str]:
    """Return the masks and depth images: a sequence has them of all frames or of none."""
    found: set[str] = set()
    for name_of in (layout.mask_name, layout.camera_depth_name):
        names = {name_of(frame) for frame in range(info["frames"])}
        present = names & extra
        for name in sorted(names - present) if present else ():
            text = "other frames of the sequence have such a file"
            files.at(name).add("FILE_MISSING", "", text)
        found |= present
    return found


def is_safe(name: str) -> bool:
    """Return whether a path stays in the folder that it is relative to."""
    path = PurePosixPath(name)
    return (
        not path.is_absolute()
        and "\\" not in name
        and "\0" not in name
        and str(path) == name
        and not {".", ".."} & set(name.split("/"))
    )
