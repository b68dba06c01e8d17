"""The answers of a submission, for figures and the explorer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pliant.evaluator.submission.answers import SplitAnswers
from pliant.evaluator.submission.loading import load
from pliant.evaluator.submission.problems import Problems
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.limits import Limits


@dataclass(frozen=True)
class RecordedAnswers:
    """The answers of a submission.

    Attributes:
        method: Name of its method.
        split: The split whose queries it answers.
        rows: Its answers in the order of the queries; missing ones are NaN.
    """

    method: str
    split: str
    rows: SplitAnswers


def read_answers(path: Path, dataset: Dataset) -> RecordedAnswers:
    """Read a submission in a child process with limits; missing rows are allowed.

    Args:
        path: The submission.
        dataset: The dataset that it answers.

    Raises:
        SubmissionError: Something is wrong with it, or it answers other queries.
        CallError: It contains keypoint matches, not answers.
    """
    problems = Problems(path)
    loaded = load(path, dataset, problems, allow_missing=True, limits=Limits())
    if loaded is None:
        issues = problems.issues()
        raise SubmissionError(
            "the submission cannot be read",
            path=path,
            found=str(issues[0]) if issues else None,
            fix=f"List all problems with: pliant check {path} --data DATA",
            issues=issues,
        )
    if not isinstance(loaded.answers, SplitAnswers):
        raise CallError(
            "keypoint matches answer no queries", path=path, required="a submission of answers"
        )
    method = str(loaded.submission.footer["method"]["name"])
    return RecordedAnswers(method, loaded.submission.split, loaded.answers)
