"""The loop that turns any matcher into answers, and answers into a submission."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pliant.baselines.adapters import as_matcher
from pliant.baselines.answering import answer_pairs
from pliant.baselines.answers import checked_answers, joined
from pliant.baselines.matcher import KeypointMatcher, Matcher, SplitMatcher, familiarity_summary
from pliant.baselines.submission_file import (
    Keys,
    Kind,
    answers_table,
    check_method_name,
    check_split,
    check_writable,
    query_keys,
    write_answers,
    write_matches,
)
from pliant.spec.answers import Answers, Matches
from pliant.spec.calls import PATH, check_type
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.progress import Progress


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


@dataclass(frozen=True, repr=False)
class SplitAnswers:
    """A method's answers to the queries of a split, in memory.

    Attributes:
        dataset: The dataset.
        split: The split.
        keys: Which queries, in the order of the queries file.
        answers: One answer per query.
        method: JSON-able facts of the method, with its `name`.
        pairs: Number of image pairs.
    """

    dataset: Dataset
    split: str
    keys: Keys
    answers: Answers
    method: dict[str, Any]
    pairs: int

    def to_table(self) -> pa.Table:
        """Return the answers as the table of a submission."""
        return answers_table(self.keys, self.answers)

    def write(self, out: Path | str) -> Path:
        """Write the answers as a submission and return its path.

        Raises:
            CallError: The file cannot be written there.
        """
        check_type("out", out, PATH, required="the path of a Parquet file")
        write_answers(out, self.dataset, self.split, self.keys, self.answers, self.method)
        return Path(out)

    def __len__(self) -> int:
        return len(self.keys.pair_id)

    def __repr__(self) -> str:
        return (
            f"SplitAnswers({self.method['name']!r}: {len(self)} answers for {self.pairs} pairs "
            f"of {self.dataset.id}/{self.split})"
        )


def answer(
    dataset: Dataset,
    split: str,
    matcher: Matcher | SplitMatcher,
    *,
    workers: int = 1,
    masks: bool = True,
    progress: Progress | None = None,
) -> SplitAnswers:
    """Answer a split's queries with a matcher, in memory; see `predict`."""
    matcher = as_matcher(matcher)
    _check_call(dataset, split, matcher, "answers", workers)
    facts = _facts(matcher)
    keys = query_keys(dataset, split)
    if isinstance(matcher, SplitMatcher):
        whole = matcher.answer_split(dataset, split)
        answers = checked_answers(whole, len(keys.pair_id), matcher.name, f"split {split}")
        return SplitAnswers(dataset, split, keys, answers, facts, len(np.unique(keys.pair_id)))
    results, facts["mask"] = _results(
        dataset, split, matcher, "answers", workers, progress, masks=masks
    )
    answers = joined([each for each in results if isinstance(each, Answers)], matcher.name)
    if answers.familiarity is not None and len(answers.familiarity):
        facts["familiarity"] = familiarity_summary(answers.familiarity)
    return SplitAnswers(dataset, split, keys, answers, facts, len(results))


def predict(
    dataset: Dataset,
    split: str,
    matcher: Matcher | SplitMatcher,
    out: Path | str,
    kind: Kind = "answers",
    *,
    workers: int = 1,
    masks: bool = True,
    progress: Progress | None = None,
) -> Prediction:
    """Answer a split's queries with a matcher and write the submission.

    Images are read pair by pair and only the last few are kept; a `TrackMatcher` is shown every
    frame between the source and its targets in an episode. The bytes written depend on
    the dataset and the matcher alone, not on the number of workers.

    Args:
        dataset: The dataset.
        split: One of its splits with queries.
        matcher: The method, or what `as_matcher` makes one of.
        out: The Parquet file to write; an earlier submission there is replaced.
        kind: `answers` to the queries, or the method's own keypoint `matches`.
        workers: Processes, >= 1; more than one needs a matcher that can be pickled.
        masks: Whether the method is given the masks of the dataset; a `SplitMatcher` reads for
            itself. The footer says `mask: none` where it was given none.
        progress: Called after every few pairs.

    Returns:
        What was written.

    Raises:
        CallError: The split has no queries, the method has no matches of its own, or the file
            cannot be written there.
        SpecError: A file of the dataset is broken.
        SubmissionError: The matcher gave something else than one finite answer a query.
    """
    matcher = as_matcher(matcher)
    _check_call(dataset, split, matcher, kind, workers)
    out = Path(out)
    check_writable(out)
    if kind == "answers":
        found = answer(dataset, split, matcher, workers=workers, masks=masks, progress=progress)
        return Prediction(found.write(out), kind, found.method, found.pairs, len(found))
    assert not isinstance(matcher, SplitMatcher)  # _check_call refuses it for matches
    facts = _facts(matcher)
    results, facts["mask"] = _results(dataset, split, matcher, kind, workers, progress, masks=masks)
    matches = [each for each in results if isinstance(each, Matches)]
    numbers = np.unique(query_keys(dataset, split).pair_id).tolist()
    write_matches(out, dataset, split, list(zip(numbers, matches, strict=True)), facts)
    return Prediction(out, kind, facts, len(results), sum(len(each.score) for each in matches))


def _facts(matcher: Matcher | SplitMatcher) -> dict[str, Any]:
    """Return what the footer says of a method; asked before the work, which would be lost."""
    try:
        facts = {**matcher.describe(), "name": matcher.name}
        stored: dict[str, Any] = json.loads(json.dumps(facts, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise CallError(
            f"the footer cannot store what `describe` of {matcher.name!r} returned",
            found=error,
            required="a dictionary of texts, finite numbers, lists and dictionaries",
        ) from error
    return stored


def _results(
    dataset: Dataset,
    split: str,
    matcher: Matcher,
    kind: Kind,
    workers: int,
    progress: Progress | None,
    *,
    masks: bool,
) -> tuple[list[Answers | Matches], str]:
    """Return what a method found for every pair, and whether it was given masks."""
    total = len(np.unique(query_keys(dataset, split).pair_id))
    found: list[Answers | Matches] = []
    with_mask = 0
    for results in answer_pairs(dataset, split, matcher, kind, workers, masks=masks):
        for result, masked in results:
            with_mask += masked
            found.append(result)
        if progress is not None:
            progress(len(found), total)
    # Whether a method was given where the object is changes what its score means.
    return found, {0: "none", len(found): "given"}.get(with_mask, "partly given")


def _check_call(
    dataset: Dataset, split: str, matcher: Matcher | SplitMatcher, kind: Kind, workers: int
) -> None:
    check_split(dataset, split)
    check_method_name(matcher.name)
    if kind == "matches" and not isinstance(matcher, KeypointMatcher):
        raise CallError(
            f"the method {matcher.name!r} has no keypoint matches of its own",
            fix="Ask for --kind answers, or for a local feature such as sift or orb",
        )
    if workers < 1:
        raise CallError("invalid number of workers", found=workers, required=">= 1")
