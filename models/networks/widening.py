"""A U-Net with more channels that computes the same: Net2Net (arXiv 1511.05641, section 3.1).

Training a wide network from there keeps what the narrow one has learned.
"""

from __future__ import annotations

from typing import Final

import torch

from pliant.models.networks.unet import UNet

_UNLIKE: Final = 0.3  # standard deviation of what copies differ by, of that of the weights


def widen(narrow: UNet, wide: UNet) -> None:
    """Give a network the function of another one with half its channels at some of the levels.

    Every channel is there twice, and both copies together have the weight of the one. Copies differ
    by noise that cancels, since copies that are alike would stay alike in training.

    Args:
        narrow: A network.
        wide: One with as many or twice as many channels at each level; it is changed.
    """
    given, shapes = narrow.state_dict(), {k: v.shape for k, v in wide.state_dict().items()}
    weights = {name: _wider(values, shapes[name]) for name, values in given.items()}
    for name, values in weights.items():
        if ".qkv." in name and values.shape != given[name].shape:
            # Twice as many channels double the products of queries and keys; attention divides
            # them by the square root of that number.
            values[: 2 * len(values) // 3] *= 2**-0.25
    wide.load_state_dict(weights)


def _wider(weights: torch.Tensor, shape: torch.Size) -> torch.Tensor:
    """Return a parameter (outputs, inputs, …) with twice as many outputs, inputs or both."""
    if shape[0] == 2 * len(weights):
        weights = weights.repeat_interleave(2, dim=0)
    if weights.shape == shape:
        return weights
    copied = shape[1] - weights.shape[1]  # a decoder's inputs: first the copied ones of below
    noise = _UNLIKE * weights.std() * torch.randn_like(weights[:, :copied])
    half = weights[:, :copied] / 2
    twice = torch.stack([half + noise, half - noise], dim=2).flatten(1, 2)
    return torch.cat([twice, weights[:, copied:]], dim=1)
