from __future__ import annotations

import math
from typing import Any

import pytest
import torch

from pliant.models.losses import distributional
from pliant.models.losses.distributional import (
    Direction,
    distributional_loss,
    gaussian_target,
    log_probabilities,
)
from pliant.models.losses.matches import Candidates, Targets, all_bins, object_and_background
from pliant.models.networks.descriptor_network import pixel_grid

D = torch.float64
LINE = torch.tensor([[[0.5, 0.5], [1.5, 0.5], [2.5, 0.5]]], dtype=D)
ALL = torch.ones(1, 3, dtype=torch.bool)
ONE = torch.tensor(1.0, dtype=D)


def test_target_by_hand() -> None:
    """Three pixels in a row, truth on the middle one, sigma 1: weights e^-0.5, 1, e^-0.5."""
    middle = torch.tensor([[[[1.5, 0.5]]]], dtype=D), torch.tensor([[[True]]])
    side = math.exp(-0.5)
    for last, weights in ((True, [side, 1.0, side]), (False, [side, 1.0, 0.0])):  # off the object
        q = gaussian_target(LINE, torch.tensor([[True, True, last]]), *middle, 1.0)
        expected = torch.tensor(weights, dtype=D) / sum(weights)
        torch.testing.assert_close(q[0, 0], expected)


def test_modes_have_equal_mass_even_at_an_edge() -> None:
    """A mode at the border has fewer pixels under it, and still half of the mass."""
    grid = pixel_grid(20, 60, 1, torch.device("cpu"))[None].double()
    on = torch.ones(1, 1200, dtype=torch.bool)
    targets = torch.tensor([[[[0.5, 10.5], [40.5, 10.5]]]], dtype=D)
    valid = torch.tensor([[[True, True]]])
    q = gaussian_target(grid, on, targets, valid, 2.0)[0, 0]
    left = float(q[grid[0, :, 0] < 20].sum())
    assert left == pytest.approx(0.5, abs=1e-9)
    one = gaussian_target(grid, on, targets, torch.tensor([[[True, False]]]), 2.0)
    assert float(one[0, 0][grid[0, :, 0] < 20].sum()) == pytest.approx(1.0)


def test_pixels_are_numbered_row_by_row() -> None:
    """Pixel order: a descriptor planted at (row 2, column 4) makes (4.5, 2.5) the answer."""
    descriptors = torch.zeros(1, 2, 5, 7, dtype=D)
    descriptors[0, :, 2, 4] = torch.tensor([3.0, -1.0], dtype=D)
    pool = all_bins(descriptors, torch.ones(1, 5, 7, dtype=torch.bool))
    query = torch.tensor([[[3.0, -1.0]]], dtype=D)
    log_p = log_probabilities(query, pool.descriptors, ONE)
    assert pool.uv_px[0, int(log_p[0, 0].argmax())].tolist() == [4.5, 2.5]
    mean = log_p.exp() @ pool.uv_px.double()
    assert mean[0, 0].tolist() == pytest.approx([4.5, 2.5], abs=0.01)


def test_probabilities_by_hand() -> None:
    query = torch.tensor([[[1.0]]], dtype=D)
    candidates = torch.tensor([[[1.0], [2.0], [9.0]]], dtype=D)
    valid = torch.tensor([[True, True, False]])
    p = log_probabilities(query, candidates, torch.tensor(2.0, dtype=D), valid).exp()[0, 0]
    assert p.tolist() == pytest.approx([1 / (1 + math.exp(-2)), 1 / (1 + math.exp(2)), 0.0])


def two_pixel_loss(direction: Direction) -> float:
    """P is (3/4, 1/4); the truth lies between the pixels, so q is (1/2, 1/2)."""
    query = torch.tensor([[[0.0]]], dtype=D)
    candidates = torch.tensor([[[0.0], [math.sqrt(math.log(3))]]], dtype=D)
    uv = torch.tensor([[[0.5, 0.5], [1.5, 0.5]]], dtype=D)
    both = torch.ones(1, 2, dtype=torch.bool)
    loss = distributional_loss(
        query,
        Candidates(candidates, uv, both),
        Targets(torch.tensor([[[[1.0, 0.5]]]], dtype=D), torch.tensor([[[True]]])),
        scale=ONE,
        sigma_px=1.0,
        direction=direction,
    )
    return float(loss)


