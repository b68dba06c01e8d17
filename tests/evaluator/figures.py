"""Figures of scores that a test compares."""

from __future__ import annotations

from pliant.evaluator.scores import Scores


def figure(scores: Scores, metric: str, tier: str | None = None) -> float:
    """Return a metric of all tiers or of one; it must be defined."""
    value = (scores.overall if tier is None else scores.tiers[tier])[metric]
    assert value is not None, metric
    return value
