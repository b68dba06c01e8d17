"""Familiarity: uniform on queries like those of the validation split, 0 on strange ones."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.models.don.familiarity import Asked, Described, Familiarity, fit_familiarity
from pliant.spec.errors import TrainingError

DIM, SIDE = 4, 20
RNG = np.random.default_rng(5)
SPREAD = np.array([1.0, 3.0, 0.5, 2.0])


def picture(share: float = 0.25, shift: float = 0.0, scale: float = 1.0) -> Described:
    """Descriptors on the object are Gaussian; beside it they are far away."""
    mask = np.zeros((SIDE, SIDE), np.bool_)
    mask.reshape(-1)[: int(share * SIDE**2)] = True
    values = RNG.normal(size=(SIDE, SIDE, DIM)) * SPREAD * scale + shift
    values[~mask] += 40
    return Described(values.transpose(2, 0, 1).astype(np.float32), mask)


def asked(source: Described, target: Described, distance: float = 1.0, shift: float = 0) -> Asked:
    query = (RNG.normal(size=(20, DIM)) * SPREAD + shift).astype(np.float32)
    return Asked(source, target, query, RNG.gamma(3.0, distance / 3, 20))


@pytest.fixture(scope="module")
def fitted() -> Familiarity:
    return fit_familiarity([asked(picture(), picture()) for _ in range(100)])


def test_the_score_is_the_share_of_queries_as_unusual(fitted: Familiarity) -> None:
    scores = np.concatenate([fitted.score(asked(picture(), picture())) for _ in range(100)])
    for level in (0.1, 0.3, 0.5, 0.7, 0.9):
        assert np.mean(scores <= level) == pytest.approx(level, abs=0.06)


STRANGE = {
    "query": lambda: asked(picture(), picture(), shift=60),
    "no similar candidate": lambda: asked(picture(), picture(), distance=1e4),
    "source": lambda: asked(picture(shift=30), picture()),
    "target": lambda: asked(picture(), picture(scale=9)),
    "size of the object": lambda: asked(picture(), picture(share=0.9)),
}


@pytest.mark.parametrize("case", STRANGE)
def test_strange_queries_score_nothing(case: str, fitted: Familiarity) -> None:
    assert fitted.score(STRANGE[case]()).max() < 0.01


def test_an_object_of_twice_the_size_is_not_strange(fitted: Familiarity) -> None:
    assert np.median(fitted.score(asked(picture(), picture(share=0.5)))) > 0.2


def test_without_masks_the_query_alone_counts(fitted: Familiarity) -> None:
    bare = [Described(each.descriptors, None) for each in (picture(), picture())]
    assert np.median(fitted.score(asked(bare[0], bare[1]))) > 0.2
    assert fitted.score(asked(bare[0], bare[1], shift=60)).max() < 0.01


def test_it_is_stored_whole(fitted: Familiarity) -> None:
    again = Familiarity.from_document(fitted.as_document(), "familiarity.json")
    query = asked(picture(), picture())
    np.testing.assert_array_equal(again.score(query), fitted.score(query))
    document = {**fitted.as_document(), "mean": [0.0]}
    with pytest.raises(TrainingError, match="the familiarity is damaged"):
        Familiarity.from_document(document, "familiarity.json")
