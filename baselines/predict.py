"""The loop that turns any matcher into a submission."""

from __future__ import annotations

import multiprocessing
import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.matcher import (
    Answers,
    KeypointMatcher,
    Matcher,
    Matches,
    SplitMatcher,
    TrackMatcher,
)
from pliant.baselines.submission_file import (
    Keys,
    Kind,
    check_split,
    check_writable,
    query_keys,
    submission_footer,
    write_answers,
    write_matches,
    write_template,
)
from pliant.baselines.tracks import answer_tracks, tasks_by_source
from pliant.baselines.views import ViewReader
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.queries import QueryPair

__all__ = [
    "Keys",
    "Kind",
    "Prediction",
    "predict",
    "query_keys",
    "submission_footer",
    "write_answers",
    "write_matches",
    "write_template",
]

PAIRS_A_TASK: Final = 8
"""Neighbouring pairs share frames, so a worker takes a few at a time."""

Progress = Callable[[int, int], None]
"""Called with the pairs done and the pairs in all."""


@dataclass(frozen=True)
class Prediction:
    """What was written.

    Attributes:
        path: The submission.
        kind: `answers` or `matches`.
        method: The footer's facts of the method.
        pairs: Image pairs looked at.
        rows: Rows written.
    """

    path: Path
    kind: Kind
    method: dict[str, Any]
    pairs: int
    rows: int

    def as_dict(self) -> dict[str, Any]:
        """Return the prediction as a JSON object."""
        return {
            "submission": str(self.path),
            "kind": self.kind,
            "method": self.method,
            "pairs": self.pairs,
            "rows": self.rows,
        }


def predict(
    dataset: Dataset,
    split: str,
    matcher: Matcher | SplitMatcher,
    out: Path | str,
    kind: Kind = "answers",
    *,
    workers: int = 1,
    progress: Progress | None = None,
) -> Prediction:
    """Answer a split's queries with a matcher and write the submission.

    Images are read pair by pair and only the last few are kept; a `TrackMatcher` is shown every
    frame between the source and its targets in an episode. The bytes written depend on
    the dataset and the matcher alone, not on the number of workers.

    Args:
        dataset: The dataset.
        split: One of its splits with queries.
        matcher: The method.
        out: The Parquet file to write; an earlier submission there is replaced.
        kind: `answers` to the queries, or the method's own keypoint `matches`.
        workers: Processes, >= 1; more than one needs a matcher that can be pickled.
        progress: Told after every few pairs.

    Returns:
        What was written.

    Raises:
        CallError: The split has no queries, the method has no matches of its own, or the file
            cannot be written there.
        SpecError: A file of the dataset is broken.
        SubmissionError: The matcher gave something else than one finite answer a query.
    """
    _check_call(dataset, split, matcher, kind, workers)
    out = Path(out)
    check_writable(out)
    facts: dict[str, Any] = {**matcher.describe(), "name": matcher.name}
    if isinstance(matcher, SplitMatcher):
        keys = query_keys(dataset, split)
        answers = matcher.answer_split(dataset, split)
        _check_answers(answers, len(keys.pair_id), matcher.name, f"split {split}")
        write_answers(out, dataset, split, keys, answers, facts)
        return Prediction(out, kind, facts, len(np.unique(keys.pair_id)), len(keys.pair_id))

    pairs = dataset.pairs(split)
    with_mask = 0
    answered: list[Answers] = []
    matched: list[tuple[int, Matches]] = []
    done = 0
    for results in _run(dataset, matcher, kind, pairs, workers):
        for result, masked in results:
            with_mask += masked
            if isinstance(result, Answers):
                answered.append(result)
            else:
                matched.append((pairs[done].pair_id, result))
            done += 1
        if progress is not None:
            progress(done, len(pairs))
    # Whether a method was told where the object is changes what its score means.
    facts["mask"] = {0: "none", len(pairs): "given"}.get(with_mask, "partly given")
    if kind == "matches":
        write_matches(out, dataset, split, matched, facts)
        return Prediction(out, kind, facts, len(pairs), sum(len(m.score) for _, m in matched))
    keys = query_keys(dataset, split)
    write_answers(out, dataset, split, keys, _joined(answered, matcher.name), facts)
    return Prediction(out, kind, facts, len(pairs), len(keys.pair_id))


def _check_call(
    dataset: Dataset, split: str, matcher: Matcher | SplitMatcher, kind: Kind, workers: int
) -> None:
    check_split(dataset, split)
    if kind == "matches" and not isinstance(matcher, KeypointMatcher):
        raise CallError(
            f"the method {matcher.name!r} has no keypoint matches of its own",
            fix="Ask for --kind answers, or for sift, surf or orb",
        )
    if workers < 1:
        raise CallError("the number of workers is wrong", found=workers, required=">= 1")


_Result = tuple[Answers | Matches, bool]


