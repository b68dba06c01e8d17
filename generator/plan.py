"""The tasks of a run: one sequence each, and which of them a folder already holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pliant.generator.config import GenerateConfig
from pliant.spec.layout import SEQUENCE_JSON, SEQUENCES_DIR, sequence_dir


@dataclass(frozen=True)
class SequenceTask:
    """One sequence to make: the unit of work, of retry and of resume.

    Attributes:
        tier: Tier name.
        split: Split the sequence belongs to.
        index: Index of the sequence in its tier and split, >= 0.
    """

    tier: str
    split: str
    index: int

    @property
    def id(self) -> str:
        """The sequence's id, and its folder's name."""
        return f"{self.tier}-{self.split}-{self.index:06d}"

    def folder(self, root: Path) -> Path:
        """Return the sequence's folder in a dataset."""
        return sequence_dir(root, self.tier, self.id)


@dataclass(frozen=True)
class Plan:
    """What a run has to do.

    Attributes:
        tasks: Every sequence of the dataset, in the order of `sequences.parquet`.
        finished: Ids that the folder already holds.
        frames_per_sequence: Frames of each sequence.
    """

    tasks: tuple[SequenceTask, ...]
    finished: frozenset[str]
    frames_per_sequence: int

    @property
    def missing(self) -> list[SequenceTask]:
        """The sequences still to be made, in an order that brings every tier along.

        An interrupted run thus holds some of each tier and split.
        """
        tasks = [task for task in self.tasks if task.id not in self.finished]
        return sorted(tasks, key=lambda task: task.index)  # stable: tiers and splits alternate

    @property
    def frames(self) -> int:
        """Frames of the whole dataset."""
        return len(self.tasks) * self.frames_per_sequence


def plan_run(config: GenerateConfig, root: Path) -> Plan:
    """Compare a config with what its folder holds.

    A sequence counts as finished when its folder stands under its final name with its
    `sequence.json`: folders are renamed into place complete, or not at all.

    Args:
        config: The dataset's config.
        root: The dataset's folder, which need not exist.
    """
    tasks = plan_tasks(config)
    finished: set[str] = set()
    for tier in config.tiers:
        folder = root / SEQUENCES_DIR / tier
        if folder.is_dir():
            finished.update(p.name for p in folder.iterdir() if (p / SEQUENCE_JSON).is_file())
    return Plan(tasks, frozenset(finished & {task.id for task in tasks}), config.frames)


def plan_tasks(config: GenerateConfig) -> tuple[SequenceTask, ...]:
    """Return every sequence of a config, by tier, split and index."""
    return tuple(
        SequenceTask(tier, split, index)
        for tier in config.tiers
        for split, count in config.counts.items()
        for index in range(count)
    )


def first_of_each_tier(tasks: Sequence[SequenceTask]) -> list[SequenceTask]:
    """Return one task per tier, the first in order."""
    return list({task.tier: task for task in reversed(tasks)}.values())[::-1]
