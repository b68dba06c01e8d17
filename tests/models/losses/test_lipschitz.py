from __future__ import annotations

import math

import pytest
import torch

from pliant.models.losses.regularisers import (
    lipschitz_space_loss,
    lipschitz_time_loss,
    penalty_weight,
    soft_argmax,
)

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
