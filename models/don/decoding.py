"""From probabilities over pixels to a position, and to a few Gaussians."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

Decode = Literal["argmax", "median", "soft", "trace"]

REFINE_PX = 1.5
"""Radius of the neighbourhood whose mean gives the fraction of a pixel."""

_MEDIAN_PIXELS = 256
_MODES = 5
_LEAST_WEIGHT = 0.02


def decode_position(log_p: torch.Tensor, uv_px: torch.Tensor, how: Decode) -> torch.Tensor:
    """Return one position a query.

    Args:
        log_p: float (Q, M), log probabilities over the candidates.
        uv_px: float (M, 2), the candidates.
        how: `argmax`, the most probable pixel; `median`, the pixel with the least expected
            distance; both then moved to the mean of their neighbourhood. `soft`, the mean.
            `trace` is `median` of probabilities that already contain the traces.

    Returns:
        float (Q, 2).
    """
    p = log_p.exp()
    if how == "soft":
        return p @ uv_px
    if how == "argmax":
        chosen = p.argmax(dim=1)
    else:
        weight, index = p.topk(min(_MEDIAN_PIXELS, p.shape[1]), dim=1)  # (Q, k)
        places = uv_px[index]  # (Q, k, 2)
        expected = (torch.cdist(places, places) @ weight[..., None])[..., 0]  # (Q, k)
        chosen = index.gather(1, expected.argmin(dim=1, keepdim=True))[:, 0]
    weight = p * (_squared_gap(uv_px[chosen], uv_px) <= REFINE_PX**2)
    return weight @ uv_px / weight.sum(dim=1, keepdim=True).clamp_min(1e-30)


def _squared_gap(from_px: torch.Tensor, to_px: torch.Tensor) -> torch.Tensor:
    """Return squared distances, float (Q, M), of positions (Q, 2) and (M, 2)."""
    # Not by matrix products, whose rounding is larger than the narrowest modes.
    gap = torch.cdist(from_px, to_px, compute_mode="donot_use_mm_for_euclid_dist")
    return gap.square()


@dataclass(frozen=True)
class Widths:
    """What standard deviation a variance of p stands for: sqrt(spread^2 s^(2 power) + floor^2).

    s^2 is the larger of variance - blur^2 and variance / 100. A network that was taught a target
    of some width spreads its probability at least as wide, however sure the place is: that blur
    comes off. What remains is scaled, and set apart: networks of this kind are too modest where
    they are sure, and too sure where they are not.

    Attributes:
        floor_px: Added in squares: a pixel is not a point.
        spread: Times the standard deviation.
        blur_px: Taken off in squares.
        power: Exponent of the standard deviation in pixels of the network.
    """

    floor_px: float
    spread: float = 1.0
    blur_px: float = 0.0
    power: float = 1.0

    def of(self, variance_px2: torch.Tensor) -> torch.Tensor:
        """Return standard deviations: float, of the variances' shape.

        Args:
            variance_px2: float, any shape, variance per axis.
        """
        sharp = torch.maximum(variance_px2 - self.blur_px**2, variance_px2 / 100).clamp_min(0)
        return (self.spread**2 * sharp**self.power + self.floor_px**2).sqrt()


def mixture_of_modes(
    log_p: torch.Tensor, uv_px: torch.Tensor, widths: Widths, radius_px: float = 4.0
) -> tuple[torch.Tensor, torch.Tensor]:
    """Sum probabilities up as a few isotropic Gaussians.

    The most probable pixel takes everything within a radius as one mode, then the next of what
    remains, up to four times; the rest becomes one wide mode.

    Args:
        log_p: float (Q, M).
        uv_px: float (M, 2).
        widths: What standard deviation a mode's variance stands for.
        radius_px: Radius of a mode: small for ropes, whose modes are apart; large for cloths.

    Returns:
        modes float (Q, 5, 4) of (u, v, sigma, weight); used bool (Q, 5). Weights of the used
        modes sum to 1; modes of less than 2 % are left out, the first never.
    """
    left = log_p.exp()
    modes = []
    for number in range(_MODES):
        if number < _MODES - 1:
            peak = uv_px[left.argmax(dim=1)]  # (Q, 2)
            part = left * (_squared_gap(peak, uv_px) <= radius_px**2)
        else:
            part = left
        left = left - part
        weight = part.sum(dim=1)
        share = part / weight.clamp_min(1e-30)[:, None]
        mean = share @ uv_px
        squares = (share * _squared_gap(mean, uv_px)).sum(dim=1) / 2
        sigma = widths.of(squares)
        modes.append(torch.cat([mean, sigma[:, None], weight[:, None]], dim=1))
    stacked = torch.stack(modes, dim=1)
    used = stacked[..., 3] >= _LEAST_WEIGHT
    used[:, 0] = True
    weight = torch.where(used, stacked[..., 3], 0.0)
    stacked[..., 3] = weight / weight.sum(dim=1, keepdim=True)
    return stacked, used
