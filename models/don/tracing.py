"""Decoding along a rope: the traces of both masks, chosen by the descriptors along them.

A network says where a point may be, pixel by pixel, and confuses strands that look alike. A trace
(`pliant.baselines.tracing`) counts along the rope, and goes wrong at crossings. Of all pairs of
traces those count that are plausible, of one length, and along which the descriptors agree:

    p'(y) ~ p(y) * ( sum_k w_k N(y; x_k, sigma^2) + epsilon ),

with x_k where pair k of traces carries the query, and w_k the softmax of the pairs' scores.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt
import torch

from pliant.baselines.matcher import View
from pliant.baselines.tracing import Trace, best_pairs, transferred
from pliant.models.networks.descriptor_network import sample_descriptors

SIGMA_SHARE: Final = 1 / 80
"""Standard deviation of a traced place, as a share of the image's width."""

_EPSILON: Final = 0.02
_PAIRS: Final = 6
_SHARPNESS: Final = 8.0
_EVERY: Final = 5
_MOST: Final = 8.0
_AGREEMENT: Final = 0.25


@dataclass(frozen=True)
class TracedView:
    """An image with its descriptors and its traces.

    Attributes:
        view: The image.
        descriptors: float (D, h, w), at the network's size.
        traces: T traces in pixels of the image.
    """

    view: View
    descriptors: torch.Tensor
    traces: Sequence[Trace]

    def along(self) -> torch.Tensor:
        """Return the descriptors along the traces, float (T, S, D)."""
        stations = np.stack([trace.uv_px[::_EVERY] for trace in self.traces])  # (T, S, 2)
        height, width = self.view.rgb.shape[:2]
        factor = np.array(self.descriptors.shape[:0:-1]) / np.array([width, height])
        places = torch.from_numpy((stations * factor).astype(np.float32))
        found = sample_descriptors(self.descriptors[None], places.flatten(0, 1)[None])
        return found[0].view(*places.shape[:2], -1)


def enlarged(traces: Sequence[Trace], factor: npt.NDArray[np.float64]) -> list[Trace]:
    """Return traces in an image with more pixels.

    Args:
        traces: The traces.
        factor: float64 (2,), pixels of the other image per pixel, (u, v).
    """
    length = float(factor.mean())
    return [
        replace(trace, uv_px=trace.uv_px * factor, length_px=trace.length_px * length)
        for trace in traces
    ]


def traced_log_prior(
    source: TracedView,
    target: TracedView,
    scale: torch.Tensor,
    uv_a_px: npt.NDArray[np.float32],
    candidates_px: npt.NDArray[np.float64],
) -> torch.Tensor:
    """Return what the traces say of each candidate: float32 (N, M), the logarithm of a density.

    Args:
        source: The queries' image, with at least one trace.
        target: The other image, with at least one trace.
        scale: Scalar, inverse temperature.
        uv_a_px: float32 (N, 2), the queries.
        candidates_px: float64 (M, 2), in pixels of the target.
    """
    along = source.along()[:, None] - target.along()[None]  # (T, U, S, D)
    gap = along.square().sum(dim=-1)
    agreement = -_AGREEMENT * (scale * gap).clamp_max(_MOST).mean(dim=-1)
    pairs = best_pairs(source.traces, target.traces, lambda a, b: float(agreement[a, b]), _PAIRS)
    scores = np.array([score for score, _, _ in pairs])
    weights = np.exp(_SHARPNESS * (scores - scores.max()))
    weights /= weights.sum()
    sigma_px = SIGMA_SHARE * target.view.rgb.shape[1]
    total = np.full((len(uv_a_px), len(candidates_px)), _EPSILON)
    for weight, (_, a, b) in zip(weights, pairs, strict=True):
        place = transferred(source.traces[a], target.traces[b], uv_a_px)
        squared = ((place[:, None] - candidates_px[None]) ** 2).sum(axis=-1)
        total += weight * np.exp(-squared / (2 * sigma_px**2))
    return torch.from_numpy(np.log(total).astype(np.float32))
