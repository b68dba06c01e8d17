"""Answering pairs of one episode by carrying points through the frames between."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from pliant.baselines.matcher import Answers, TrackMatcher, View
from pliant.baselines.views import ViewReader
from pliant.spec.queries import QueryPair
from pliant.spec.sequence import SequenceRecord


def tasks_by_source(pairs: Sequence[QueryPair]) -> list[list[QueryPair]]:
    """Part pairs into runs with the same source frame and target sequence, in their order.

    Args:
        pairs: In the order of the queries.
    """
    runs = groupby(pairs, key=lambda pair: (pair.source.key, pair.target.sequence.id))
    return [list(run) for _, run in runs]


def answer_tracks(
    matcher: TrackMatcher, reader: ViewReader, pairs: Sequence[QueryPair]
) -> list[tuple[Answers, bool]]:
    """Answer pairs of one source frame and one episode, each frame between looked at once.

    Forward and backward in time are two tracks; so are pairs that ask other points.

    Args:
        matcher: The method.
        reader: Reads the episode's frames.
        pairs: One run of `tasks_by_source`, source and target in the same episode.

    Returns:
        For each pair its answers and whether the target's mask was given.
    """
    results: list[tuple[Answers, bool] | None] = [None] * len(pairs)
    tracks: dict[tuple[int, bytes], dict[int, list[int]]] = {}
    for number, pair in enumerate(pairs):
        direction = 1 if pair.target.index >= pair.source.index else -1
        wanted = tracks.setdefault((direction, pair.uv_a_px.tobytes()), {})
        wanted.setdefault(pair.target.index, []).append(number)
    for (direction, _), wanted in tracks.items():
        any_pair = pairs[next(iter(wanted.values()))[0]]
        sequence, start = any_pair.source.sequence, any_pair.source.index
        last = max(wanted, key=lambda frame: abs(frame - start))
        frames = range(start, last + direction, direction)
        masked: list[bool] = []

        def views(
            sequence: SequenceRecord = sequence,
            frames: range = frames,
            masked: list[bool] = masked,
        ) -> Iterator[View]:
            for frame in frames:
                view = reader.view(sequence[frame])
                masked.append(view.mask is not None)
                yield view

        for number in wanted.get(start, ()):  # a frame paired with itself
            seen = reader.view(sequence[start]).mask is not None
            results[number] = (Answers(any_pair.uv_a_px.copy()), seen)
        tracked = matcher.track(views(), any_pair.uv_a_px)
        for step, answers in enumerate(tracked, start=1):
            for number in wanted.get(frames[step], ()):
                results[number] = (answers, masked[step])
    return [result for result in results if result is not None]
