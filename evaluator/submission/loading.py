"""The one road a submission takes, whether it is only checked or scored as well."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pliant.evaluator.submission.answers import Answers, read_answers
from pliant.evaluator.submission.in_memory import Given, open_answers
from pliant.evaluator.submission.matches import Matches, read_matches
from pliant.evaluator.submission.problems import Problems
from pliant.evaluator.submission.queries import Queries, read_queries
from pliant.evaluator.submission.scratch import Scratch
from pliant.evaluator.submission.submission_file import Submission, open_submission
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError


@dataclass(frozen=True)
class Loaded:
    """A submission in which nothing is wrong.

    Attributes:
        submission: The file, its footer and columns.
        queries: The queries it answers.
        answers: Its rows in the order of the queries, or its keypoint matches by pair.
    """

    submission: Submission
    queries: Queries
    answers: Answers | Matches


def load(
    path: Path, dataset: Dataset, problems: Problems, scratch: Scratch, *, allow_missing: bool
) -> Loaded | None:
    """Open, check and read a submission.

    Args:
        path: The file.
        dataset: The dataset it answers.
        problems: Receives everything that is wrong.
        scratch: Where long arrays live.
        allow_missing: Whether a query without an answer is no problem.

    Returns:
        The submission, or None if there is a problem.

    Raises:
        SpecError: The dataset is at fault, not the submission.
    """
    submission = open_submission(path, dataset, problems)
    if submission is None:
        return None
    queries = read_queries(dataset, submission.split)
    answers: Answers | Matches
    if submission.kind == "matches":
        answers = read_matches(submission, queries, problems)
    else:
        answers = read_answers(submission, queries, problems, scratch, allow_missing=allow_missing)
    return None if problems else Loaded(submission, queries, answers)


def load_in_memory(
    answers: Given,
    dataset: Dataset,
    split: str,
    method: str,
    problems: Problems,
    scratch: Scratch,
    *,
    allow_missing: bool,
) -> Loaded | None:
    """Check and read answers that are arrays; arguments as `load` and `open_answers`.

    Raises:
        CallError: The split has no queries, or the answers are not columns.
        SpecError: The dataset is at fault.
    """
    splits = dataset.splits_with_queries()
    if split not in splits:
        required = "one of " + ", ".join(splits)
        raise CallError("this split has no queries", found=repr(split), required=required)
    queries = read_queries(dataset, split)
    sha256 = dataset.queries_sha256(split)
    footer = {"split": split, "queries_sha256": sha256, "method": {"name": method}}
    submission = open_answers(answers, queries, footer, problems)
    if submission is None:
        return None
    answers = read_answers(submission, queries, problems, scratch, allow_missing=allow_missing)
    return None if problems else Loaded(submission, queries, answers)
