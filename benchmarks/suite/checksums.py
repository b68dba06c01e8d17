"""The frozen test queries: their checksums, and those of their sequences."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pliant.benchmarks.suite.config import TEST_SPLIT, BenchmarkConfig
from pliant.benchmarks.suite.work import Workspace
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage.layout import CORRESPONDENCES_TABLE, queries_name, truth_name


@dataclass(frozen=True)
class Differences:
    """How a benchmark's test questions compare with the frozen ones.

    Attributes:
        frozen: Whether there are frozen checksums at all.
        sets: Sets that differ, with what differs.
        unfrozen: Sets that have no frozen checksums.
    """

    frozen: bool
    sets: Mapping[str, str]
    unfrozen: tuple[str, ...] = ()


def set_checksums(data: Path) -> dict[str, Any]:
    """Return the checksums of a set's test split.

    Args:
        data: The set's folder, finished.

    Returns:
        `queries` and `truth`, SHA-256 of the two files, and `tables`: sequence -> SHA-256 of its
        correspondence table.
    """
    dataset = Dataset.open(data)
    tables = {
        each.id: sha256_file(each.dir / CORRESPONDENCES_TABLE)
        for each in dataset.sequences
        if each.split == TEST_SPLIT
    }
    return {
        "queries": sha256_file(data / queries_name(TEST_SPLIT)),
        "truth": sha256_file(data / truth_name(TEST_SPLIT)),
        "tables": tables,
    }


def compare_checksums(config: BenchmarkConfig, work: Workspace) -> Differences:
    """Compare the finished sets with the frozen checksums, and write those found to the folder.

    Args:
        config: The benchmark.
        work: Its folder, all sets made.

    Raises:
        CallError: The file of checksums cannot be read.
    """
    found = {name: set_checksums(work.set_path(name)) for name in config.asked}
    document = {"name": config.name, "version": config.version, "sets": found}
    write_json(work.root / "checksums.json", document)
    frozen = read_frozen(config)
    if frozen is None:
        return Differences(False, {})
    known = frozen["sets"]
    differing = {
        name: _what_differs(known[name], checksums)
        for name, checksums in found.items()
        if name in known and known[name] != checksums
    }
    return Differences(True, differing, tuple(name for name in found if name not in known))


def read_frozen(config: BenchmarkConfig) -> dict[str, Any] | None:
    """Return the frozen checksums, or None where the benchmark has none yet.

    Raises:
        CallError: The file cannot be read or belongs to another benchmark or version.
    """
    path = config.checksums
    if path is None or not path.is_file():
        return None
    try:
        document: dict[str, Any] = json.loads(path.read_text())
        belongs = document["name"], document["version"]
    except (ValueError, KeyError, TypeError) as error:
        raise CallError("the checksums cannot be read", path=path, found=str(error)) from error
    if belongs != (config.name, config.version):
        raise CallError(
            "the checksums belong to another benchmark",
            path=path,
            found=" ".join(map(str, belongs)),
            required=f"{config.name} {config.version}",
        )
    return document


def _what_differs(wanted: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    tables = [
        name for name, value in wanted["tables"].items() if found["tables"].get(name) != value
    ]
    if tables:
        return f"{len(tables)} of {len(wanted['tables'])} sequences, {tables[0]} first"
    return "its queries" if wanted["queries"] != found["queries"] else "its truth"
