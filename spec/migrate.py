"""Bringing older datasets to the current version: pure steps from document to document."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from pliant.spec.conventions import NEWEST_VERSION
from pliant.spec.dataset import check_version, is_name
from pliant.spec.errors import SpecError
from pliant.spec.io.jsonfiles import is_newer_minor, read_json, write_json
from pliant.spec.io.reading import file_entry
from pliant.spec.storage import layout

Document = dict[str, Any]
Change = Callable[[Document], Document]

KINDS: Final = ("dataset", "sequence", "cameras")


@dataclass(frozen=True)
class Step:
    """What changes from one version to the next.

    Attributes:
        source: The version it starts from.
        target: The version it leads to.
        changes: Kind of document (`dataset`, `sequence`, `cameras`) -> a pure function from
            the old document to the new one; a kind that does not change is left out. The
            `spec_version` is set by `migrate_document`.
    """

    source: str
    target: str
    changes: Mapping[str, Change] = field(default_factory=dict)


STEPS: Final[tuple[Step, ...]] = (Step("1.0.0", "1.1.0"),)
"""Every step, in order, one per version. 1.1.0 only allows more: no document changes."""


def migrate_document(
    kind: str,
    document: Document,
    steps: Sequence[Step] = STEPS,
    current: str = NEWEST_VERSION,
) -> Document:
    """Return a document as the current version has it; the argument is left alone.

    Args:
        kind: One of `KINDS`.
        document: The parsed JSON document.
        steps: The steps known.
        current: The version to reach.

    Raises:
        SpecError: No chain of steps leads from the document's version to the current one.
    """
    result = copy.deepcopy(document)
    while result.get("spec_version") != current:
        step = next((s for s in steps if s.source == result.get("spec_version")), None)
        if step is None:
            raise SpecError(
                "no migration is known from this version",
                where="spec_version",
                found=str(result.get("spec_version"))[:40],
                required=current,
            )
        result = step.changes.get(kind, dict)(result)
        result["spec_version"] = step.target
    return result


@dataclass(frozen=True)
class Migration:
    """The outcome for one dataset.

    Attributes:
        found: The version it had.
        reached: The version it has now.
        files: The files that were rewritten, relative to its root.
    """

    found: str
    reached: str
    files: list[str]


def migrate(
    root: Path | str, steps: Sequence[Step] = STEPS, current: str = NEWEST_VERSION
) -> Migration:
    """Bring the JSON documents of a dataset to the current version, in place.

    Tables are not touched: within a major version a table of an older minor version is valid.
    `dataset.json` is written last, so that an interrupted migration starts again where it
    was; every file is replaced as a whole.

    Args:
        root: The dataset.
        steps: The steps known.
        current: The version to reach.

    Returns:
        What was done; no files if there was nothing to do.

    Raises:
        SpecError: It is not a dataset, its version is newer or unknown, or a file is damaged.
    """
    root = Path(root)
    path = root / layout.DATASET_JSON
    info = _object(read_json(path), path)
    found = str(info.get("spec_version"))
    if found == current:
        return Migration(found, current, [])
    check_version(found, path)
    if current == NEWEST_VERSION and is_newer_minor(found):
        raise SpecError(
            "the dataset is of a newer version than this Pliant",
            path=path,
            where="spec_version",
            found=found,
            required=f"at most {current}",
            fix="Install a newer Pliant; nothing needs migrating.",
        )
    files: list[str] = []
    for folder in sorted((root / layout.SEQUENCES_DIR).glob("*/*")):
        if folder.is_dir() and is_name(folder.name) and not folder.is_symlink():
            files += _migrate_sequence(root, folder, steps, current)
    write_json(path, migrate_document("dataset", info, steps, current))
    return Migration(found, current, [*files, layout.DATASET_JSON])


def _migrate_sequence(root: Path, folder: Path, steps: Sequence[Step], current: str) -> list[str]:
    path = folder / layout.SEQUENCE_JSON
    info = _object(read_json(path), path)
    changed: list[Path] = []
    listed: Document = {}
    cameras_path = folder / layout.CAMERAS_JSON
    if cameras_path.is_file():  # a held-out or recorded sequence may have none
        cameras = _object(read_json(cameras_path), cameras_path)
        if cameras.get("spec_version") != current:
            write_json(cameras_path, migrate_document("cameras", cameras, steps, current))
            changed.append(cameras_path)
        listed = file_entry(folder, layout.CAMERAS_JSON)
    unlisted = listed and listed not in info.get("files", [])
    if info.get("spec_version") != current or unlisted:
        document = migrate_document("sequence", info, steps, current)
        document["files"] = [
            listed if entry.get("path") == layout.CAMERAS_JSON else entry
            for entry in document["files"]
        ]
        write_json(path, document)
        changed.append(path)
    return [item.relative_to(root).as_posix() for item in changed]


def _object(document: Any, path: Path) -> Document:
    if not isinstance(document, dict):
        raise SpecError("the document is not a JSON object", path=path)
    return document
