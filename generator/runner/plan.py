"""The tasks of a run: one sequence each, and which of them a folder already holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from pliant.generator.config import GenerateConfig
from pliant.generator.seeding import SequenceTask
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage.layout import SEQUENCE_JSON


@dataclass(frozen=True)
class Plan:
    """What a run has to do.

    Attributes:
        tasks: Every sequence of the dataset, in the order of `sequences.parquet`.
        finished: Ids that the folder already contains, whole.
        frames: Frames of the whole dataset.
        damaged: First damaged file of each sequence that has to be made again, with the reason.
    """

    tasks: tuple[SequenceTask, ...]
    finished: frozenset[str]
    frames: int
    damaged: Mapping[str, str] = field(default_factory=dict)

    @property
    def missing(self) -> list[SequenceTask]:
        """The sequences still to be made, in an order that brings every tier along.

        An interrupted run thus contains some of each tier and split.
        """
        tasks = [task for task in self.tasks if task.id not in self.finished]
        return sorted(tasks, key=lambda task: task.index)  # stable: tiers and splits alternate


def plan_run(config: GenerateConfig, root: Path) -> Plan:
    """Compare a config with what its folder contains.

    A sequence is finished when its folder has a `sequence.json` and every file that this lists,
    with the listed size and checksum. Others are made again.

    Args:
        config: The dataset's config.
        root: The dataset's folder, which need not exist.
    """
    tasks = plan_tasks(config)
    present = [task for task in tasks if (task.folder(root) / SEQUENCE_JSON).is_file()]
    # Hashing releases the interpreter lock.
    with ThreadPoolExecutor() as pool:
        found = pool.map(first_damage, (task.folder(root) for task in present))
        damaged = {
            task.id: damage
            for task, damage in zip(present, found, strict=True)
            if damage is not None
        }
    finished = frozenset(task.id for task in present) - damaged.keys()
    return Plan(tasks, finished, len(tasks) * config.frames, damaged)


def first_damage(folder: Path) -> str | None:
    """Return what is wrong with a sequence's files, None if they are as `sequence.json` lists.

    All sizes are compared before the first checksum.

    Args:
        folder: The sequence's folder.
    """
    try:
        document = json.loads((folder / SEQUENCE_JSON).read_text(encoding="utf-8"))
        files = [(str(e["path"]), e["bytes"], e["sha256"]) for e in document["files"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        return f"{SEQUENCE_JSON} cannot be read: {error}"
    for name, size, _ in files:
        path = folder / name
        if not path.is_file():
            return f"{name} is missing"
        if path.stat().st_size != size:
            return f"{name} has {path.stat().st_size} bytes; {SEQUENCE_JSON} lists {size}"
    for name, _, sha256 in files:
        if sha256_file(folder / name) != sha256:
            return f"{name} has another sha256 than {SEQUENCE_JSON} lists"
    return None


def plan_tasks(config: GenerateConfig) -> tuple[SequenceTask, ...]:
    """Return every sequence of a config, by tier, split and index."""
    return tuple(
        SequenceTask(tier, split, index)
        for tier in config.tiers
        for split, count in config.counts.items()
        for index in range(count)
    )
