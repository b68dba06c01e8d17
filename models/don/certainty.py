"""From probabilities over pixels to a position and a few Gaussians, and how sure these are.

A `Calibration` is what `calibration.json` of a run contains.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch

from pliant.spec.arrays import Float32Array, FloatArray

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


_LEAST_VARIANCE_PX2 = 0.01


def mean_log_sigma(log_p: torch.Tensor, uv_px: torch.Tensor) -> float:
    """Return the mean log standard deviation of p, in pixels of the network, over N queries.

    Args:
        log_p: float (N, M).
        uv_px: float (M, 2).
    """
    p = log_p.exp()
    about_px = uv_px - uv_px.mean(dim=0)  # small numbers, whose squares keep their digits
    variance = p @ about_px.square().sum(dim=1) - (p @ about_px).square().sum(dim=1)
    return float((variance / 2).clamp_min(_LEAST_VARIANCE_PX2).log().mean() / 2)


@dataclass(frozen=True)
class Calibration:
    """What validation says about the answers' certainty.

    Attributes:
        temperature: Divides the scale of p: above 1 flattens it.
        sigma_floor_px: Smallest spread of a mode, network pixels.
        spread: Times the spread of a mode.
        blur_px: Taken off the spread of a mode in squares before, network pixels.
        power: Exponent of what remains of it.
        stray: Probability that the answer is anywhere on the object.
        mode_radius_px: What is this near to a peak is one mode with it, network pixels.
        visible_at: Squared descriptor distance to the best candidate at which a point is as
            likely visible as hidden, in units of the network's scale.
        visible_slope: Slope of that logistic curve, per unit of log distance; 0 gives no
            `visible` at all (the validation split hides no point).
        figures: What was measured, for the record.
        sharpness: Multiplies log p before everything else: contrastive networks learn no scale.
        tilted: What holds where a view was rectified, whose tilt is estimated; None for no
            difference.
        unmasked: What holds where the masks were found in the pictures, None for no difference.
        either_way: What holds for a rope whose ends look alike, None for no difference.
        doubt_above: Doubt (`mean_log_sigma`) of a pair of views above which `doubtful` holds.
        doubtful: What holds there, None for no difference: one network is too modest on smooth
            cloths and too sure on scrunched ones.
    """

    temperature: float = 1.0
    sigma_floor_px: float = 0.5
    stray: float = 0.01
    visible_at: float = 1.0
    visible_slope: float = 0.0
    figures: Mapping[str, float] | None = None
    spread: float = 1.0
    blur_px: float = 0.0
    power: float = 1.0
    mode_radius_px: float = 4.0
    sharpness: float = 1.0
    tilted: Calibration | None = None
    unmasked: Calibration | None = None
    either_way: Calibration | None = None
    doubt_above: float = 0.0
    doubtful: Calibration | None = None

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Calibration:
        """Return the calibration that `calibration.json` holds.

        Args:
            document: The file's content, as `dataclasses.asdict` gives it.

        Raises:
            TypeError: The content has other fields.
        """
        own = dict(document)
        for name in ("tilted", "unmasked", "either_way", "doubtful"):
            if own.get(name) is not None:
                own[name] = cls.from_document(own[name])
        return cls(**own)

    def for_views(self, *, tilted: bool, unmasked: bool, either_way: bool) -> Calibration:
        """Return what holds for views of a kind: with masks or without, then by the kind of view.

        Args:
            tilted: Whether one of them was rectified.
            unmasked: Whether one of them came without masks.
            either_way: Whether they show a rope whose ends look alike.
        """
        known = self.unmasked if unmasked and self.unmasked is not None else self
        kinds = ((either_way, known.either_way), (tilted, known.tilted))
        return next((own for holds, own in kinds if holds and own is not None), known)

    def where(self, log_p: torch.Tensor, uv_px: torch.Tensor) -> Calibration:
        """Return what holds for one pair of views.

        Args:
            log_p: float (N, M), log probabilities of its queries over the candidates.
            uv_px: float (M, 2), the candidates, in pixels of the network.
        """
        if self.doubtful is None or mean_log_sigma(log_p, uv_px) <= self.doubt_above:
            return self
        return self.doubtful.where(log_p, uv_px)

    @property
    def widths(self) -> Widths:
        """What standard deviation a variance of the calibrated p stands for."""
        return Widths(self.sigma_floor_px, self.spread, self.blur_px, self.power)

    def flattened(self, log_p: torch.Tensor) -> torch.Tensor:
        """Return log p after temperature and stray probability: float (N, M)."""
        flat = (log_p / self.temperature).softmax(dim=1)
        return ((1 - self.stray) * flat + self.stray / log_p.shape[1]).log()

    def visible(self, distance: FloatArray) -> Float32Array:
        """Return the probability that a point is visible, 0.5 at the threshold.

        Args:
            distance: float64 (N,), from `DonMatcher.log_probabilities`.

        Returns:
            float32 (N,).
        """
        log_ratio = np.log(np.maximum(distance, 1e-12) / self.visible_at)
        exponent = np.clip(self.visible_slope * log_ratio, -60.0, 60.0)
        return (1.0 / (1.0 + np.exp(exponent))).astype(np.float32)
