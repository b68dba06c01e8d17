"""Which sequence is made, and the catalogue of random streams that its numbers come from."""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np

from pliant.spec.secrets import GUESSABLE_BELOW
from pliant.spec.storage.layout import sequence_name


class Stream(StrEnum):
    """What random numbers are for; drawing more from one stream never changes another.

    The values are part of every dataset's definition: they enter the seed of the stream.
    """

    ROPE_SHAPE = "rope shape"  # which shape the sequence has
    ROPE_PROPORTIONS = "rope proportions"  # of a sequence, where the settings give ranges
    ROPE_CONFIGURATION = "rope configuration"  # per frame: control points, heights, roll
    ROPE_EPISODE = "rope episode"  # start and actions
    CLOTH_CONFIGURATION = "actions"  # per frame: what is done to the cloth
    CLOTH_EPISODE = "episode"  # start and actions
    GRIPPER = "gripper"  # direction and steepness of its arm
    DISTRACTORS = "distractors"  # what there is, and per frame where it is
    CAMERA = "camera"
    APPEARANCE = "look"  # light, and the material where sequences do not share materials
    MATERIAL = "material"  # of a numbered material of a tier, which all its splits share
    DEPTH_CAMERA = "depth-camera"  # per frame: faults of the style `real-depth`
    NOISE = "noise"  # per frame: image noise
    QUERY_PAIRS = "queries"  # image pairs of a sequence, and the order of their rows
    QUERY_POINTS = "query-points"  # per source frame: points asked
    QUERY_CLASSES = "query-classes"  # division of the material points


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
        return root / sequence_name(self.tier, self.id)


@dataclass(frozen=True)
class RandomStreams:
    """Every random number of one sequence.

    Attributes:
        seed: The dataset's seed, 0 to 2^128 - 1; 0 is a seed like any other. One of 64 bits or
            more is secret: its streams are derived by HMAC-SHA256, so that none gives another away.
        task: The sequence.
    """

    seed: int = field(repr=False)
    task: SequenceTask

    def generator(self, stream: Stream, frame: int | None = None) -> np.random.Generator:
        """Return the generator of one stream of one frame, or of the whole sequence.

        Args:
            stream: What the numbers are for.
            frame: Frame index, or None for a stream of the whole sequence.

        Returns:
            A new generator that depends on seed, task, frame and stream alone.
        """
        task = self.task
        place = 0 if frame is None else frame + 1
        if self.seed >= GUESSABLE_BELOW:
            # Published sequences must not lead back to the seed of the held-out ones.
            text = f"{task.tier}/{task.split}/{task.index}/{place}/{stream.value}"
            key = hmac.digest(self.seed.to_bytes(16, "big"), text.encode(), "sha256")
            return np.random.default_rng(int.from_bytes(key, "big"))
        entropy = [
            *(self.seed, _word(task.tier), _word(task.split), task.index, place),
            _word(stream.value),
        ]
        return np.random.default_rng(np.random.SeedSequence(entropy))

    def material(self, number: int) -> np.random.Generator:
        """Return the generator of one of the numbered materials of the sequence's tier."""
        shared = RandomStreams(self.seed, SequenceTask(self.task.tier, "", number))
        return shared.generator(Stream.MATERIAL)


def weighted_choice(rng: np.random.Generator, weights: Mapping[str, float]) -> str:
    """Draw a name by its weight; names without a weight are never drawn."""
    names = sorted(name for name, weight in weights.items() if weight > 0)
    shares = np.array([weights[name] for name in names])
    return names[int(rng.choice(len(names), p=shares / shares.sum()))]


def _word(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")
