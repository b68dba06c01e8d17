"""Tables with a drawn pattern, which teach networks for masks."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.models.don import painted_tables
from pliant.models.don.painted_tables import _PATTERNS, painted_table

SHAPE = (128, 160)


def test_a_table_is_a_picture_that_its_seed_decides() -> None:
    first, again, other = (painted_table(*SHAPE, np.random.default_rng(k)) for k in (4, 4, 5))
    assert first.shape == (*SHAPE, 3)
    assert first.dtype == np.float32
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).mean() > 0.05


def test_tables_have_edges_of_all_directions_and_contrasts() -> None:
    rng = np.random.default_rng(0)
    tables = [painted_table(*SHAPE, rng) for _ in range(60)]
    assert min(table.min() for table in tables) >= 0
    assert max(table.max() for table in tables) <= 1
    steps = np.array([np.percentile(np.abs(np.diff(t, axis=1)).max(axis=2), 99) for t in tables])
    assert np.percentile(steps, 10) < 0.3
    assert np.percentile(steps, 90) > 0.8
    colour = [np.ptp(table, axis=2).mean() for table in tables]
    assert min(colour) < 0.05 < 0.3 < max(colour)
    across, down = (
        np.array([np.abs(np.diff(table, axis=axis)).mean() for table in tables]) for axis in (1, 0)
    )
    assert (across > 2 * down).any()
    assert (down > 2 * across).any()


@pytest.mark.parametrize("pattern", _PATTERNS)
def test_every_pattern_differs_from_a_plain_table(pattern: painted_tables.Pattern) -> None:
    rng = np.random.default_rng(1)
    drawn = [pattern(SHAPE, rng) for _ in range(12)]
    assert {table.shape for table in drawn} == {(*SHAPE, 3)}
    assert {table.dtype for table in drawn} == {np.dtype(np.float32)}
    assert np.mean([table.std(axis=(0, 1)).max() > 0.02 for table in drawn]) > 0.7
