"""A sparse method's own keypoint matches, grouped by image pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.evaluator.submission import limits
from pliant.evaluator.submission.answers import SplitAnswers
from pliant.evaluator.submission.problems import Problems
from pliant.evaluator.submission.queries import Queries
from pliant.evaluator.submission.values import Values
from pliant.spec.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class SplitMatches:
    """The keypoint matches of a split, by pair, at most one from each source pixel.

    Attributes:
        starts: int64 (P + 1,), first match of each pair, and M.
        uv_a_px: float64 (M, 2), keypoints in the source frames.
        uv_b_px: float64 (M, 2), their matches in the target frames.
    """

    starts: IntArray
    uv_a_px: FloatArray
    uv_b_px: FloatArray

    @property
    def answers(self) -> SplitAnswers:
        """The target keypoints as answers to the source keypoints."""
        return SplitAnswers(self.uv_b_px, answered=len(self.uv_b_px))


def place_matches(values: Values, queries: Queries, problems: Problems) -> SplitMatches:
    """Group the matches of a submission by pair.

    The truth has one value for each source pixel. Of several matches from one pixel only the one
    with the highest score is used, so repeating a match gives it no weight.

    Args:
        values: The rows, from `read_values`.
        queries: The split's queries, which name the pairs.
        problems: Receives whatever is wrong with a key.

    Returns:
        The matches; to be used only if `problems` stays empty.
    """
    pair = values.keys["pair_id"]
    known = (pair >= 0) & (pair < queries.pairs)

    def stray(row: int) -> tuple[str, str]:
        required = f"required: pair ids below {queries.pairs}"
        return (
            f"row {row} (pair {pair[row]})",
            f"split {queries.split} has no such pair; {required}",
        )

    problems.add_rows("ROW_UNKNOWN", ~known, stray)
    names = ("u_a", "v_a", "u", "v", "score")
    rows = np.stack([values.reals[name] for name in names], axis=1)[known].astype(np.float64)
    pair = pair[known].astype(np.int64)
    count = np.bincount(pair, minlength=queries.pairs)

    def describe(index: int) -> tuple[str, str]:
        required = f"at most {limits.MAX_MATCHES_PER_PAIR:,}"
        return f"pair {index}", f"found {count[index]:,} matches; required: {required}"

    problems.add_rows("VALUE_OUT_OF_RANGE", count > limits.MAX_MATCHES_PER_PAIR, describe)
    kept = _best_of_each_pixel(pair, rows)
    kept_count = np.bincount(pair[kept], minlength=queries.pairs)
    uv = rows[kept]
    return SplitMatches(np.concatenate([[0], np.cumsum(kept_count)]), uv[:, :2], uv[:, 2:4])


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
