"""A wider network that begins with the function of a narrow one."""

from __future__ import annotations

import torch

from pliant.models.networks.mask_network import NARROW, WIDE, MaskNetwork


def test_a_wider_network_computes_the_same() -> None:
    torch.manual_seed(3)
    narrow = MaskNetwork().eval()
    for values in narrow.parameters():
        torch.nn.init.normal_(values, std=0.5)
    wide = narrow.widened().eval()
    picture = torch.rand(2, 3, 50, 70)
    with torch.inference_mode():
        expected = narrow(picture)
        torch.testing.assert_close(wide(picture), expected, rtol=0, atol=1e-4 * expected.std())
    parameters = [sum(each.numel() for each in of.parameters()) for of in (narrow, wide)]
    assert parameters[1] > 3 * parameters[0]


def test_the_copies_of_a_channel_become_unlike() -> None:
    torch.manual_seed(4)
    wide = MaskNetwork().widened()
    second = wide.get_parameter("encoder.1.conv1.weight")
    torch.testing.assert_close(second[0::2], second[1::2], rtol=0, atol=0)  # incoming weights
    optimiser = torch.optim.SGD(wide.parameters(), lr=0.1)
    for _ in range(2):
        optimiser.zero_grad()
        wide(torch.rand(1, 3, 48, 64)).square().mean().backward()
        optimiser.step()
    apart = (second[0::2] - second[1::2]).flatten(1).norm(dim=1)
    assert float(apart.detach().min()) > 0


def test_weights_say_how_wide_their_network_is() -> None:
    for widths in (NARROW, WIDE):
        weights = MaskNetwork(widths).state_dict()
        MaskNetwork.like(weights).load_state_dict(weights)
    assert len(MaskNetwork.like({}).state_dict()) == len(weights)  # which refuses them by name
