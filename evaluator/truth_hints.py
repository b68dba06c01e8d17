"""Warnings about likely mistakes in the coordinates, found by comparing answers with the truth.

They are never shown where the truth is hidden.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.submission.answers import LEAST_ANSWERS, MOST_COMPARED, PlacedAnswers
from pliant.evaluator.submission.queries import Queries
from pliant.spec.arrays import FloatArray

_GAIN: Final = 2.0
"""A change of the answers is worth a hint when it divides the RMSE by this or more."""

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


class TruthHints:
    """Compares the answers with the truth; never shown where that is hidden.

    Args:
        answers: The answers.
        queries: The queries.
    """

    def __init__(self, answers: PlacedAnswers, queries: Queries) -> None:
        self._predicted, self._size = answers.visible, queries.size
        self._step = max(1, queries.rows // MOST_COMPARED)
        self._kept: list[tuple[FloatArray, FloatArray]] = []
        self._visible: list[tuple[FloatArray, FloatArray]] = []

    def update(self, block: Block) -> None:
        """Keep every k-th row of a block."""
        chosen = slice(None, None, self._step)
        answer, counted = block.answer_px[chosen].astype(np.float64), block.counted[chosen]
        known = np.isfinite(answer[:, 0])
        used = known & counted
        self._kept.append((answer[used], block.true_px[chosen][used]))
        if self._predicted is not None:
            predicted = self._predicted[block.rows][chosen][known].astype(np.float64)
            self._visible.append((predicted, counted[known].astype(np.float64)))

    def found(self) -> Iterator[str]:
        """Yield one sentence for each likely mistake."""
        answer, true = (np.concatenate(parts) for parts in zip(*self._kept, strict=True))
        if len(true) < LEAST_ANSWERS:
            return
        rmse = _rmse(answer, true)
        candidates = {
            name: _rmse(change(answer, self._size), true) for name, change in CHANGES.items()
        }
        best = min(candidates, key=lambda name: candidates[name])
        scale = (answer * true).sum(axis=0) / np.maximum(np.square(answer).sum(axis=0), 1e-12)
        rescaled = _rmse(answer * scale, true) if (scale > 0).all() else np.inf
        words, least = best, candidates[best]
        if rescaled < 0.9 * least - 0.01:
            words = f"multiplying u by {scale[0]:.4g} and v by {scale[1]:.4g}"
            least = rescaled
        # Bad answers gain from every change that brings them nearer to the middle of the truth.
        if _GAIN * least <= min(rmse, _rmse(true.mean(axis=0), true)) and rmse > 0:
            yield (
                f"{words} would change the RMSE from {rmse:.4g} px to {least:.4g} px. "
                "Positions are (u, v): u to the right, v down, in pixels from the image's top left "
                "corner, with the first pixel's centre at (0.5, 0.5)."
            )
        correlation = self._visibility_correlation()
        if correlation < -0.2:
            yield (
                f"`visible` is anticorrelated with the truth ({correlation:.2f}). It is the "
                "probability that the point is visible in the target image, not that it is hidden."
            )

    def _visibility_correlation(self) -> float:
        if not self._visible:
            return 0.0
        predicted, seen = (np.concatenate(parts) for parts in zip(*self._visible, strict=True))
        if len(seen) < LEAST_ANSWERS or predicted.std() * seen.std() < 1e-6:
            return 0.0
        return float(np.corrcoef(predicted, seen)[0, 1])


def _rmse(answer: FloatArray, true: FloatArray) -> float:
    return float(np.sqrt(np.square(answer - true).sum(axis=1).mean()))
