"""Drawing the benchmark's queries: pairs of frames, and the material points they ask.

What a pair asks depends on its source frame alone; with `moving_share` also on which points move
in the episode.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from pliant.generator.seeding import RandomStreams, SequenceTask, Stream
from pliant.spec.arrays import Float32Array, IntArray

_CLASSES: Final = 4

MOVING_PX: Final = 4.0
"""A point that is nowhere farther than this from its place in the source does not move."""


class FrameTask(NamedTuple):
    """A frame of one of the sequences that are made."""

    task: SequenceTask
    frame: int

    def point_class(self, frames: int) -> int:
        """Return the class of the material points that this frame may ask.

        Frame 0 is alone in its class, so that it can be paired with every other frame.

        Args:
            frames: Frames of its sequence.
        """
        if frames == 1:
            return self.task.index % _CLASSES
        return 0 if self.frame == 0 else 1 + (self.frame - 1) % (_CLASSES - 1)


@dataclass(frozen=True)
class Tracks:
    """The tables of a sequence, one row per frame, as queries need them.

    Attributes:
        uv_px: float32 (F, P, 2).
        visibility: object (F, P), states.
        boxes_px: per frame the visible box of the queried object, or None.
    """

    uv_px: Float32Array
    visibility: npt.NDArray[np.object_]
    boxes_px: list[list[int] | None]


def point_classes(seed: int, source: FrameTask, frames: int, partners: IntArray) -> IntArray:
    """Divide the material points at random into classes of nearly equal size.

    Sequences of several frames, whose pairs stay within the sequence, have a division each.
    Single frames of a tier and split, which are paired with each other, share one. A point and
    its symmetric partners are in one class.

    Args:
        seed: The dataset's seed.
        source: A frame.
        frames: Frames of its sequence.
        partners: int64 (P, S), per symmetry the point that each is mapped to.

    Returns:
        int64 (P,), 0 to 3.
    """
    task = replace(source.task, index=0) if frames == 1 else source.task
    rng = RandomStreams(seed, task).generator(Stream.QUERY_CLASSES)
    count = len(partners)
    orbits = np.column_stack([np.arange(count), partners]).min(axis=1)
    label = np.zeros(count, np.int64)
    distinct = np.unique(orbits)
    label[distinct] = rng.permutation(len(distinct)) % _CLASSES
    return label[orbits]


def draw_points(
    rng: np.random.Generator,
    source: Tracks,
    frame: int,
    asked: IntArray,
    most: int,
    targets: Sequence[int] = (),
    moving_share: float = 0.0,
) -> IntArray:
    """Draw the points that a source frame is asked at.

    Args:
        rng: Source of randomness.
        source: Tracks of its sequence.
        frame: The source frame.
        asked: Ids of the points that may be asked.
        most: Points wanted.
        targets: Frames of the sequence that the source will be asked in.
        moving_share: At least this share of the points moves by more than 4 px to one of them.

    Returns:
        int64 (N,), ids of points the frame sees, in random order; fewer than wanted where there
        are no more, or where too few move.
    """
    visible = rng.permutation(asked[source.visibility[frame, asked] == "visible"])
    if not moving_share:
        return visible[:most]
    offsets = source.uv_px[np.array(targets)][:, visible] - source.uv_px[frame, visible]
    moves = (np.hypot(offsets[..., 0], offsets[..., 1]) > MOVING_PX).any(axis=0)
    first = visible[moves][: math.ceil(moving_share * most)]
    others = visible[~np.isin(visible, first)]
    total = min(most, math.floor(len(first) / moving_share))
    return rng.permutation(np.concatenate([first, others[: total - len(first)]]))


def skip_pairs(
    rng: np.random.Generator, target: SequenceTask, frames: int, skips: Sequence[int]
) -> Iterator[tuple[FrameTask, FrameTask]]:
    """Yield frames of an episode with the frames that are `skips` later; no target is a source.

    Args:
        rng: Source of randomness.
        target: The episode.
        frames: Its frames, more than the longest skip.
        skips: Frames between source and target.
    """
    sources: set[int] = set()
    targets: set[int] = set()
    for frame in rng.permutation(frames - max(skips)).tolist():
        later = {frame + skip for skip in skips}
        if frame in targets or later & sources:
            continue
        sources.add(frame)
        targets |= later
        for skip in skips:
            yield FrameTask(target, frame), FrameTask(target, frame + skip)


def frame_pairs(
    rng: np.random.Generator,
    target: SequenceTask,
    members: Sequence[SequenceTask],
    frames: int,
    wanted: int,
) -> Iterator[tuple[FrameTask, FrameTask]]:
    """Yield candidate (source, target) frames of different classes, more than wanted.

    No pair is repeated.

    Args:
        rng: Source of randomness.
        target: The sequence of the targets.
        members: All sequences of its tier and split.
        frames: Frames of the target's sequence.
        wanted: Pairs the caller will take.
    """
    if frames == 1:
        own = FrameTask(target, 0)
        sources = [FrameTask(task, 0) for task in members]
        others = [each for each in sources if each.point_class(1) != own.point_class(1)]
        for k in rng.permutation(len(others)):
            yield others[k], own
        return
    seen: set[tuple[int, int]] = set()
    # Half of the pairs: from frame 0 to frames spread over the sequence, two neighbours from
    # each stretch.
    edges = np.linspace(1, frames, num=(wanted + 2) // 4 + 1).astype(int)
    for low, high in pairwise(edges):
        if high > low:
            first = int(rng.integers(low, max(high - 1, low + 1)))
            seen |= {(0, first), (0, min(first + 1, high - 1))}
    for a, b in sorted(seen):
        yield FrameTask(target, a), FrameTask(target, b)
    for _ in range(20 * wanted):
        a, b = (int(k) for k in rng.choice(frames, size=2, replace=False))
        pair = FrameTask(target, a), FrameTask(target, b)
        if (a, b) not in seen and pair[0].point_class(frames) != pair[1].point_class(frames):
            seen.add((a, b))
            yield pair