class _Worker:
    """Answers pairs of one dataset with one matcher."""

    def __init__(self, dataset: Dataset, matcher: Matcher, kind: Kind) -> None:
        self._dataset = dataset
        self._matcher = matcher
        self._kind = kind
        self._reader = ViewReader(dataset)

    def run(self, pairs: Sequence[QueryPair]) -> list[_Result]:
        """Answer pairs; a `TrackMatcher` gets those of one source frame together."""
        source, target = pairs[0].source[0], pairs[0].target[0]
        if (
            self._kind == "answers"
            and isinstance(self._matcher, TrackMatcher)
            and source == target
            and self._dataset.sequence(target).temporal
        ):
            tracked = answer_tracks(self._matcher, self._reader, pairs)
            for (answers, _), pair in zip(tracked, pairs, strict=True):
                self._check(answers, pair)
            return [*tracked]
        return [self._one(pair) for pair in pairs]

    def _one(self, pair: QueryPair) -> _Result:
        source = self._reader.view(*pair.source)
        target = self._reader.view(*pair.target)
        masked = target.mask is not None
        if self._kind == "matches" and isinstance(self._matcher, KeypointMatcher):
            return self._matcher.match(source, target), masked
        answers = self._matcher.answer(source, target, pair.uv_a_px)
        self._check(answers, pair)
        return answers, masked

    def _check(self, answers: Answers, pair: QueryPair) -> None:
        _check_answers(answers, len(pair.uv_a_px), self._matcher.name, f"pair {pair.pair_id}")


_process_worker: _Worker | None = None  # set once in each worker process


def _start_process(address: str, pickled: bytes, kind: Kind) -> None:
    global _process_worker
    _process_worker = _Worker(Dataset.open(address), pickle.loads(pickled), kind)


def _run_in_process(pairs: Sequence[QueryPair]) -> list[_Result]:
    if _process_worker is None:
        raise RuntimeError("the worker process was not started")
    return _process_worker.run(pairs)


def _run(
    dataset: Dataset, matcher: Matcher, kind: Kind, pairs: Sequence[QueryPair], workers: int
) -> Iterator[list[_Result]]:
    """Yield the results of all pairs in order, a few pairs at a time."""
    tasks = _tasks(matcher, pairs, 1 if workers == 1 else PAIRS_A_TASK)
    if workers == 1:
        worker = _Worker(dataset, matcher, kind)
        for task in tasks:
            yield worker.run(task)
        return
    try:
        pickled = pickle.dumps(matcher)
    except Exception as error:
        raise CallError(
            f"the method {matcher.name!r} cannot be sent to worker processes ({error})",
            fix="Use one worker",
        ) from error
    executor = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_process,
        initargs=(dataset.address, pickled, kind),
    )
    try:
        yield from executor.map(_run_in_process, tasks)
    finally:
        executor.shutdown(cancel_futures=True)


def _tasks(
    matcher: Matcher, pairs: Sequence[QueryPair], most: int
) -> Sequence[Sequence[QueryPair]]:
    """Return what is answered at a time: so many pairs, or those a `TrackMatcher` carries on."""
    if isinstance(matcher, TrackMatcher):
        return tasks_by_source(pairs)
    return [pairs[start : start + most] for start in range(0, len(pairs), most)]


def _check_answers(answers: Answers, count: int, method: str, where: str) -> None:
    fields: dict[str, tuple[npt.NDArray[np.float32], tuple[int, ...]]] = {
        "uv_px": (answers.uv_px, (count, 2))
    }
    if answers.visible is not None:
        fields["visible"] = (answers.visible, (count,))
    if answers.sigma_px is not None:
        fields["sigma_px"] = (answers.sigma_px, (count,))
    for name, (values, shape) in fields.items():
        if values.shape != shape:
            raise SubmissionError(
                f"the method {method!r} answered in the wrong shape",
                where=f"{where}, {name}",
                found=values.shape,
                required=shape,
            )
        if not np.isfinite(values).all():
            raise SubmissionError(
                f"the method {method!r} gave a value that is not finite",
                where=f"{where}, {name}",
                found=f"{int((~np.isfinite(values)).sum())} of {values.size}",
                required="one finite answer for every query",
            )
    if answers.modes is not None and len(answers.modes) != count:
        raise SubmissionError(
            f"the method {method!r} answered in the wrong shape",
            where=f"{where}, modes",
            found=len(answers.modes),
            required=count,
        )


def _joined(parts: Sequence[Answers], method: str) -> Answers:
    """Join the answers of all pairs; an optional field must be there for all or for none."""
    for name in ("visible", "sigma_px", "modes"):
        if len({getattr(part, name) is None for part in parts}) > 1:
            raise SubmissionError(
                f"the method {method!r} gave {name} for some pairs and not for others"
            )
    first = parts[0] if parts else Answers(np.zeros((0, 2), dtype=np.float32))
    return Answers(
        uv_px=np.concatenate([part.uv_px for part in parts]) if parts else first.uv_px,
        visible=(
            None
            if first.visible is None
            else np.concatenate([part.visible for part in parts if part.visible is not None])
        ),
        sigma_px=(
            None
            if first.sigma_px is None
            else np.concatenate([part.sigma_px for part in parts if part.sigma_px is not None])
        ),
        modes=(
            None if first.modes is None else [row for part in parts for row in part.modes or []]
        ),
    )
