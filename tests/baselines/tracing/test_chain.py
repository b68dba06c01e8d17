from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.tracing import Likelihood, rope_traces
from pliant.baselines.tracing.chain import Evidence, sampled_paths
from pliant.baselines.tracing.settings import TRACING
from tests.baselines.tracing.test_tracing import arc_places, loop, painted, wave

STEPS = TRACING.chain_steps


def place_likelihood(curve: np.ndarray, sharpness: float = 20.0) -> Likelihood:
    """What a noisy observer of the share of the length sees: the nearest point of the curve."""
    passed = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    share = passed / passed[-1]
    steps = (np.arange(STEPS) + 0.5) / STEPS

    def likelihood(uv_px: np.ndarray) -> np.ndarray:
        nearest = np.linalg.norm(uv_px[:, None] - curve[None], axis=2).argmin(axis=1)
        off = (share[nearest][:, None] - steps) * sharpness
        return np.exp(-(off**2)) + 0.05

    return likelihood


@pytest.mark.parametrize(
    "curve",
    [
        pytest.param(wave(), id="wave"),
        pytest.param(wave(2.0, 60.0), id="tilted", marks=pytest.mark.long),
        pytest.param(loop(), id="loop", marks=pytest.mark.long),
    ],
)
def test_sampled_paths_follow_the_rope(curve: np.ndarray) -> None:
    mask, _ = painted(curve, ball=False)
    pixels = np.argwhere(mask)
    evidence = Evidence(
        pixels, np.ones(len(pixels), bool), place_likelihood(curve)(pixels[:, ::-1] + 0.5)
    )
    length = np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
    paths = sampled_paths(evidence, float(length), 12)
    assert len(paths) == pytest.approx(12, abs=2)
    shares = (np.arange(STEPS) + 0.5) / STEPS
    errors = [np.linalg.norm(path - arc_places(curve, shares), axis=1) for path in paths]
    assert np.median(errors) < 4
    assert np.max(errors) < 15
    assert all(mask[tuple(np.floor(path[:, ::-1]).astype(int).T)].mean() > 0.97 for path in paths)


def test_samples_are_the_same_in_every_call() -> None:
    mask, _ = painted(wave(), ball=False)
    pixels = np.argwhere(mask)
    evidence = Evidence(pixels, np.ones(len(pixels), bool), np.ones((len(pixels), STEPS)))
    first, second = (sampled_paths(evidence, 260.0, 4) for _ in range(2))
    np.testing.assert_array_equal(np.stack(first), np.stack(second))


def test_what_is_seen_tells_the_ends_of_a_rope_without_ball_apart() -> None:
    """Walkers start at both ends; only the likelihood says which end is the first."""
    curve = wave()
    mask, objects = painted(curve, ball=False)
    traces = rope_traces(mask, objects, place_likelihood(curve))
    right = [np.linalg.norm(trace.uv_px[0] - curve[0]) < 25 for trace in traces]
    assert np.mean(right) > 0.6  # half of the walkers, and every sample


def test_a_hidden_part_near_the_first_end_is_crossed() -> None:
    """The ball hides the rope's first part: paths may begin behind it, and nowhere else."""
    curve = wave()
    mask, objects = painted(curve)
    pixels = np.argwhere(objects)
    evidence = Evidence(
        pixels, mask[tuple(pixels.T)], place_likelihood(curve)(pixels[:, ::-1] + 0.5)
    )
    length = np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
    for path in sampled_paths(evidence, float(length), 6):
        assert np.linalg.norm(path[0] - curve[0]) < 25
        assert mask[tuple(np.floor(path[20:, ::-1]).astype(int).T)].mean() > 0.97


@pytest.mark.parametrize("size", [(5, 5), (3, 40)])
def test_no_path_is_none(size: tuple[int, int]) -> None:
    """A rope that is longer than its mask can hold: every path leaves it."""
    pixels = np.argwhere(np.ones(size, bool))
    evidence = Evidence(pixels, np.ones(len(pixels), bool), np.ones((len(pixels), STEPS)))
    assert sampled_paths(evidence, 2000.0, 8) == []