def test_both_directions_by_hand() -> None:
    forward = 0.5 * math.log(0.5 / 0.75) + 0.5 * math.log(0.5 / 0.25)
    reverse = 0.75 * math.log(0.75 / 0.5) + 0.25 * math.log(0.25 / 0.5)
    assert two_pixel_loss("forward") == pytest.approx(forward)
    assert two_pixel_loss("reverse") == pytest.approx(reverse)


def bimodal(direction: Direction, logits: torch.Tensor) -> torch.Tensor:
    """The loss of a p given by its logits over 41 pixels, with truths at pixels 10 and 30.

    Descriptors are one-hot, so that the squared distances are free to be anything.
    """
    count = len(logits)
    uv = torch.stack([torch.arange(count) + 0.5, torch.full((count,), 0.5)], dim=-1)[None].double()
    # -|f - g|^2 = 2 f g - |g|^2 up to a constant; with |g| = 1 and f_i = logit_i / 2.
    query = (logits / 2)[None, None]
    every = torch.ones(1, count, dtype=torch.bool)
    return distributional_loss(
        query,
        Candidates(torch.eye(count, dtype=D)[None], uv, every),
        Targets(
            torch.tensor([[[[10.5, 0.5], [30.5, 0.5]]]], dtype=D), torch.tensor([[[True, True]]])
        ),
        scale=ONE,
        sigma_px=1.0,
        direction=direction,
    )


def test_forward_covers_both_modes_and_reverse_is_content_with_one() -> None:
    position = torch.arange(41, dtype=D)
    one = -((position - 10) ** 2) / 2
    two = torch.logaddexp(one, -((position - 30) ** 2) / 2)
    assert float(bimodal("forward", two)) == pytest.approx(0.0, abs=1e-6)
    assert float(bimodal("reverse", two)) == pytest.approx(0.0, abs=1e-6)
    # Missing a mode: the reverse direction pays log 2, the forward one far more.
    assert float(bimodal("reverse", one)) == pytest.approx(math.log(2), abs=0.01)
    assert float(bimodal("forward", one)) > 50


def random_case(seed: int) -> dict[str, torch.Tensor]:
    g = torch.Generator().manual_seed(seed)
    return {
        "query": torch.randn(2, 5, 3, dtype=D, generator=g).requires_grad_(),
        "candidates": torch.randn(2, 11, 3, dtype=D, generator=g).requires_grad_(),
        "candidate_uv_px": torch.rand(2, 11, 2, dtype=D, generator=g) * 10,
        "on_object": torch.rand(2, 11, generator=g) > 0.3,
        "target_uv_px": torch.rand(2, 5, 2, 2, dtype=D, generator=g) * 10,
        "target_valid": torch.rand(2, 5, 2, generator=g) > 0.3,
        "scale": torch.tensor(0.7, dtype=D).requires_grad_(),
    }


def loss_of(inputs: dict[str, torch.Tensor], sigma_px: float, **options: Any) -> torch.Tensor:
    names = ("candidates", "candidate_uv_px", "on_object")
    pool = Candidates(*(inputs[name] for name in names))
    targets = Targets(inputs["target_uv_px"], inputs["target_valid"])
    scale = inputs["scale"]
    return distributional_loss(
        inputs["query"], pool, targets, scale=scale, sigma_px=sigma_px, **options
    )


