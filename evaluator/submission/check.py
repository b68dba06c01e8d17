"""Lists what is wrong with a submission, without scoring it."""

from __future__ import annotations

from pathlib import Path

from pliant.evaluator.submission.answers import Answers, Scratch
from pliant.evaluator.submission.hints import hints_without_truth
from pliant.evaluator.submission.loading import load
from pliant.evaluator.submission.problems import Problems
from pliant.spec.dataset import Dataset
from pliant.spec.errors import Issue


def check(
    submission: Path | str,
    data: Dataset | Path | str,
    truth: Path | str | None = None,
    *,
    allow_missing: bool = False,
) -> list[Issue]:
    """Return every problem of a submission; an empty list means that it can be scored.

    Reading, checking and placing rows is the same code that `evaluate` runs.

    Args:
        submission: The submission's file.
        data: The dataset, or its folder; its queries suffice.
        truth: Not needed for a check; accepted so that calls look alike.
        allow_missing: Whether a query without an answer is not a problem.

    Raises:
        SpecError: The dataset is at fault, not the submission.
    """
    return inspect(submission, data, allow_missing=allow_missing).issues()


def inspect(
    submission: Path | str, data: Dataset | Path | str, *, allow_missing: bool = False
) -> Problems:
    """Return a submission's problems with their true totals, and hints; arguments as `check`."""
    dataset = data if isinstance(data, Dataset) else Dataset.open(data)
    problems = Problems(submission)
    path = Path(submission)
    loaded = load(path, dataset, problems, Scratch(), allow_missing=allow_missing)
    if loaded is not None and isinstance(loaded.answers, Answers):
        problems.hints = hints_without_truth(loaded.answers, loaded.queries)
    return problems
