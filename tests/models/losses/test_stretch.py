"""The stretch loss against a loop over pairs, and on maps whose stretch is known."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch

from pliant.models.losses.stretch import stretch_loss
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