@pytest.mark.parametrize("direction", ["forward", "reverse"])
def test_gradient(direction: Direction) -> None:
    inputs = random_case(0)
    names = ("query", "candidates", "scale")
    values = tuple(inputs[name] for name in names)

    def loss(*tensors: torch.Tensor) -> torch.Tensor:
        changed = inputs | dict(zip(names, tensors, strict=True))
        return loss_of(changed, sigma_px=2.0, direction=direction)

    assert torch.autograd.gradcheck(loss, values)
    for gradient in torch.autograd.grad(loss(*values), values):
        assert float(gradient.abs().sum()) > 1e-3


def loss_and_gradients(inputs: dict[str, torch.Tensor], **options: Any) -> list[torch.Tensor]:
    leaves = (inputs["query"], inputs["candidates"], inputs["scale"])
    loss = loss_of(inputs, sigma_px=2.0, **options)
    return [loss, *torch.autograd.grad(loss, leaves)]


@pytest.mark.parametrize("direction", ["forward", "reverse"])
@pytest.mark.parametrize("chunk", [1, 2, 7])
def test_chunks_add_up(direction: Direction, chunk: int) -> None:
    inputs = random_case(1)
    whole = loss_and_gradients(inputs, direction=direction)
    parts = loss_and_gradients(inputs, direction=direction, chunk=chunk)
    torch.testing.assert_close(whole, parts)


def test_pieces_of_a_cache_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pieces of two queries, of an odd number, give what one piece an image gives."""
    inputs = random_case(4)
    whole = loss_and_gradients(inputs)
    monkeypatch.setattr(distributional, "_CACHED", 22)
    torch.testing.assert_close(whole, loss_and_gradients(inputs))


@pytest.mark.parametrize("direction", ["forward", "reverse"])
def test_a_target_far_off_the_object_stays_finite(direction: Direction) -> None:
    """In float32, with the truth 500 px away: q is what lies nearest, and the loss a number."""
    inputs = {
        name: value.detach().float() if value.is_floating_point() else value
        for name, value in random_case(5).items()
    }
    inputs["target_uv_px"] = inputs["target_uv_px"] + 500
    inputs["query"].requires_grad_()
    loss = loss_of(inputs, sigma_px=1.0, direction=direction)
    (gradient,) = torch.autograd.grad(loss, inputs["query"])
    assert math.isfinite(float(loss.detach()))
    assert bool(gradient.isfinite().all())


def test_queries_without_a_target_count_for_nothing() -> None:
    inputs = random_case(3)
    inputs["target_valid"][:] = False
    assert loss_of(inputs, sigma_px=2.0).item() == 0.0


def test_every_object_pixel_competes_and_background_fills_up() -> None:
    mask = torch.zeros(2, 6, 8, dtype=torch.bool)
    mask[0, 1:4, 2:5] = True  # 9 pixels
    mask[1, 2, 2:4] = True  # 2 pixels
    descriptors = torch.arange(2 * 48.0).view(2, 1, 6, 8)
    pool = object_and_background(descriptors, mask, 5, torch.Generator().manual_seed(0))
    assert pool.uv_px.shape == (2, 14, 2)
    assert pool.on_object.sum(dim=1).tolist() == [9, 2]
    for n in range(2):
        # The descriptor still belongs to the position that stands beside it.
        column, row = pool.uv_px[n].long().T
        assert torch.equal(pool.descriptors[n, :, 0], descriptors[n, 0, row, column])
        assert len(torch.unique(pool.uv_px[n], dim=0)) == 14


def test_bins_average_descriptors_and_lie_at_their_centres() -> None:
    descriptors = torch.arange(24.0).view(1, 1, 4, 6)
    mask = torch.zeros(1, 4, 6, dtype=torch.bool)
    mask[0, 3, 5] = True
    pool = all_bins(descriptors, mask, bin_px=2)
    assert pool.descriptors[0, :, 0].tolist() == [3.5, 5.5, 7.5, 15.5, 17.5, 19.5]
    assert pool.uv_px[0].tolist() == [[1, 1], [3, 1], [5, 1], [1, 3], [3, 3], [5, 3]]
    assert pool.on_object[0].tolist() == [False] * 5 + [True]
