"""Restricts the scores that participants of a competition see, to protect withheld answers.

A score in full precision is an equation for the answers: one answer moved by a known amount changes
the RMSE by an amount that depends on its truth alone. See docs/competitions.md.
"""

from __future__ import annotations

import math
from typing import Final

from pliant.evaluator.scores import Scores
from pliant.spec.errors import CallError

SIGNIFICANT_DIGITS: Final = 4

BITS_PER_FIGURE: Final = math.log2(9 * 10 ** (SIGNIFICANT_DIGITS - 1))
"""A figure of so many digits has at most so many bits beyond its order of magnitude."""


def public_scores(scores: Scores) -> Scores:
    """Return the part of scores that participants see.

    Args:
        scores: From `evaluate` with `hide_truth`.

    Returns:
        The headline metrics over the split, and the first of them for each tier, rounded to
        `SIGNIFICANT_DIGITS`; no intervals, curves, slices, pairs or examples, and no number of
        visible points.

    Raises:
        CallError: The errors are not capped.
    """
    document = scores.document
    if not document.get("hide_truth"):
        raise CallError(
            f"the scores of {scores.method} reveal single answers of a held-out split",
            found="errors that are not capped at the image diagonal",
            fix="Score the submission with: pliant evaluate --hide-truth",
        )
    headline = document["headline"]
    # The figures of a single tier are those of the split.
    of_tier = headline if len(scores.tiers) == 1 else headline[:1]
    public = {
        **document,
        "rounded": True,
        "counts": {name: n for name, n in document["counts"].items() if name != "counted"},
        "overall": _rounded(scores.overall, headline),
        "tiers": {tier: _rounded(values, of_tier) for tier, values in scores.tiers.items()},
        "intervals": {
            "level": document["intervals"]["level"],
            "overall": {},
            "tiers": {tier: {} for tier in scores.tiers},
        },
        "curves": {},
        "slices": {},
    }
    return Scores(public, scores.per_pair.slice(0, 0))


def _rounded(values: dict[str, float | None], names: list[str]) -> dict[str, float | None]:
    chosen = {name: values[name] for name in names if name in values}
    return {
        name: None if value is None else float(f"{value:.{SIGNIFICANT_DIGITS}g}")
        for name, value in chosen.items()
    }
