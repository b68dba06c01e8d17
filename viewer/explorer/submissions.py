"""Recorded methods: the answers of a submission."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np

from pliant.evaluator.scores import read_scores
from pliant.evaluator.submission.answers import PlacedAnswers
from pliant.evaluator.submission.loading import load
from pliant.evaluator.submission.problems import Problems
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.io.reading import sha256_file
from pliant.spec.limits import Limits
from pliant.spec.queries import RecordedPair
from pliant.viewer.explorer.live import Kind, LiveMethod, MethodAnswer, PairErrors
from pliant.viewer.explorer.recorded import RecordedQueries
from pliant.viewer.photo_match import PointMatch


class RecordedMethod:
    """The answers of a submission: a pixel gets the answer to the nearest query of the pair.

    Args:
        name: The method's name.
        split: The split whose queries it answers.
        answers: Its answers in the order of the queries; missing ones are NaN.
        queries: The dataset's queries.

    Attributes:
        errors: The RMSE of each pair, pixels.
        answered: Share of the queries that have an answer.
    """

    kind: Kind = "recorded"

    def __init__(
        self, name: str, split: str, answers: PlacedAnswers, queries: RecordedQueries
    ) -> None:
        self.name, self._split = name, split
        found = queries.splits[split].rmse_px(answers.uv_px.astype(np.float64))
        self.errors: PairErrors = {split: found}
        self.answered = float(np.isfinite(answers.uv_px).all(axis=1).mean())
        self._answers, self._queries = answers, queries

    def answer(self, pair: RecordedPair) -> MethodAnswer | None:
        """Return the answer to the nearest query of the pair, or None."""
        found = self._queries.nearest(pair)
        if found is None or found[0].split != self._split:
            return None
        queries, row = found
        uv_b = self._answers.uv_px[row]
        if not np.isfinite(uv_b).all():
            return None
        visible, sigma = self._answers.visible, self._answers.sigma_px
        point = PointMatch(
            queries.uv_a_px[row].astype(np.float32),
            uv_b,
            visible=None if visible is None else float(visible[row]),
            sigma_px=None if sigma is None else float(sigma[row]),
        )
        return MethodAnswer(point, None if queries.uv_b_px is None else queries.uv_b_px[row])


def read_submission(path: Path, dataset: Dataset, queries: RecordedQueries) -> RecordedMethod:
    """Read a submission in a child process with limits; missing rows are allowed.

    Args:
        path: The submission.
        dataset: The dataset that it answers.
        queries: The dataset's queries.

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
            fix=f"List all problems with: pliant check {shlex.quote(str(path))} --data DATA",
            issues=issues,
        )
    if not isinstance(loaded.answers, PlacedAnswers):
        raise CallError(
            "keypoint matches answer no queries", path=path, required="a submission of answers"
        )
    submission = loaded.submission
    name = str(submission.footer["method"]["name"])
    return RecordedMethod(name, submission.split, loaded.answers, queries)


def read_report(folder: Path, dataset: Dataset, queries: RecordedQueries) -> RecordedMethod:
    """Return the recorded answers that a report scores.

    The submission is the file that the report names, by its sha256: in the report's folder, the
    one above, or the current one, from where `pliant evaluate` named it.

    Args:
        folder: A folder of `pliant evaluate`.
        dataset: The dataset.
        queries: The dataset's queries.

    Raises:
        CallError: The submission is not there.
        SubmissionError: The folder is not a report, or one of the files is damaged.
    """
    submission = read_scores(folder).document["submission"]
    name = Path(submission["file"]).name
    for place in (folder, folder.resolve().parent, Path()):
        file = place / name
        if file.is_file() and sha256_file(file) == submission["sha256"]:
            return read_submission(file, dataset, queries)
    raise CallError(
        "the submission of the report is not there",
        path=folder,
        required=f"{name}, sha256 {submission['sha256'][:16]}…, in the report's folder, the one "
        "above or the current one",
        fix="Name the submission instead of the report.",
    )


Method = LiveMethod | RecordedMethod
"""A method of an explorer, of any kind."""
