"""Runs a matcher over image pairs, in this process or in several."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Final

import numpy as np

from pliant.baselines.answers import checked_answers, checked_matches, placed_errors
from pliant.baselines.matcher import KeypointMatcher, Matcher, SharingMatcher, TrackMatcher
from pliant.baselines.submission_file import Kind
from pliant.baselines.tracks import answer_tracks, tasks_by_source
from pliant.spec.answers import Answers, Matches
from pliant.spec.cores import cpu_cores
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.queries import QueryPair

PAIRS_PER_TASK: Final = 8
"""Neighbouring pairs share frames, so a worker takes a few at a time."""

Result = tuple[Answers | Matches, bool]
"""What a method found for a pair, and whether it was given the target's mask."""


class _Worker:
    """Answers the pairs of one split with one matcher."""

    def __init__(
        self, pairs: Sequence[QueryPair], matcher: Matcher, kind: Kind, masks: bool
    ) -> None:
        self._pairs = pairs
        self._matcher = matcher
        self._kind = kind
        self._masks = masks

    def run(self, task: range) -> list[Result]:
        """Answer pairs; a `TrackMatcher` gets those of one source frame together."""
        pairs = self._pairs[task.start : task.stop]
        source, target = pairs[0].source.sequence, pairs[0].target.sequence
        if (
            self._kind == "answers"
            and isinstance(self._matcher, TrackMatcher)
            and source.id == target.id
            and target.temporal
        ):
            with self._placed(pairs):
                return [*answer_tracks(self._matcher, pairs, masks=self._masks)]
        return [self._one(pair) for pair in pairs]

    def _placed(self, pairs: Sequence[QueryPair]) -> AbstractContextManager[None]:
        first, last = pairs[0], pairs[-1]
        further = "" if first is last else f" to {last.pair_id}"
        place = f"pair {first.pair_id}{further}, from {first.source.key} to {last.target.key}"
        return placed_errors(self._matcher.name, place)

    def _one(self, pair: QueryPair) -> Result:
        seen = pair.seen(masks=self._masks)
        masked = seen.target.mask is not None
        name, place = self._matcher.name, f"pair {pair.pair_id}"
        if self._kind == "matches" and isinstance(self._matcher, KeypointMatcher):
            with self._placed([pair]):
                matches = self._matcher.match(seen.source, seen.target)
            return checked_matches(matches, name, place), masked
        with self._placed([pair]):
            found = self._matcher.answer(seen)
        return checked_answers(found, len(pair), name, place), masked


_process_worker: _Worker | None = None  # set once in each worker process


def _start_process(
    address: str, split: str, pickled: bytes, kind: Kind, masks: bool, workers: int
) -> None:
    global _process_worker
    # Torch, which a matcher brings, would use all cores in every process.
    os.environ.setdefault("OMP_NUM_THREADS", str(max(1, cpu_cores() // workers)))
    pairs = Dataset.open(address).pairs(split)
    _process_worker = _Worker(pairs, pickle.loads(pickled), kind, masks)


def _run_in_process(task: range) -> list[Result]:
    assert _process_worker is not None  # _start_process has run
    return _process_worker.run(task)


def answer_pairs(
    dataset: Dataset, split: str, matcher: Matcher, kind: Kind, workers: int, *, masks: bool = True
) -> Iterator[list[Result]]:
    """Yield the results of a split's pairs in order, a few pairs at a time.

    Args:
        dataset: The dataset.
        split: One of its splits with queries.
        matcher: The method.
        kind: `answers` to the queries, or the method's own keypoint `matches`.
        workers: Number of processes; more than one needs a matcher that can be pickled.
        masks: Whether the matcher is given masks.

    Raises:
        CallError: The matcher cannot be pickled, or a worker process ends.
        SpecError: A file of the dataset is damaged.
        SubmissionError: The matcher returned something else than one finite answer per query.
    """
    pairs = dataset.pairs(split)
    tasks = _tasks(matcher, pairs, 1 if workers == 1 else PAIRS_PER_TASK)
    if workers == 1:
        worker = _Worker(pairs, matcher, kind, masks)
        for task in tasks:
            yield worker.run(task)
        return
    with tempfile.TemporaryDirectory(prefix="pliant-predict-") as folder:
        if isinstance(matcher, SharingMatcher):
            copied: SharingMatcher = pickle.loads(_pickled(matcher))
            copied.share(Path(folder))  # the caller's outlives the folder
            matcher = copied
        executor = ProcessPoolExecutor(
            workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_process,
            initargs=(
                dataset.address,
                split,
                _pickled(matcher),
                kind,
                masks,
                workers,
            ),
        )
        try:
            yield from executor.map(_run_in_process, tasks)
        except BrokenProcessPool as error:
            raise CallError(
                f"a worker process of the method {matcher.name!r} ended too early",
                fix="Define the method in a file that can be imported, not in a notebook; if "
                "memory ran out, use fewer workers.",
            ) from error
        except BaseException:
            for process in [*executor._processes.values()]:
                process.terminate()  # a task may take minutes
            raise
        finally:
            executor.shutdown(cancel_futures=True)


def _pickled(matcher: Matcher) -> bytes:
    try:
        return pickle.dumps(matcher)
    except Exception as error:
        raise CallError(
            f"the method {matcher.name!r} cannot be sent to worker processes ({error})",
            fix="Use one worker",
        ) from error


def _tasks(matcher: Matcher, pairs: Sequence[QueryPair], most: int) -> list[range]:
    """Return the places of the pairs answered together: those of one track, or so many."""
    if not isinstance(matcher, TrackMatcher):
        return [range(at, min(at + most, len(pairs))) for at in range(0, len(pairs), most)]
    stops = np.cumsum([len(run) for run in tasks_by_source(pairs)]).tolist()
    return [range(start, stop) for start, stop in zip([0, *stops], stops, strict=False)]
