"""Answering pairs of one episode by carrying points through the frames between."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

import numpy as np
import numpy.typing as npt

from pliant.baselines.answers import checked_answers
from pliant.baselines.matcher import TrackMatcher
from pliant.spec.answers import Answers
from pliant.spec.errors import SubmissionError
from pliant.spec.frame import Frame
from pliant.spec.queries import QueryPair


def tasks_by_source(pairs: Sequence[QueryPair]) -> list[list[QueryPair]]:
    """Part pairs into runs with the same source frame and target sequence, in their order.

    Args:
        pairs: In the order of the queries.
    """
    runs = groupby(pairs, key=lambda pair: (pair.source.key, pair.target.sequence.id))
    return [list(run) for _, run in runs]


def answer_tracks(
    matcher: TrackMatcher, pairs: Sequence[QueryPair], *, masks: bool = True
) -> list[tuple[Answers, bool]]:
    """Answer pairs of one source frame and one episode, each frame between looked at once.

    The points of all pairs are carried together; forward and backward in time are two tracks.

    Args:
        matcher: The method.
        pairs: One run of `tasks_by_source`, source and target in the same episode.
        masks: Whether the method is given masks.

    Returns:
        For each pair its answers and whether the target's mask was given.
    """
    results: list[tuple[Answers, bool] | None] = [None] * len(pairs)
    sequence, start = pairs[0].source.sequence, pairs[0].source.index
    for direction in (1, -1):
        asked = {
            number: pair
            for number, pair in enumerate(pairs)
            if (1 if pair.target.index >= start else -1) == direction
        }
        if not asked:
            continue
        uv_px, rows = _united([pair.uv_a_px for pair in asked.values()])
        wanted: dict[int, list[tuple[int, npt.NDArray[np.int64]]]] = {}
        for (number, pair), own in zip(asked.items(), rows, strict=True):
            wanted.setdefault(pair.target.index, []).append((number, own))
        last = max(wanted, key=lambda frame: abs(frame - start))
        frames = range(start, last + direction, direction)
        masked: list[bool] = []

        def views(frames: range = frames, masked: list[bool] = masked) -> Iterator[Frame]:
            for frame in frames:
                view = sequence[frame]
                masked.append(masks and view.mask is not None)
                yield view.replace() if masks else view.without_masks()

        for number, _ in wanted.get(start, ()):  # a frame paired with itself
            seen = masks and sequence[start].mask is not None
            results[number] = (Answers(pairs[number].uv_a_px.copy()), seen)
        step, tracks = 0, matcher.track(views(), uv_px)
        if not isinstance(tracks, Iterable):
            raise SubmissionError(
                f"the method {matcher.name!r} tracked no frames",
                where=f"sequence {sequence.id}, frames {start} to {last}",
                found=type(tracks).__name__,
                required="one `Answers` for each frame after the first, yielded or in a list",
            )
        for step, found in enumerate(tracks, start=1):
            if step == len(frames):
                break
            place = f"frame {sequence[frames[step]].key}"
            answers = checked_answers(found, len(uv_px), matcher.name, place)
            for number, own in wanted.get(frames[step], ()):
                results[number] = (answers.rows(own), masked[step])
        if step != len(frames) - 1:
            raise SubmissionError(
                f"the method {matcher.name!r} tracked another number of frames",
                where=f"sequence {sequence.id}, frames {start} to {last}",
                found=f"answers for {'more' if step == len(frames) else step}",
                required=f"{len(frames) - 1}: one `Answers` for each frame after the first",
            )
    return [result for result in results if result is not None]


def _united(
    points: Sequence[npt.NDArray[np.float32]],
) -> tuple[npt.NDArray[np.float32], list[npt.NDArray[np.int64]]]:
    """Return all different points, (N, 2), and which of them each set consists of."""
    number: dict[bytes, int] = {}
    rows = [
        np.array([number.setdefault(uv.tobytes(), len(number)) for uv in part], dtype=np.int64)
        for part in points
    ]
    every = np.frombuffer(b"".join(number), dtype=np.float32).reshape(-1, 2)
    return every, rows
