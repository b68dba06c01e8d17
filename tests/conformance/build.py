"""Builds the conformance suite: `python -m tests.conformance.build`.

It writes the base datasets under `datasets/`, `cases.json`, `cases.zip`, which holds for
every case the files that differ from its base, and the submissions with their index.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pliant.spec.conventions import SPEC_VERSION
from pliant.spec.io.yamlfiles import read_yaml
from tests.conformance import submissions
from tests.conformance.base import BASES
from tests.conformance.steps import perform

HERE = Path(__file__).resolve().parents[2] / "spec" / "conformance"
DATASETS = HERE / "datasets"
INDEX = HERE / "cases.json"
FILES = HERE / "cases.zip"
SUBMISSIONS = HERE / "submissions"
SUBMISSIONS_INDEX = HERE / "submissions.json"


CASES: list[dict[str, Any]] = read_yaml(Path(__file__).with_name("cases.yaml"))
"""Every case of a dataset, in order: its unique `name`, in words joined by hyphens, the `base`
dataset, the `codes` that a validator must report, these and no others, and what is changed: in
words (`change`), and the `steps` of `steps.perform`."""

_EPOCH = (1980, 1, 1, 0, 0, 0)


def files_of(root: Path) -> dict[str, Path]:
    """Return relative path -> path of every file and link below a folder."""
    return {
        path.relative_to(root).as_posix(): path
        for path in sorted(root.rglob("*"))
        if path.is_symlink() or path.is_file()
    }


def describe(
    case: dict[str, Any], base: Path, changed: Path
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Compare a changed dataset with its base.

    Args:
        case: The case.
        base: The base dataset.
        changed: The copy after the change.

    Returns:
        The entry of cases.json; the files that differ, by path.
    """
    before, after = files_of(base), files_of(changed)
    links = {name: os.readlink(path) for name, path in after.items() if path.is_symlink()}
    files = {
        name: path.read_bytes()
        for name, path in after.items()
        if name not in links
        and (name not in before or path.read_bytes() != before[name].read_bytes())
    }
    entry: dict[str, Any] = {
        **{key: case[key] for key in ("name", "base", "change")},
        "codes": sorted(case["codes"]),
        "remove": sorted((set(before) - set(after)) | (set(links) & set(before))),
        "files": sorted(files),
        "links": links,
    }
    return entry, files


def apply(entry: dict[str, Any], archive: zipfile.ZipFile, target: Path) -> None:
    """Make a case's dataset from the shipped files, as any implementation can.

    Args:
        entry: The case's entry of cases.json.
        archive: cases.zip, open.
        target: A folder that does not exist yet.
    """
    shutil.copytree(DATASETS / entry["base"], target)
    for name in entry["remove"]:
        (target / name).unlink()
    for folder in sorted((p for p in target.rglob("*") if p.is_dir()), reverse=True):
        if not any(folder.iterdir()):
            folder.rmdir()
    for name in entry["files"]:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_bytes(archive.read(f"{entry['name']}/{name}"))
    for name, to in entry["links"].items():
        (target / name).symlink_to(to)


def build_cases(datasets: Path) -> Iterator[tuple[dict[str, Any], dict[str, bytes]]]:
    """Yield the entry and the files of every case, made from base datasets."""
    with tempfile.TemporaryDirectory() as scratch:
        for case in CASES:
            changed = Path(scratch) / case["name"]
            shutil.copytree(datasets / case["base"], changed)
            perform(changed, case["steps"])
            yield describe(case, datasets / case["base"], changed)
            shutil.rmtree(changed)


def build() -> None:
    """Write datasets, index and archive anew."""
    shutil.rmtree(DATASETS, ignore_errors=True)
    for name, write in BASES.items():
        (DATASETS / name).mkdir(parents=True)
        write(DATASETS / name)
    entries = []
    with zipfile.ZipFile(FILES, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for entry, files in build_cases(DATASETS):
            entries.append(entry)
            for name, data in files.items():
                info = zipfile.ZipInfo(f"{entry['name']}/{name}", _EPOCH)
                info.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(info, data)
    document = {"spec_version": SPEC_VERSION, "archive": FILES.name, "datasets": entries}
    INDEX.write_text(json.dumps(document, indent=1) + "\n")
    build_submissions()


def build_submissions() -> None:
    """Write the submissions and their index anew."""
    shutil.rmtree(SUBMISSIONS, ignore_errors=True)
    SUBMISSIONS.mkdir()
    entries = []
    for case in submissions.CASES:
        path = SUBMISSIONS / f"{case['name']}.parquet"
        submissions.write_submission(case, DATASETS / "full", path)
        entries.append({"name": path.name, "is": case["is"], "codes": sorted(case["codes"])})
    document = {
        "spec_version": SPEC_VERSION,
        "dataset": "full",
        "split": submissions.SPLIT,
        "submissions": entries,
    }
    SUBMISSIONS_INDEX.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    build()
