"""A network that is torn between two sides of a cloth answers all points of a pair on one."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn

from pliant.models.don.matcher import DonMatcher
from pliant.models.don.settings import AnswerSettings
from pliant.models.don.sides import grid_of, side_of
from pliant.spec.arrays import Float32Array, FloatArray
from pliant.spec.frame import Frame, Pair
from tests.known import known
from tests.models.don.planted import planted

SIZE = (240, 180)
PIXELS = np.stack(np.meshgrid(np.arange(240), np.arange(180)), axis=-1).reshape(-1, 2) + 0.5
CLOTH = np.zeros(SIZE[::-1], dtype=np.bool_)
CLOTH[30:150, 60:180] = True
TURN = np.array([[0.97, 0.24], [-0.24, 0.97]])


def moved(places: FloatArray) -> FloatArray:
    """Return where a cloth that is turned a little has its points."""
    return np.asarray((places - [120, 90]) @ TURN + [118, 94])


def mirrored(places: FloatArray) -> FloatArray:
    """Return the places of the other side, seen through the cloth."""
    return np.asarray(places * [-1, 1] + [240, 0])


def torn(points: FloatArray, share: FloatArray) -> torch.Tensor:
    """Return log p, (G, M), with a share of it at one side's place and the rest at the other's."""
    hills = [
        np.exp(-np.square(PIXELS - side[:, None]).sum(axis=2) / 18)
        for side in (moved(points), moved(mirrored(points)))
    ]
    p = share[:, None] * hills[0] + (1 - share[:, None]) * hills[1] + 1e-9
    return torch.from_numpy(p / p.sum(axis=1, keepdims=True)).float().log()


@pytest.mark.parametrize(("mean", "is_mirrored"), [(0.6, False), (0.4, True)])
def test_the_map_is_of_the_side_that_most_of_the_pair_agrees_with(
    mean: float, is_mirrored: bool
) -> None:
    points = grid_of(CLOTH)
    share = np.random.default_rng(1).uniform(mean - 0.4, mean + 0.4, len(points))
    assert 0.2 < (share > 0.5).mean() < 0.8  # point by point, both sides would be answered
    found = known(side_of(points, torn(points, share), torch.from_numpy(PIXELS).float(), SIZE[0]))
    asked = np.array([[70.0, 40.0], [120.0, 90.0], [171.5, 140.2]])
    there = moved(mirrored(asked) if is_mirrored else asked)
    assert np.linalg.norm(found.at(asked) - there, axis=1).max() < 4
    weight = found.log_weight(asked, torch.from_numpy(there).float())
    assert weight.diagonal().min() > -0.1
    assert weight[0, 2] < -3.5


def test_a_network_that_is_sure_of_one_side_is_left_alone() -> None:
    points = grid_of(CLOTH)
    log_p = torn(points, np.full(len(points), 0.97))
    assert side_of(points, log_p, torch.from_numpy(PIXELS).float(), SIZE[0]) is None


LINE = np.stack([np.arange(60.0, 180.0, 4), np.full(30, 90.0)], axis=1)


@pytest.mark.parametrize("points", [*(grid_of(CLOTH)[:few] for few in (0, 1, 2)), LINE])
def test_too_few_points_or_points_on_one_line_have_no_map(points: FloatArray) -> None:
    log_p = torn(points, np.full(len(points), 0.5))
    assert side_of(points, log_p, torch.from_numpy(PIXELS).float(), SIZE[0]) is None


def test_the_grid_lies_on_the_mask() -> None:
    u, v = grid_of(CLOTH).T
    assert 45 <= len(u) <= 70
    assert CLOTH[v.astype(int), u.astype(int)].all()
    assert len(grid_of(np.zeros_like(CLOTH))) == 0


class Undecided(nn.Module):
    """A descriptor says where a pixel is, but not on which half; the picture's grey misleads."""

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        height, width = image.shape[-2:]
        v, u = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
        half = (u - width / 2) * 0.004
        return torch.stack([(u - width / 2).abs() / 10, v / 10, image[0, 0] * 0.6 + half])[None]


def patches(seed: int) -> Frame:
    """Return the cloth in patches of grey that mean nothing."""
    grey = np.random.default_rng(seed).uniform(110, 150, (9, 12)).repeat(20, 0).repeat(20, 1)
    rgb = grey.astype(np.uint8)[..., None].repeat(3, axis=2)
    return Frame(rgb, CLOTH, key=f"patches {seed}")


def matcher(one_side: bool) -> DonMatcher:
    return planted(Undecided(), SIZE, AnswerSettings(one_side=one_side))


def test_a_torn_network_answers_a_pair_on_one_side() -> None:
    asked = np.random.default_rng(5).uniform([62, 34], [178, 146], (60, 2)).astype(np.float32)
    asked = asked[np.abs(asked[:, 0] - 120) > 15]
    pair = Pair(patches(1), patches(2), asked)

    def on_own_half(found: Float32Array) -> float:
        return float(np.mean((found[:, 0] < 120) == (asked[:, 0] < 120)))

    assert 0.2 < on_own_half(matcher(one_side=False).answer(pair).uv_px) < 0.8
    deciding = matcher(one_side=True)
    answered = deciding.answer(pair).uv_px
    assert on_own_half(answered) in (0.0, 1.0)
    alone = [deciding.answer(Pair(pair.source, pair.target, at[None])).uv_px[0] for at in asked[:3]]
    np.testing.assert_allclose(alone, answered[:3], atol=1e-3)  # whatever else is asked
