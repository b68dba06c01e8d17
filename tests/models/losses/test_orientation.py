from __future__ import annotations

import math

import pytest
import torch

from pliant.loaders.inputs import NetworkInput
from pliant.models.losses import orientation_loss
from pliant.models.networks.descriptor_network import NetworkSettings, build_network

SMALL = NetworkSettings(widths=(8, 16, 32), descriptor_dim=4)


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


@pytest.mark.parametrize("name", ["unet", "resnet18"])
@pytest.mark.parametrize("normalise", [False, True])
def test_orientation_stands_beside_descriptors(name: str, normalise: bool) -> None:
    settings = NetworkSettings(name=name, widths=(8, 16, 32), descriptor_dim=4, normalise=normalise)
    network = build_network(settings, NetworkInput(), orientation=True).eval()
    image = torch.randn(2, 3, 40, 56)
    with torch.inference_mode():
        out = network.described(image)
        assert torch.equal(network(image), out.descriptors)
    assert out.descriptors.shape == (2, 4, 40, 56)
    assert out.orientation.shape == (2, 3, 40, 56)
    if normalise:  # the length of a descriptor is its own, not shared with the direction
        torch.testing.assert_close(out.descriptors.norm(dim=1), torch.ones(2, 40, 56))
    plain = build_network(settings, NetworkInput()).eval()
    with torch.inference_mode():
        assert plain.described(image).orientation.shape == (2, 0, 40, 56)


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
