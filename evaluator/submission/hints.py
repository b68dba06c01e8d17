"""Warnings about answers that are valid but look like a mistake in the coordinates."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from pliant.evaluator.arrays import FloatArray
from pliant.evaluator.submission.answers import Answers
from pliant.evaluator.submission.blocks import Block
from pliant.evaluator.submission.queries import Queries

_LEAST_ANSWERS: Final = 20
_GAIN: Final = 2.0
"""A change of the answers is worth a hint when it divides the RMSE by this or more."""
_ROWS: Final = 1 << 18
_MOST_COMPARED: Final = 200_000
"""Of more answers than this, every k-th is compared with the truth."""

Change = Callable[[FloatArray, tuple[int, int]], FloatArray]
CHANGES: Final[dict[str, Change]] = {
    "exchanging u and v": lambda uv, size: uv[:, ::-1],
    "adding half a pixel to u and v": lambda uv, size: uv + 0.5,
    "subtracting half a pixel from u and v": lambda uv, size: uv - 0.5,
    "flipping v (v becomes height - v)": lambda uv, size: uv * [1, -1] + [0, size[1]],
    "flipping u (u becomes width - u)": lambda uv, size: uv * [-1, 1] + [size[0], 0],
    "multiplying by the image size": lambda uv, size: uv * size,
    "reading -1 to 1 as the whole image": lambda uv, size: (uv + 1) / 2 * size,
}


def hints_without_truth(answers: Answers, queries: Queries) -> list[str]:
    """Return what looks wrong about the answers alone; safe to show where the truth is hidden.

    Args:
        answers: The answers.
        queries: The queries, for the size of the images.
    """
    size = np.array(queries.size, np.float64)
    total = unit = outside = 0
    for first in range(0, len(answers.uv_px), _ROWS):
        uv = answers.uv_px[first : first + _ROWS]
        uv = uv[np.isfinite(uv[:, 0])]
        total += len(uv)
        unit += int(((uv >= 0) & (uv <= 1)).all(axis=1).sum())
        outside += int(((uv < 0) | (uv > size)).any(axis=1).sum())
    width, height = queries.size
    found = []
    if total >= _LEAST_ANSWERS and unit > 0.99 * total:
        found.append(
            f"{_share(unit, total)} of the answers are in [0, 1]. Positions are in pixels: u from "
            f"0 to {width}, v from 0 to {height}. Multiply u by the width and v by the height."
        )
    elif total >= _LEAST_ANSWERS and outside > 0.5 * total:
        found.append(
            f"{_share(outside, total)} of the answers are outside the image. Positions are in "
            f"pixels of the target image ({width} x {height}), from its top left corner."
        )
    return found


class TruthHints:
    """Compares the answers with the truth, block by block; never shown where that is hidden.

    Args:
        answers: The answers.
        queries: The queries.
    """

    def __init__(self, answers: Answers, queries: Queries) -> None:
        self._visible, self._queries = answers.visible, queries
        self._step = max(1, queries.rows // _MOST_COMPARED)
        self._squared = 0.0
        self._changed = dict.fromkeys(CHANGES, 0.0)
        self._moments = np.zeros((4, 2))  # per axis, answer a and truth t: sums of t, aa, at, tt
        self._seen = np.zeros(5)  # of the predicted p and the true visibility q: p, q, pp, pq, qq
        self._count = self._rows = 0

    def update(self, block: Block) -> None:
        """Take in one block."""
        chosen = slice(None, None, self._step)
        answer, counted = block.answer_px[chosen].astype(np.float64), block.counted[chosen]
        known = np.isfinite(answer[:, 0])
        used = known & counted
        answer, true = answer[used], block.true_px[chosen][used]
        self._count += len(true)
        self._squared += float(np.square(answer - true).sum())
        for name, change in CHANGES.items():
            moved = change(answer, self._queries.size)
            self._changed[name] += float(np.square(moved - true).sum())
        products = (true, np.square(answer), answer * true, np.square(true))
        self._moments += [product.sum(axis=0) for product in products]
        if self._visible is not None:
            p = self._visible[block.rows][chosen][known].astype(np.float64)
            q = counted[known].astype(np.float64)
            self._rows += len(p)
            self._seen += [p.sum(), q.sum(), p @ p, p @ q, q @ q]

    def found(self) -> Iterator[str]:
        """Yield one sentence for each likely mistake."""
        if self._count < _LEAST_ANSWERS:
            return
        rmse = (self._squared / self._count) ** 0.5
        candidates = {
            name: (squared / self._count) ** 0.5 for name, squared in self._changed.items()
        }
        best = min(candidates, key=lambda name: candidates[name])
        scale, rescaled = self._rescaled()
        if rescaled < 0.9 * candidates[best] - 0.01:
            best, candidates["rescaling"] = "rescaling", rescaled
        # Bad answers gain from every change that brings them nearer to the middle of the truth.
        if _GAIN * candidates[best] <= min(rmse, self._constant_rmse()) and rmse > 0:
            words = best
            if best == "rescaling":
                words = f"multiplying u by {scale[0]:.4g} and v by {scale[1]:.4g}"
            yield (
                f"{words} would change the RMSE from {rmse:.4g} px to {candidates[best]:.4g} px. "
                "Positions are (u, v): u to the right, v down, in pixels from the image's top left "
                "corner, with the first pixel's centre at (0.5, 0.5)."
            )
        correlation = self._visibility_correlation()
        if correlation < -0.2:
            yield (
                f"`visible` is anticorrelated with the truth ({correlation:.2f}). It is the "
                "probability that the point is visible in the target image, not that it is hidden."
            )

    def _rescaled(self) -> tuple[FloatArray, float]:
        """Return the factors of u and v that fit best, and the RMSE with them."""
        _, square, product, truth = self._moments
        scale = product / np.maximum(square, 1e-12)
        left = np.maximum(truth - scale * product, 0).sum()
        return scale, float((left / self._count) ** 0.5) if (scale > 0).all() else np.inf

    def _constant_rmse(self) -> float:
        """Return the RMSE of the best answer that is the same everywhere."""
        total, _, _, square = self._moments / self._count
        return float(np.maximum(square - total**2, 0).sum() ** 0.5)

    def _visibility_correlation(self) -> float:
        if self._rows < _LEAST_ANSWERS:
            return 0.0
        p, q, pp, pq, qq = self._seen / self._rows
        variance = (pp - p * p) * (qq - q * q)
        return float((pq - p * q) / variance**0.5) if variance > 1e-12 else 0.0


def _share(part: int, total: int) -> str:
    return f"{100 * part / total:.0f} %"
