"""Aligns the rows of a submission: answers with queries, matches with image pairs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.evaluator.submission.problems import Problems
from pliant.evaluator.submission.queries import Queries
from pliant.evaluator.submission.values import MAX_MATCHES_PER_PAIR, Values
from pliant.spec.arrays import BoolArray, FloatArray, IntArray, RealArray
from pliant.spec.validation.findings import LISTED_PER_CODE

LEAST_ANSWERS: Final = 20
"""Of fewer answers nothing is said."""

MOST_COMPARED: Final = 200_000
"""Of more answers than this, every k-th is looked at."""


@dataclass(frozen=True)
class PlacedAnswers:
    """The answers of a split, in the order of its queries.

    Attributes:
        uv_px: float32 or float64 (R, 2); NaN where a row is missing.
        visible: float32 or float64 (R,), probabilities, or None.
        sigma_px: float32 or float64 (R,), or None.
        modes: float32 or float64 (M, 4), the modes of all rows in the order of the file, or None.
        mode_begin: int64 (R,), first mode of each row, or None.
        mode_count: int64 (R,), number of modes of each row, or None.
        answered: Rows that are there.
    """

    uv_px: RealArray
    visible: RealArray | None = None
    sigma_px: RealArray | None = None
    modes: RealArray | None = None
    mode_begin: IntArray | None = None
    mode_count: IntArray | None = None
    answered: int = 0

    @property
    def has_distribution(self) -> bool:
        """Whether the answers are distributions."""
        return self.sigma_px is not None or self.modes is not None

    def modes_of(self, rows: IntArray) -> tuple[IntArray, FloatArray]:
        """Return the number of modes of some rows, int64 (N,), and their modes, float64 (K, 4)."""
        if self.modes is None or self.mode_begin is None or self.mode_count is None:
            raise RuntimeError("answers without modes were asked for them")
        count = self.mode_count[rows]
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        found = self.modes[np.repeat(self.mode_begin[rows], count) + within]
        return count, found.astype(np.float64)


def place_answers(
    values: Values, queries: Queries, problems: Problems, *, allow_missing: bool
) -> PlacedAnswers:
    """Put every row of a submission in its place.

    Args:
        values: The rows, from `read_values`.
        queries: The split's queries.
        problems: Receives whatever is wrong with a key.
        allow_missing: A query without a row is not a problem.

    Returns:
        The answers; to be used only if `problems` stays empty.
    """
    row, known = locate(values, queries, problems)

    def scattered(column: npt.NDArray[Any]) -> Any:
        result = np.zeros(queries.rows, column.dtype)
        result[row] = column if known is None else column[known]
        return result

    u, v = values.reals["u"], values.reals["v"]
    with np.errstate(invalid="ignore"):  # of a signalling NaN, noted before
        uv = np.stack([u, v], axis=1)
    if values.good is not None:
        uv[~values.good] = 0  # present, though of no use: not missing as well
    placed = np.full((queries.rows, 2), np.nan, uv.dtype)
    pair_of_reals = np.complex64 if uv.dtype == np.float32 else np.complex128
    # One write to a random place for each row instead of two.
    placed.view(pair_of_reals)[row] = (uv if known is None else uv[known]).view(pair_of_reals)
    answered = queries.rows - int(np.isnan(placed[:, 0]).sum())
    if len(row) > answered:
        _note_duplicates(row, known, queries, problems)
    if answered < queries.rows and not allow_missing:
        _note_missing(placed, queries, problems)
    modes = values.modes
    return PlacedAnswers(
        uv_px=placed,
        visible=scattered(values.reals["visible"]) if "visible" in values.reals else None,
        sigma_px=scattered(values.reals["sigma"]) if "sigma" in values.reals else None,
        modes=None if modes is None else modes.values,
        mode_begin=None if modes is None else scattered(np.cumsum(modes.count) - modes.count),
        mode_count=None if modes is None else scattered(modes.count),
        answered=answered,
    )


def locate(
    values: Values, queries: Queries, problems: Problems
) -> tuple[IntArray, BoolArray | None]:
    """Return where the rows of a submission belong.

    Args:
        values: The rows.
        queries: The split's queries.
        problems: Receives keys that belong to no query.

    Returns:
        row: int64 (K,), the query of each known row.
        known: bool (N,), which rows are known (K of them), or None for all.
    """
    pair, query = values.keys["pair_id"], values.keys["query_id"]
    if not len(pair):
        return np.empty(0, np.int64), None
    # A query id below the number of rows cannot wrap around when a start is added to it.
    bounded = query.min() >= 0 and query.max() < queries.rows
    if bounded and pair.min() >= 0 and pair.max() < queries.pairs:
        row = queries.starts.take(pair)
        row += query
        if bool((row < queries.starts[1:].take(pair)).all()):
            return row, None
    inside = (pair >= 0) & (pair < queries.pairs) & (query >= 0)
    known = inside & (query < np.diff(queries.starts)[np.where(inside, pair, 0)])

    def describe(row: int) -> tuple[str, str]:
        number, required = int(pair[row]), f"pair ids below {queries.pairs}"
        if 0 <= number < queries.pairs:
            required = f"query ids below {queries.starts[number + 1] - queries.starts[number]}"
        return (
            f"row {row} (pair {number}, query {query[row]})",
            f"the queries of split {queries.split} have no such key; required: {required}",
        )

    problems.add_rows("ROW_UNKNOWN", ~known, describe)
    return queries.starts[pair[known]] + query[known], known


def _note_duplicates(
    row: IntArray, known: BoolArray | None, queries: Queries, problems: Problems
) -> None:
    """Note every row whose query an earlier row answers; arguments as `locate` returns."""
    number = np.arange(len(row)) if known is None else np.flatnonzero(known)
    order = np.argsort(row, kind="stable")
    repeats = row[order][1:] == row[order][:-1]
    first = np.concatenate([[True], ~repeats]).nonzero()[0]
    begin = np.repeat(first, np.diff(np.append(first, len(order))))  # of each run of equal rows
    later, earlier = order[1:][repeats], order[begin][1:][repeats]
    described = []
    for index in np.argsort(later)[:LISTED_PER_CODE].tolist():
        pair, query = queries.key(int(row[later[index]]))
        described.append(
            (
                f"row {number[later[index]]} (pair {pair}, query {query})",
                f"the query was answered before, in row {number[earlier[index]]}; "
                "required: one row per query",
            )
        )
    problems.add_many("ROW_DUPLICATE", len(later), described)


def _note_missing(uv_px: RealArray, queries: Queries, problems: Problems) -> None:
    def describe(row: int) -> tuple[str, str]:
        pair, query = queries.key(row)
        return (
            f"pair {pair}, query {query}",
            "the query has no answer; required: one row per query (where some may be "
            "missing, as by `pliant evaluate --allow-missing`, they count as failures)",
        )

    problems.add_rows("ROW_MISSING", np.isnan(uv_px[:, 0]), describe)


@dataclass(frozen=True)
class PlacedMatches:
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
    def answers(self) -> PlacedAnswers:
        """The target keypoints as answers to the source keypoints."""
        return PlacedAnswers(self.uv_b_px, answered=len(self.uv_b_px))


def place_matches(values: Values, queries: Queries, problems: Problems) -> PlacedMatches:
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
        required = f"at most {MAX_MATCHES_PER_PAIR:,}"
        return f"pair {index}", f"found {count[index]:,} matches; required: {required}"

    problems.add_rows("VALUE_OUT_OF_RANGE", count > MAX_MATCHES_PER_PAIR, describe)
    kept = _best_of_each_pixel(pair, rows)
    kept_count = np.bincount(pair[kept], minlength=queries.pairs)
    uv = rows[kept]
    return PlacedMatches(np.concatenate([[0], np.cumsum(kept_count)]), uv[:, :2], uv[:, 2:4])


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


def coordinate_hints(answers: PlacedAnswers, queries: Queries) -> list[str]:
    """Return what looks wrong about the answers alone; safe to show where the truth is hidden.

    Args:
        answers: The answers.
        queries: The queries, for the size of the images.
    """
    uv = answers.uv_px[:: max(1, queries.rows // MOST_COMPARED)]
    uv = uv[np.isfinite(uv[:, 0])]
    total = len(uv)
    unit = int(((uv >= 0) & (uv <= 1)).all(axis=1).sum())
    outside = int(((uv < 0) | (uv > np.array(queries.size))).any(axis=1).sum())
    width, height = queries.size
    found = []
    if total >= LEAST_ANSWERS and unit > 0.99 * total:
        found.append(
            f"{_share(unit, total)} of the answers are in [0, 1]. Positions are in pixels: u from "
            f"0 to {width}, v from 0 to {height}. Multiply u by the width and v by the height."
        )
    elif total >= LEAST_ANSWERS and outside > 0.5 * total:
        found.append(
            f"{_share(outside, total)} of the answers are outside the image. Positions are in "
            f"pixels of the target image ({width} x {height}), from its top left corner."
        )
    return found


def _share(part: int, total: int) -> str:
    return f"{100 * part / total:.0f} %"
