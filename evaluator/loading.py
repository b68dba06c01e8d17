"""The one road a submission takes, whether it is only checked or scored as well."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pliant.evaluator.answers import Answers, read_answers
from pliant.evaluator.matches import Matches, read_matches
from pliant.evaluator.problems import Problems
from pliant.evaluator.questions import Questions, read_questions
from pliant.evaluator.scratch import Scratch
from pliant.evaluator.submission import Submission, open_submission
from pliant.spec.dataset import Dataset


@dataclass(frozen=True)
class Loaded:
    """A submission in which nothing is wrong.

    Attributes:
        submission: The file, its footer and columns.
        questions: The queries it answers.
        answers: Its rows in the order of the queries, or its keypoint matches by pair.
    """

    submission: Submission
    questions: Questions
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
    questions = read_questions(dataset, submission.split)
    answers: Answers | Matches
    if submission.kind == "matches":
        answers = read_matches(submission, questions, problems)
    else:
        answers = read_answers(
            submission, questions, problems, scratch, allow_missing=allow_missing
        )
    return None if problems else Loaded(submission, questions, answers)
