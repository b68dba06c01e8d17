"""Every random number comes from (seed, tier, split, sequence, frame) and a stream's name."""

from __future__ import annotations

import hashlib

import numpy as np


def _word(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def random_generator(
    seed: int, tier: str, split: str, sequence: int, frame: int | None = None, *, stream: str
) -> np.random.Generator:
    """Return the generator of one stream of one frame (or of a whole sequence).

    Args:
        seed: The dataset's seed, >= 0; 0 is a seed like any other.
        tier: Tier name.
        split: Split name.
        sequence: Index of the sequence in its tier and split, >= 0.
        frame: Frame index, or None for what holds over the sequence.
        stream: What the numbers are for (`shape`, `look`, `camera`, `noise` …), so that
            drawing more of one never changes another.

    Returns:
        A generator that depends on these values alone.
    """
    if seed < 0 or sequence < 0:
        raise ValueError("seed and sequence must be >= 0")
    entropy = [
        seed,
        _word(tier),
        _word(split),
        sequence,
        0 if frame is None else frame + 1,
        _word(stream),
    ]
    return np.random.default_rng(np.random.SeedSequence(entropy))
