"""The regularisers against loops and values by hand: stretch, orientation, Lipschitz bounds."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch

from pliant.models.losses.regularisers import (
    lipschitz_space_loss,
    lipschitz_time_loss,
    orientation_loss,
    penalty_weight,
    soft_argmax,
    stretch_loss,
)
from pliant.models.networks.canonical import CanonicalHead
from pliant.spec.model import MaterialCoordinate, MaterialObject

SIDE_M = (0.6, 0.3)
REACH_M = 0.12
SHARP = torch.tensor(1e6)


def cloth_head(monkeypatch: pytest.MonkeyPatch, period: float | None = None) -> CanonicalHead:
    """A head whose embeddings are its anchors in metres, on a grid of 31 x 31 of them."""
    u, v = np.meshgrid(np.linspace(0, 1, 31), np.linspace(0, 1, 31))
    material = np.stack([u, v], axis=-1).reshape(-1, 2)
    axes = (
        MaterialCoordinate("u", 0.0, 1.0, SIDE_M[0]),
        MaterialCoordinate("v", 0.0, 1.0, SIDE_M[1], period),
    )
    head = CanonicalHead.of_object(2, MaterialObject(1, "cloth", axes), material)
    monkeypatch.setattr(head, "embeddings", lambda: head.anchors * head.scale_m)
    return head


def some_points(count: int) -> torch.Tensor:
    """Material coordinates on the grid, in the quarter next to the origin, (1, count, 2)."""
    return torch.from_numpy(np.random.default_rng(1).integers(0, 15, (1, count, 2)) / 30).float()


def loss(head: CanonicalHead, seen_m: torch.Tensor, material: torch.Tensor) -> float:
    visible = torch.ones(material.shape[:2], dtype=torch.bool)
    found = stretch_loss(head, seen_m, material, visible, scale=SHARP, reach_m=REACH_M)
    return float(found)


def test_an_exact_map_costs_nothing_and_a_shifted_one_neither(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    head, material = cloth_head(monkeypatch), some_points(20)
    assert loss(head, material * head.scale_m, material) == pytest.approx(0, abs=1e-5)
    assert loss(head, (material + 0.3) * head.scale_m, material) == pytest.approx(0, abs=1e-5)


def test_a_map_of_twice_the_size_costs_what_a_loop_over_pairs_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    head, material = cloth_head(monkeypatch), some_points(20)
    places = (material[0] * head.scale_m).tolist()
    costs = []
    for a, b in itertools.combinations(places, 2):
        squared = math.dist(a, b) ** 2
        if squared <= REACH_M**2:  # the steps are off by their own length
            costs.append(math.sqrt(1 + squared / (squared + REACH_M**2 / 100)) - 1)
    assert 20 < len(costs) < 190
    doubled = loss(head, 2 * material * head.scale_m, material)
    assert doubled == pytest.approx(sum(costs) / len(costs), rel=1e-3)


def test_hidden_points_and_angles_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    head = cloth_head(monkeypatch, period=1.0)
    material = some_points(12)
    wrong_angles = (material + torch.tensor([0.0, 0.2]) * torch.rand(1, 12, 1)) * head.scale_m
    assert loss(head, wrong_angles, material) == pytest.approx(0, abs=1e-4)
    seen = torch.randn(1, 12, 2, requires_grad=True)
    visible = torch.arange(12)[None] != 4
    stretch_loss(
        head, seen, material, visible, scale=torch.tensor(50.0), reach_m=REACH_M
    ).backward()
    assert seen.grad is not None
    assert bool((seen.grad[0] != 0).any(dim=1)[4]) is False
    assert int((seen.grad[0] != 0).any(dim=1).sum()) >= 8


def test_by_hand() -> None:
    none = math.nan
    target = torch.tensor(
        [[[1.0, 0, 0.5], [0, 1, none], [0.6, 0.8, -1], [none, none, 0]]], dtype=torch.float64
    )
    predicted = torch.tensor(
        [[[1.0, 0, 0], [0, -1, 7], [0, 0, -1], [5, 5, 0.5]]], dtype=torch.float64
    )
    visible = torch.ones(1, 4, dtype=torch.bool)
    # Directions: 0 for the right way, 4 for the opposite one, 1 for no answer; three known.
    # Sines: 1/4, 0, 1/4 over three known, four times.
    assert float(orientation_loss(predicted, target, visible)) == pytest.approx(5 / 3 + 4 / 6)
    visible[0, 1] = visible[0, 3] = False
    assert float(orientation_loss(predicted, target, visible)) == pytest.approx(1 / 2 + 4 / 8)
    assert float(orientation_loss(predicted, target, torch.zeros_like(visible))) == 0.0


def test_gradients() -> None:
    generator = torch.Generator().manual_seed(0)
    predicted = torch.randn(2, 5, 3, dtype=torch.float64, generator=generator, requires_grad=True)
    target = torch.randn(2, 5, 3, dtype=torch.float64, generator=generator)
    target[1, 2, :2] = math.nan
    target[0, 1, 2] = math.nan
    visible = torch.rand(2, 5, generator=generator) > 0.3
    assert torch.autograd.gradcheck(lambda x: orientation_loss(x, target, visible), predicted)
    orientation_loss(predicted, target, visible).backward()
    assert predicted.grad is not None
    assert predicted.grad.isfinite().all()
    known = target.isfinite()
    assert torch.equal(predicted.grad != 0, visible[..., None] & known)


def test_a_reversible_rope_may_be_answered_either_way_but_one_way_in_an_image() -> None:
    generator = torch.Generator().manual_seed(1)
    target = torch.randn(2, 6, 3, generator=generator)
    visible = torch.ones(2, 6, dtype=torch.bool)
    other = target * torch.tensor([1.0, -1.0])[:, None, None]  # the second image reversed
    assert float(orientation_loss(other, target, visible)) > 1
    assert float(orientation_loss(other, target, visible, reversible=True)) == 0
    mixed = target.clone()
    mixed[:, ::2] *= -1  # half of the points of an image
    assert float(orientation_loss(mixed, target, visible, reversible=True)) > 1


D = torch.float64


@pytest.mark.parametrize(
    ("hidden", "near", "expected"),
    [
        # max(0, 4 - 2) + max(0, 1 - 2) + max(0, 5 - 4) = 3, times mu, over three pairs
        ([], None, 0.5),
        ([1], None, 0.5),  # one pair is left: 0.5 * (5 - 4)
        ([], (0, 2), 0.5),  # of the three pairs, which violate by 2, 1 and 0 px, the second alone
        ([], (0, 1), 1.0),
    ],
)
def test_space_by_hand(hidden: list[int], near: tuple[int, int] | None, expected: float) -> None:
    """Three pixels: pairs 1 px apart map 4, 1 and 5 px apart with L = 2 (the last pair 2 px)."""
    pixels = torch.tensor([[[0.0, 0], [1, 0], [2, 0]]], dtype=D)
    predicted = torch.tensor([[[0.0, 0], [4, 0], [5, 0]]], dtype=D)
    valid = torch.ones(1, 3, dtype=torch.bool)
    valid[0, hidden] = False
    pairs = torch.ones(1, 3, 3, dtype=torch.bool)
    if near is not None:
        pairs[:] = False
        pairs[0, near, near[::-1]] = True
    loss = lipschitz_space_loss(predicted, pixels, valid, pairs, lipschitz=2.0, mu=0.5)
    assert float(loss) == pytest.approx(expected)


def test_time_by_hand() -> None:
    pixels = torch.tensor([[[10.0, 10], [20, 10]], [[0, 0], [0, 0]]], dtype=D)
    predicted = torch.tensor([[[13.0, 14], [20, 11]], [[90, 0], [90, 0]]], dtype=D)
    action = torch.tensor([2.0, math.inf], dtype=D)
    valid = torch.ones(2, 2, dtype=torch.bool)
    loss = lipschitz_time_loss(predicted, pixels, action, valid, lipschitz=1.5, mu=2.0)
    # 2 (5 - 3) + 0 over two queries; frames of different episodes are not compared
    assert float(loss) == pytest.approx(2.0)


def test_nothing_to_compare_costs_nothing() -> None:
    pixels = torch.zeros(1, 2, 2, dtype=D)
    none = torch.zeros(1, 2, dtype=torch.bool)
    pairs = torch.ones(1, 2, 2, dtype=torch.bool)
    assert float(lipschitz_space_loss(pixels, pixels, none, pairs, lipschitz=1.0, mu=1.0)) == 0.0
    action = torch.tensor([math.inf], dtype=D)
    assert float(lipschitz_time_loss(pixels, pixels, action, ~none, lipschitz=1.0, mu=1.0)) == 0.0


@pytest.mark.parametrize("kind", ["space", "time"])
def test_gradients_reach_the_descriptors(kind: str) -> None:
    """Through the soft-argmax, where an argmax would have none."""
    g = torch.Generator().manual_seed(0)
    logits = torch.randn(2, 6, 9, dtype=D, generator=g).requires_grad_()
    grid = torch.rand(2, 9, 2, dtype=D, generator=g) * 20
    pixels = torch.rand(2, 6, 2, dtype=D, generator=g) * 4
    valid = torch.ones(2, 6, dtype=torch.bool)
    near = torch.ones(2, 6, 6, dtype=torch.bool)
    action = torch.tensor([0.5, 1.0], dtype=D)

    def loss(values: torch.Tensor) -> torch.Tensor:
        predicted = soft_argmax(values.log_softmax(dim=-1), grid)
        if kind == "space":
            return lipschitz_space_loss(predicted, pixels, valid, near, lipschitz=0.3, mu=1.0)
        return lipschitz_time_loss(predicted, pixels, action, valid, lipschitz=1.0, mu=1.0)

    assert torch.autograd.gradcheck(loss, (logits,))
    (gradient,) = torch.autograd.grad(loss(logits), (logits,))
    assert float(gradient.abs().sum()) > 0.1


def test_equal_predictions_have_a_finite_gradient() -> None:
    predicted = torch.zeros(1, 3, 2, dtype=D, requires_grad=True)
    pixels = torch.zeros(1, 3, 2, dtype=D)
    valid, near = torch.ones(1, 3, dtype=torch.bool), torch.ones(1, 3, 3, dtype=torch.bool)
    loss = lipschitz_space_loss(predicted, pixels, valid, near, lipschitz=1.0, mu=1.0)
    (gradient,) = torch.autograd.grad(loss, (predicted,))
    assert bool(torch.isfinite(gradient).all())


def test_mu_grows_geometrically() -> None:
    assert penalty_weight(0.0, 0.01, 1.0) == pytest.approx(0.01)
    assert penalty_weight(0.5, 0.01, 1.0) == pytest.approx(0.1)
    assert penalty_weight(2.0, 0.01, 1.0) == pytest.approx(1.0)
