"""Distances on a material, worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pliant.spec.model import MaterialCoordinate, MaterialObject
from tests.dataset_files import coordinate

OPEN, CLOSED = coordinate("a", 0, 1, 2), coordinate("b", -2, 2, 0.5, 4)


def _object(first: dict[str, Any], second: dict[str, Any]) -> MaterialObject:
    return MaterialObject(1, "x", (MaterialCoordinate(**first), MaterialCoordinate(**second)))


def test_material_distance_by_hand() -> None:
    gap = np.array([[0.3, 0.0], [0.0, 1.0], [0.3, 0.8], [0.0, 3.0], [0.0, 2.0], [0.0, -3.9]])
    # 0.3 * 2 m; 1 * 0.5 m; a 3-4-5 triangle of 0.6 and 0.4 … ; 3 is 1 the other way round.
    expected = [0.6, 0.5, np.hypot(0.6, 0.4), 0.5, 1.0, 0.05]
    assert _object(OPEN, CLOSED).distance_m(gap, np.zeros(2)) == pytest.approx(expected)
    assert _object(OPEN, OPEN).distance_m(gap[3:4], np.zeros(2)) == pytest.approx([6.0])


def test_wrap_difference_by_hand() -> None:
    gap = np.array([[3.0, 3.0], [-3.0, -3.0], [0.5, 1.9]])
    assert _object(OPEN, CLOSED).wrapped(gap).tolist() == [[3, -1], [-3, 1], [0.5, 1.9]]
