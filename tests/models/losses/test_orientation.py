from __future__ import annotations

import math

import pytest
import torch

from pliant.models.losses.orientation import orientation_loss


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
