"""Distances, nearest neighbours and the ratio test, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.features.local_features import ROWS_AT_ONCE, distances, nearest, ratio_test


def rows(*values: tuple[float, ...]) -> np.ndarray:
    return np.array(values, dtype=np.float32)


def bits(*values: int) -> np.ndarray:
    return np.array([[value] for value in values], dtype=np.uint8)


def test_euclidean_distance() -> None:
    found = distances(rows((0, 0), (3, 4)), rows((3, 4), (0, 1), (0, 0)), "euclidean")
    np.testing.assert_allclose(found, [[5, 1, 0], [0, np.sqrt(18), 5]], rtol=1e-6)


def test_distances_of_whole_numbers_are_exact() -> None:
    """SIFT's descriptors have a length near 512; float32 holds their squares."""
    rng = np.random.default_rng(0)
    a, b = (rng.integers(0, 91, (40, 128)) for _ in range(2))
    exact = np.sqrt(((a[:, None] - b[None]) ** 2).sum(axis=2)).astype(np.float32)
    np.testing.assert_array_equal(distances(a, b, "euclidean"), exact)


def test_first_of_equals_is_taken_and_no_choice_is_said() -> None:
    row, decided = nearest(rows((0,), (5,)), rows((4,), (6,), (4,)), "euclidean")
    assert row.tolist() == [0, 0]  # 4 is nearer to 0; 4 and 6 are equally near to 5
    assert decided.tolist() == [True, False]


def test_single_candidate_is_no_choice() -> None:
    assert nearest(rows((1,)), rows((9,)), "euclidean")[1].tolist() == [False]


def test_queries_beyond_one_block() -> None:
    count = 2 * ROWS_AT_ONCE + 3
    candidates = np.arange(count, dtype=np.float32)[:, None]
    row, decided = nearest(candidates[::-1], candidates, "euclidean")
    np.testing.assert_array_equal(row, np.arange(count)[::-1])
    assert decided.all()
    a, b, _ = ratio_test(candidates[::-1], candidates, "euclidean", 0.8)
    np.testing.assert_array_equal(a, np.arange(count))
    np.testing.assert_array_equal(b, np.arange(count)[::-1])


@pytest.mark.parametrize(
    ("second", "score"),
    [
        (6.25, None),  # 5 / 6.25 = 0.8: not below the threshold
        (6.26, 1 - 5 / 6.26),
        (10.0, 0.5),
    ],
)
def test_ratio_is_strictly_below(second: float, score: float | None) -> None:
    a, b, scores = ratio_test(rows((0.0,)), rows((second,), (5.0,)), "euclidean", 0.8)
    if score is None:
        assert len(a) == len(b) == len(scores) == 0
    else:
        assert (a.tolist(), b.tolist()) == ([0], [1])
        np.testing.assert_allclose(scores, [score], rtol=1e-5)


def test_ratio_of_bits() -> None:
    a, b, scores = ratio_test(bits(0b0000, 0b0011), bits(0b0001, 0b1111), "hamming", 0.8)
    # 0000: 1 and 4 bits, ratio 1/4. 0011: 1 and 2 bits, ratio 1/2.
    assert (a.tolist(), b.tolist()) == ([0, 1], [0, 0])
    assert scores.tolist() == [0.75, 0.5]


def test_twins_in_the_target_are_ambiguous() -> None:
    assert len(ratio_test(rows((1.0,)), rows((1.0,), (1.0,)), "euclidean", 0.8)[0]) == 0


@pytest.mark.parametrize(("count_a", "count_b"), [(0, 5), (5, 0), (5, 1)])
def test_no_second_nearest_no_match(count_a: int, count_b: int) -> None:
    a, b, scores = ratio_test(
        np.zeros((count_a, 2), np.float32), np.ones((count_b, 2), np.float32), "euclidean", 0.8
    )
    assert (len(a), len(b), len(scores)) == (0, 0, 0)
