from __future__ import annotations

import copy

import pytest
import torch
from torch import nn

from pliant.models.training.muon import Muon, is_matrix, orthogonalised


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
    optimiser = Muon([{"params": [conv.weight], "lr": 0.02, "muon": True}])
    conv(torch.randn(8, 4, 9, 9)).square().mean().backward()
    optimiser.step()
    moved = torch.linalg.svdvals((conv.weight.detach() - before).flatten(1)) / 0.02
    assert moved.max() < 1.3
    assert moved.median() > 0.6


def test_state_goes_on_where_it_stood() -> None:
    torch.manual_seed(4)
    net = nn.Sequential(nn.Linear(8, 32), nn.SiLU(), nn.Linear(32, 2))
    x, y = torch.randn(64, 8), torch.randn(64, 2)

    def optimiser_of(network: nn.Module) -> Muon:
        matrices = [p for p in network.parameters() if is_matrix(p)]
        rest = [p for p in network.parameters() if not is_matrix(p)]
        return Muon([{"params": matrices, "muon": True, "lr": 0.02}, {"params": rest, "lr": 0.01}])

    def steps(network: nn.Module, optimiser: Muon, count: int) -> float:
        for _ in range(count):
            optimiser.zero_grad()
            loss = ((network(x) - y) ** 2).mean()
            loss.backward()
            optimiser.step()
        return float(loss.detach())

    whole, first = net, copy.deepcopy(net)
    started = float(((net(x) - y) ** 2).mean().detach())
    ended = steps(whole, optimiser_of(whole), 40)
    assert ended < 0.9 * started
    optimiser = optimiser_of(first)
    steps(first, optimiser, 20)
    second = copy.deepcopy(first)
    resumed = optimiser_of(second)
    resumed.load_state_dict(optimiser.state_dict())
    steps(second, resumed, 20)
    for a, b in zip(whole.parameters(), second.parameters(), strict=True):
        assert torch.equal(a, b)
