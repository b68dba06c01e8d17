"""Figures of scores that a test compares."""

from __future__ import annotations

from typing import Any

import pytest

from pliant.evaluator.scores import Scores


def figure(scores: Scores, metric: str, tier: str | None = None) -> float:
    """Return a metric of all tiers or of one; it must be defined."""
    value = (scores.overall if tier is None else scores.tiers[tier])[metric]
    assert value is not None, metric
    return value


def assert_same(found: Any, expected: Any, place: str, rel: float) -> None:
    """Compare JSON documents, numbers with a fraction up to a relative difference."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys(), place
        for key, value in expected.items():
            assert_same(found[key], value, f"{place}/{key}", rel)
    elif isinstance(expected, list):
        assert len(found) == len(expected), place
        for index, value in enumerate(expected):
            assert_same(found[index], value, f"{place}/{index}", rel)
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=rel, abs=rel), place
    else:
        assert found == expected, place
