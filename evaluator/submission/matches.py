"""A sparse method's own keypoint matches, grouped by image pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.evaluator.arrays import FloatArray, IntArray
from pliant.evaluator.submission import limits
from pliant.evaluator.submission.answers import Answers
from pliant.evaluator.submission.batches import read_batches
from pliant.evaluator.submission.problems import Problems
from pliant.evaluator.submission.queries import Queries
from pliant.evaluator.submission.submission_file import Submission


@dataclass(frozen=True)
class Matches:
    """Keypoint matches, by pair, at most one from each source pixel.

    Attributes:
        starts: int64 (P + 1,), first match of each pair, and M.
        uv_a_px: float64 (M, 2), keypoints in the source frames.
        uv_b_px: float64 (M, 2), their matches in the target frames.
    """

    starts: IntArray
    uv_a_px: FloatArray
    uv_b_px: FloatArray

    @property
    def answers(self) -> Answers:
        """The target keypoints as answers to the source keypoints."""
        return Answers(self.uv_b_px, None, None, None, None, None, len(self.uv_b_px))


def read_matches(submission: Submission, queries: Queries, problems: Problems) -> Matches:
    """Read a submission of kind `matches`.

    The truth has one value for each source pixel. Of several matches from one pixel only the one
    with the highest score is used, so repeating a match gives it no weight.

    Args:
        submission: From `open_submission`.
        queries: The split's queries, which name the pairs.
        problems: Receives whatever is wrong with a row.

    Returns:
        The matches; to be used only if `problems` stays empty.
    """
    pairs: list[IntArray] = [np.empty(0, np.int64)]
    positions: list[FloatArray] = [np.empty((0, 5))]
    for batch in read_batches(submission, problems):
        pair = batch.keys["pair_id"]
        known = (pair >= 0) & (pair < queries.pairs)

        def stray(row: int, pair: IntArray = pair, begin: int = batch.begin) -> tuple[str, str]:
            required = f"required: pair ids below {queries.pairs}"
            place = f"row {begin + row} (pair {pair[row]})"
            return place, f"split {queries.split} has no such pair; {required}"

        problems.add_rows("ROW_UNKNOWN", ~known, stray)
        pairs.append(pair[known])
        names = ("u_a", "v_a", "u", "v", "score")
        positions.append(np.stack([batch.values[n] for n in names], axis=1)[known] * 1.0)
    pair = np.concatenate(pairs)
    count = np.bincount(pair, minlength=queries.pairs)

    def describe(index: int) -> tuple[str, str]:
        required = f"at most {limits.MAX_MATCHES_PER_PAIR:,}"
        return f"pair {index}", f"found {count[index]:,} matches; required: {required}"

    problems.add_rows("VALUE_OUT_OF_RANGE", count > limits.MAX_MATCHES_PER_PAIR, describe)
    rows = np.concatenate(positions).astype(np.float64)
    kept = _best_of_each_pixel(pair, rows)
    count = np.bincount(pair[kept], minlength=queries.pairs)
    uv = rows[kept]
    return Matches(np.concatenate([[0], np.cumsum(count)]), uv[:, :2], uv[:, 2:4])


def _best_of_each_pixel(pair: IntArray, rows: FloatArray) -> IntArray:
    """Return the rows to use, sorted by pair, int64 (K,); the order of the file does not matter.

    Args:
        pair: int64 (M,).
        rows: float64 (M, 5), u_a, v_a, u, v, score.
    """
    with np.errstate(invalid="ignore"):  # a row that is not finite has been noted
        column, row = np.floor(rows[:, 0]), np.floor(rows[:, 1])
    order = np.lexsort((*rows[:, 3::-1].T, -rows[:, 4], row, column, pair))
    key = np.stack([pair, column, row], axis=1)[order]
    first = np.ones(len(order), bool)
    first[1:] = (key[1:] != key[:-1]).any(axis=1)
    return order[first]
