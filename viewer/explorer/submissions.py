"""Recorded methods: the answers of a submission, or the errors of a report without one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pliant.evaluator.scores import Scores, read_scores
from pliant.evaluator.submission.answers import SplitAnswers
from pliant.evaluator.submission.loading import load
from pliant.evaluator.submission.problems import Problems
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.io.reading import sha256_file
from pliant.spec.model import FloatArray
from pliant.viewer.explorer.answers import Kind, MethodAnswer, PairErrors
from pliant.viewer.explorer.frames import FramePair
from pliant.viewer.explorer.live import LiveMethod
from pliant.viewer.explorer.recorded import RecordedQueries
from pliant.viewer.explorer.truth import REACH_PX


class RecordedMethod:
    """The answers of a submission: a pixel gets the answer to the nearest query of the pair.

    Args:
        name: Name of the method.
        answers: The answers of one split, in the order of its queries.
        split: The split.
        queries: The dataset's queries.
        errors: The RMSE of each pair, pixels.
    """

    kind: Kind = "recorded"

    def __init__(
        self,
        name: str,
        answers: SplitAnswers,
        split: str,
        queries: RecordedQueries,
        errors: list[float | None],
    ) -> None:
        self.name = name
        self.errors: PairErrors = {split: errors}
        self._answers, self._split, self._queries = answers, split, queries

    def answer(self, pair: FramePair, uv_a_px: FloatArray) -> MethodAnswer | None:
        """Return the answer to the nearest query of the pair, or None."""
        found = self._queries.nearest(pair, uv_a_px, REACH_PX)
        if found is None or found.split != self._split:
            return None
        uv_b = self._answers.uv_px[found.row].astype(np.float64)
        if not np.isfinite(uv_b).all():
            return None
        visible, sigma = self._answers.visible, self._answers.sigma_px
        return MethodAnswer(
            uv_a_px=self._queries.uv_a_px(found),
            uv_b_px=uv_b,
            true_px=self._queries.truth(found)[0],
            visible=None if visible is None else float(visible[found.row]),
            sigma_px=None if sigma is None else float(sigma[found.row]),
        )

    def answers(self, pair: FramePair, uv_a_px: FloatArray) -> FloatArray | None:
        """Return the answers to the pair's own queries, float64 (N, 2), NaN where missing."""
        known = self._queries.of_pair(pair)
        if known is None or known[0] != self._split:
            return None
        found: FloatArray = self._answers.uv_px[known[1]].astype(np.float64)
        return found if len(found) == len(uv_a_px) else None


class ReportMethod:
    """A report without its submission: it sorts pairs by error and answers nothing.

    Args:
        scores: The report.
    """

    kind: Kind = "report"

    def __init__(self, scores: Scores) -> None:
        self.name = scores.method
        self.errors: PairErrors = {str(scores.document["split"]): pair_errors(scores)}

    def answer(self, pair: FramePair, uv_a_px: FloatArray) -> MethodAnswer | None:
        """Return None: a report contains no answers."""
        del pair, uv_a_px
        return None

    def answers(self, pair: FramePair, uv_a_px: FloatArray) -> FloatArray | None:
        """Return None: a report contains no answers."""
        del pair, uv_a_px
        return None


def pair_errors(scores: Scores) -> list[float | None]:
    """Return the RMSE of each pair of a report in pixels, None where the protocol has none."""
    table = scores.per_pair
    if not {"sum_squared_px2", "counted"} <= set(table.column_names):
        return [None] * len(table)
    squared, counted = (table[name].to_numpy() for name in ("sum_squared_px2", "counted"))
    return [float(np.sqrt(s / n)) if n else None for s, n in zip(squared, counted, strict=True)]


def read_submission(path: Path, dataset: Dataset, queries: RecordedQueries) -> RecordedMethod:
    """Return the recorded answers of a submission; missing rows are allowed.

    Args:
        path: The submission.
        dataset: The dataset.
        queries: The dataset's queries.

    Raises:
        SubmissionError: Something is wrong with it.
        CallError: It contains keypoint matches, not answers.
    """
    problems = Problems(path)
    loaded = load(path, dataset, problems, allow_missing=True)
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
    split = loaded.submission.split
    name = str(loaded.submission.footer["method"]["name"])
    errors = queries.splits[split].rmse_px(loaded.answers.uv_px.astype(np.float64))
    return RecordedMethod(name, loaded.answers, split, queries, errors)


def read_report(
    folder: Path, dataset: Dataset, queries: RecordedQueries
) -> RecordedMethod | ReportMethod:
    """Return a report's method, with its answers where the submission is found.

    The submission is the file that the report names, by its sha256: in the report's folder or the
    one above.

    Args:
        folder: A folder of `pliant evaluate`.
        dataset: The dataset.
        queries: The dataset's queries.

    Raises:
        CallError: The report is of another dataset.
        SubmissionError: The folder is not a report, or is damaged.
    """
    scores = read_scores(folder)
    of, split = scores.document["dataset"], str(scores.document["split"])
    if split not in queries.splits or of["queries_sha256"] != dataset.queries_sha256(split):
        raise CallError(
            "the report is of another dataset",
            path=folder,
            found=f"{of['id']} {of['version']}, split {split}",
            required=f"{dataset.id} {dataset.version}",
        )
    submission = scores.document["submission"]
    for place in (folder, folder.resolve().parent):
        file = place / Path(submission["file"]).name
        if file.is_file() and sha256_file(file) == submission["sha256"]:
            return read_submission(file, dataset, queries)
    return ReportMethod(scores)


Method = LiveMethod | RecordedMethod | ReportMethod
"""A method of an explorer, of any kind."""
