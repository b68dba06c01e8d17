"""Queries interpolated between matches, on printed cards whose motion is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pliant.baselines import Frame
from pliant.baselines.adapters import Images, from_sparse
from pliant.baselines.answers import checked_matches
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.frame import Pair
from tests.baselines.adapters.conftest import counted
from tests.baselines.cards import Motion

Floats = np.ndarray


@pytest.fixture
def keypoints() -> Floats:
    """Places on the card around the queries, in its own px."""
    return np.random.default_rng(5).uniform(-60, 60, (150, 2))


@pytest.mark.parametrize(
    ("neighbours", "way", "most_px"), [(1, "nearest", 12), (8, "affine", 0.05)]
)
@pytest.mark.parametrize("coordinates", ["pixel", "index", "normalised"])
@pytest.mark.parametrize("size", [None, (100, 150)])
def test_matches_of_a_turned_card(
    neighbours: int, way: str, most_px: float, coordinates: Any, size: Any,
    motion: Motion, keypoints: Floats,
) -> None:  # fmt: skip
    def match(source: Any, target: Any) -> tuple[Floats, Floats]:
        assert source.shape == target.shape == (*(size or (240, 200))[::-1], 3)
        at = motion.before.place(keypoints)
        return counted(at, coordinates, size), counted(motion.move(at), coordinates, size)

    images = Images(size=size, coordinates=coordinates)
    method = from_sparse(match, neighbours=neighbours, images=images)
    assert motion.error(method.answer(motion.pair).uv_px).max() < most_px
    assert way in str(method.describe()["interpolation"])


def test_affine_is_robust_to_wrong_matches(motion: Motion, keypoints: Floats) -> None:
    at = motion.before.place(keypoints)
    to = motion.move(at)
    to[::10] += 60
    method = from_sparse(lambda source, target: (at, to), neighbours=12)
    assert np.median(motion.error(method.answer(motion.pair).uv_px)) < 0.5


@pytest.mark.parametrize("neighbours", [1, 8])
@pytest.mark.parametrize("matches", [1, 2, 3, 9])
def test_few_matches_and_matches_on_one_line(neighbours: int, matches: int) -> None:
    view = Frame(np.zeros((40, 50, 3), np.uint8))
    at = np.stack([np.linspace(5, 45, matches), np.full(matches, 20.0)], axis=1)
    shift = np.array([3, -4])
    at = np.concatenate([at, at[:1]])  # a place that was matched twice
    method = from_sparse(lambda source, target: (at, at + shift), neighbours=neighbours)
    queries = np.array([[5, 20], [30, 35]], np.float32)
    np.testing.assert_allclose(
        method.answer(Pair(view, view, queries)).uv_px, queries + shift, atol=0.01
    )


@pytest.mark.parametrize("matches", [([], []), ([], [], []), np.zeros((2, 0, 2)).tolist()])
def test_no_matches_is_the_middle(matches: Any) -> None:
    view = Frame(np.zeros((40, 50, 3), np.uint8))
    method = from_sparse(lambda source, target: matches)
    found = method.answer(Pair(view, view, np.ones((3, 2), np.float32))).uv_px
    assert found.tolist() == [[25, 20]] * 3


def test_tensors_on_a_device() -> None:
    torch = pytest.importorskip("torch")
    view = Frame(np.full((30, 50, 3), 255, np.uint8))

    def match(source: Any, target: Any) -> Any:
        assert (source.shape, source.dtype) == ((1, 3, 32, 56), torch.float32)
        assert source.max() == 1
        at = torch.tensor([[0.0, 0.0], [56.0, 32.0]], requires_grad=True)
        return at, at, torch.ones(2)

    method = from_sparse(match, images=Images(multiple=8, device="cpu"))
    assert method.match(view, view).uv_b_px.tolist() == [[0, 0], [50, 30]]


def test_wrong_forms_are_one_sentence() -> None:
    with pytest.raises(SubmissionError, match="returned no matches; found None"):
        checked_matches(None, "mine")
    with pytest.raises(CallError, match=r"neighbours: .*found 0"):
        from_sparse(lambda a, b: None, neighbours=0)
    with pytest.raises(CallError, match="'uv'; required: pixel, index or normalised"):
        Images(coordinates="uv")  # type: ignore[arg-type]
