from __future__ import annotations

import numpy as np
import pytest
import torch

from pliant.models.don.tracing import TracedPlaces

GRID = np.stack(np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5), axis=-1).reshape(-1, 2)


def places(*uv: tuple[float, float], weight: tuple[float, ...] = ()) -> TracedPlaces:
    """One query, a place from each pair of traces."""
    given = np.array(weight or [1.0] * len(uv))
    return TracedPlaces(np.array(uv)[:, None], given / given.sum(), 2.0)


def log_p_at(*uv: tuple[float, float]) -> torch.Tensor:
    """A network that is equally sure of several places."""
    gap = np.min([((GRID - at) ** 2).sum(axis=1) for at in uv], axis=0)
    return torch.from_numpy(np.exp(-gap / 8) + 1e-9)[None].float().log().log_softmax(dim=1)


def test_of_two_places_the_one_on_the_trace_wins() -> None:
    """A traced place between candidates of a network that cannot tell two strands apart."""
    both = log_p_at((10.5, 10.5), (30.5, 20.5))
    weighed = places((30.0, 20.0)).weighed_in(both, GRID)
    assert float(weighed.exp().sum()) == pytest.approx(1, abs=1e-5)
    assert np.linalg.norm(GRID[int(weighed.argmax())] - (30.5, 20.5)) < 1.5
    assert np.linalg.norm(GRID[int(both.argmax())] - (10.5, 10.5)) < 1.5


def test_a_trace_far_from_a_sure_network_is_outvoted() -> None:
    sure = 40 * log_p_at((10.5, 10.5)).log_softmax(dim=1)
    weighed = places((30.0, 20.0)).weighed_in(sure.log_softmax(dim=1), GRID)
    assert np.linalg.norm(GRID[int(weighed.argmax())] - (10.5, 10.5)) < 1.5


def test_refining_averages_the_places_near_by() -> None:
    found = places((10.0, 10.0), (11.0, 10.0), (30.0, 20.0), weight=(0.3, 0.1, 0.6))
    np.testing.assert_allclose(found.refined(np.array([[10.6, 10.4]])), [[10.25, 10.0]])
    np.testing.assert_allclose(found.refined(np.array([[20.0, 5.0]])), [[20.0, 5.0]])
