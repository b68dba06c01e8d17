from __future__ import annotations

from typing import Any

import pytest
import torch

from pliant.models.losses.contrastive import Hinge, contrastive_loss, draw_non_matches
from pliant.models.losses.matches import NonMatches, Targets

D = torch.float64


def case() -> dict[str, Any]:
    """One query at 0 on a line of descriptors: match at 0.1; non-matches at 0.2, 0.4, 2 and 0.3.

    The last one lies a pixel from the match.
    """
    return {
        "query": torch.tensor([[[0.0]]], dtype=D),
        "match": torch.tensor([[[0.1]]], dtype=D),
        "valid": torch.tensor([[True]]),
        "non_match": torch.tensor([[[[0.2], [0.4], [2.0], [0.3]]]], dtype=D),
        "non_match_uv_px": torch.tensor([[[[50.0, 9], [60, 9], [70, 9], [11, 10]]]], dtype=D),
        "match_uv_px": torch.tensor([[[[10.0, 10.0]]]], dtype=D),
        "match_valid": torch.tensor([[[True]]]),
    }


def loss_of(
    inputs: dict[str, torch.Tensor], hinge: Hinge | None = None, chunk: int | None = None
) -> torch.Tensor:
    others = NonMatches(inputs["non_match"], inputs["non_match_uv_px"])
    targets = Targets(inputs["match_uv_px"], inputs["match_valid"])
    queries = (inputs["query"], inputs["match"], inputs["valid"])
    return contrastive_loss(*queries, others, targets, hinge or Hinge(), chunk)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        # 0.1^2 + ((0.5 - 0.2)^2 + (0.5 - 0.4)^2) / 2
        ({}, 0.01 + (0.09 + 0.01) / 2),
        # ... divided by all three that count
        ({"hard_scaling": False}, 0.01 + (0.09 + 0.01) / 3),
        # the hinge itself
        ({"squared": False}, 0.1 + (0.3 + 0.1) / 2),
        # without the guard the fourth counts: (0.5 - 0.3)^2
        ({"guard_px": 0.5}, 0.01 + (0.09 + 0.01 + 0.04) / 3),
    ],
)
def test_by_hand(options: dict[str, Any], expected: float) -> None:
    loss = loss_of(case(), Hinge(margin=0.5, **options))
    assert float(loss) == pytest.approx(expected, abs=1e-9)


def test_the_guard_fires_around_partners_too() -> None:
    inputs = case()
    inputs["match_uv_px"] = torch.tensor([[[[10.0, 10.0], [50.0, 10.0]]]], dtype=D)
    inputs["match_valid"] = torch.tensor([[[True, True]]])
    assert float(loss_of(inputs)) == pytest.approx(0.01 + 0.01)
    inputs["match_valid"] = torch.tensor([[[True, False]]])
    assert float(loss_of(inputs)) == pytest.approx(0.01 + 0.05)


def test_queries_without_a_match_count_for_nothing() -> None:
    inputs = case()
    inputs["valid"] = torch.tensor([[False]])
    assert float(loss_of(inputs)) == 0.0


def random_case(seed: int) -> dict[str, Any]:
    g = torch.Generator().manual_seed(seed)
    return {
        "query": torch.randn(2, 5, 3, dtype=D, generator=g).requires_grad_(),
        "match": torch.randn(2, 5, 3, dtype=D, generator=g).requires_grad_(),
        "valid": torch.rand(2, 5, generator=g) > 0.2,
        "non_match": torch.randn(2, 5, 7, 3, dtype=D, generator=g).requires_grad_(),
        "non_match_uv_px": torch.rand(2, 5, 7, 2, dtype=D, generator=g) * 40,
        "match_uv_px": torch.rand(2, 5, 2, 2, dtype=D, generator=g) * 40,
        "match_valid": torch.rand(2, 5, 2, generator=g) > 0.3,
    }


def test_a_collapsed_network_has_a_finite_gradient() -> None:
    inputs = random_case(1)
    with torch.no_grad():
        for name in ("query", "match", "non_match"):
            inputs[name].zero_()
    loss = loss_of(inputs)
    for gradient in torch.autograd.grad(loss, (inputs["query"], inputs["non_match"])):
        assert bool(torch.isfinite(gradient).all())


def test_chunks_add_up() -> None:
    inputs = random_case(2)
    leaves = (inputs["query"], inputs["match"], inputs["non_match"])
    whole, parts = (loss_of(inputs, Hinge(margin=1.5), chunk=chunk) for chunk in (None, 2))
    torch.testing.assert_close(whole, parts)
    gradients = torch.autograd.grad(whole, leaves)
    torch.testing.assert_close(gradients, torch.autograd.grad(parts, leaves))
    for gradient in gradients:
        assert float(gradient.abs().sum()) > 0.01


def test_half_of_the_non_matches_lie_on_the_object() -> None:
    mask = torch.zeros(2, 8, 10, dtype=torch.bool)
    mask[0, 2:4, 3:6] = True
    mask[1, :, :2] = True
    drawn = draw_non_matches(mask, 4, 10, torch.Generator().manual_seed(0))
    assert drawn.shape == (2, 4, 10, 2)
    u, v = drawn.long().unbind(-1)
    on = mask[torch.arange(2)[:, None, None], v, u]
    assert on[..., :5].all()
    assert not on[..., 5:].any()


def test_non_matches_are_anywhere_in_their_pixels() -> None:
    mask = torch.ones(1, 8, 10, dtype=torch.bool)
    drawn = draw_non_matches(mask, 100, 100, torch.Generator().manual_seed(0))
    counts = torch.histc(drawn.frac(), bins=4, min=0, max=1)
    assert counts.min() > 0.95 * counts.mean()


def test_an_image_without_object_is_drawn_from_as_a_whole() -> None:
    mask = torch.zeros(1, 4, 4, dtype=torch.bool)
    assert draw_non_matches(mask, 2, 4).shape == (1, 2, 4, 2)
