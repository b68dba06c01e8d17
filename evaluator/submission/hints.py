"""Warnings about answers that are valid but look like a mistake, from the answers alone."""

from __future__ import annotations

from typing import Final

import numpy as np

from pliant.evaluator.submission.answers import SplitAnswers
from pliant.evaluator.submission.queries import Queries

LEAST_ANSWERS: Final = 20
"""Of fewer answers nothing is said."""

MOST_COMPARED: Final = 200_000
"""Of more answers than this, every k-th is looked at."""


def coordinate_hints(answers: SplitAnswers, queries: Queries) -> list[str]:
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
