from __future__ import annotations

import pytest
import torch
from torch import nn

from pliant.models.training.optimiser import Muon, orthogonalised


@pytest.mark.parametrize("shape", [(16, 40), (40, 16), (24, 24)])
def test_singular_vectors_stay_and_values_become_alike(shape: tuple[int, int]) -> None:
    """The singular values 1, 1/2 … of a gradient all come out near 1."""
    torch.manual_seed(0)
    u, _, vt = torch.linalg.svd(torch.randn(shape), full_matrices=False)
    values = torch.linspace(1.0, 0.2, len(vt))
    found = orthogonalised(u @ torch.diag(values) @ vt)
    along = u.T @ found @ vt.T
    assert (along.diagonal() > 0.6).all()
    assert (along.diagonal() < 1.3).all()
    assert (along - torch.diag(along.diagonal())).abs().max() < 0.1


def test_the_size_of_a_gradient_does_not_matter() -> None:
    torch.manual_seed(1)
    gradient = torch.randn(16, 32)
    torch.testing.assert_close(
        orthogonalised(gradient * 1e4), orthogonalised(gradient), atol=0.03, rtol=0
    )


def test_what_is_no_matrix_moves_as_with_adamw() -> None:
    torch.manual_seed(2)
    ours, theirs = nn.Linear(5, 3), nn.Linear(5, 3)
    theirs.load_state_dict(ours.state_dict())
    muon = Muon([{"params": list(ours.parameters()), "lr": 0.01, "weight_decay": 0.1}])
    adamw = torch.optim.AdamW(theirs.parameters(), lr=0.01, weight_decay=0.1)
    x = torch.randn(7, 5)
    for _ in range(20):
        for network, optimiser in ((ours, muon), (theirs, adamw)):
            optimiser.zero_grad()
            (network(x).sin() ** 2).sum().backward()
            optimiser.step()
    torch.testing.assert_close(ours.weight, theirs.weight)
    torch.testing.assert_close(ours.bias, theirs.bias)


def test_a_convolution_moves_by_its_rate_in_every_direction() -> None:
    """One step from zero: all 16 singular values of the move are about the learning rate."""
    torch.manual_seed(3)
    conv = nn.Conv2d(4, 16, 3)
    before = conv.weight.detach().clone()
    optimiser = Muon([{"params": [conv.weight], "lr": 0.02, "muon": True}], weight_decay=0.0)
    conv(torch.randn(8, 4, 9, 9)).square().mean().backward()
    optimiser.step()
    moved = torch.linalg.svdvals((conv.weight.detach() - before).flatten(1)) / 0.02
    assert moved.max() < 1.3
    assert moved.median() > 0.6
