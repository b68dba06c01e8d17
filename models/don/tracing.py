"""Decoding along a rope: the traces of both masks, chosen by the descriptors along them.

A network says where a point may be, pixel by pixel, and confuses strands that look alike. A trace
(`pliant.baselines.tracing`) counts along the rope, and goes wrong at crossings. Of all pairs of
traces those count that are plausible, of one length, and along which the descriptors agree:

    p'(y) ~ p(y)^b * ( sum_k w_k N(y; x_k, sigma^2) + epsilon ),

with x_k where pair k of traces carries the query. The answer is the median of p', moved to the
mean of the places x_k near it: they are finer than the network's pixels. The weights w_k are the
softmax of

    30 (c + c') - 0.3 (b + b') - 1.2 (r + r') - |log(l / l')| - 0.7 mean_s min(d_s, 8),

with c, b, r and l the coverage, bend, retraced share and length of either trace and d_s the scaled
squared distance of their descriptors at station s: the log odds, fitted to rendered ropes, that
both are right. With the small exponent b the network decides between the places of the traces; it
does not overrule them, since it is often sure of the wrong strand at a crossing.

A rope without a ball has two ends alike, and each reading runs either way. Then p' is the mean of
two such distributions, one for either way; all answers of a pair are the medians of the same one.
Where no ball is known of either view, but not that there is none, the answers run the way that the
descriptors say, which is a guess if there is none: p' is the mean of both ways all the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import torch
from scipy.ndimage import gaussian_filter
from scipy.special import softmax

from pliant.baselines.tracing import (
    Likelihood,
    MaskShape,
    Trace,
    has_ball,
    located,
    pair_log_odds,
    placed,
)
from pliant.baselines.tracing.settings import TRACING
from pliant.models.networks.descriptor_network import DescriptorNetwork, sample_descriptors
from pliant.spec.arrays import Float32Array, FloatArray
from pliant.spec.frame import Frame

SIGMA_SHARE: Final = 1 / 213
"""Standard deviation of a traced place, as a share of the image's width."""

_AGREEMENT: Final = 0.7
_PAIRS: Final = 200
_EVERY: Final = 5
_MOST: Final = 8.0
_NETWORK_EXPONENT: Final = 0.1
_EPSILON: Final = 1e-4
_LEAST_WEIGHT: Final = 0.02
_CELLS: Final = 2  # in a standard deviation
_NEAR: Final = 1.25  # standard deviations; places this near to an answer are averaged
_FLOOR: Final = 0.05
_EXPONENT: Final = 0.3


@dataclass(frozen=True)
class TracedView:
    """An image with its descriptors and its traces.

    Attributes:
        view: The image.
        descriptors: float (D, h, w), at the network's size.
        traces: T traces in pixels of the image, the most plausible first.
        shape: The shape of the mask that they follow.
    """

    view: Frame
    descriptors: torch.Tensor
    traces: Sequence[Trace]
    shape: MaskShape

    @property
    def ends_alike(self) -> bool:
        """Whether all objects are known, and a rope without a ball is the only one."""
        return has_ball(self.view) is False

    @property
    def ball_unknown(self) -> bool:
        """Whether a rope is known and no ball, which may be there all the same."""
        return self.view.mask is not None and has_ball(self.view) is None

    def along(self) -> torch.Tensor:
        """Return the descriptors along the traces, float (T, S, D)."""
        stations = np.stack([trace.uv_px[::_EVERY] for trace in self.traces])  # (T, S, 2)
        height, width = self.view.rgb.shape[:2]
        factor = np.array(self.descriptors.shape[:0:-1]) / np.array([width, height])
        places = torch.from_numpy((stations * factor).astype(np.float32))
        found = sample_descriptors(self.descriptors[None], places.flatten(0, 1)[None])
        return found[0].view(*places.shape[:2], -1)


def canonical_likelihood(
    network: DescriptorNetwork, descriptors: torch.Tensor, scale: torch.Tensor
) -> Likelihood | None:
    """Return what an image's descriptors say of the places along a rope.

    It is (p(s | descriptor) / p(s))^a of the canonical head, with a floor: neighbouring pixels err
    together, so each counts for less than an independent observation.

    Args:
        network: The network; one without a canonical head says nothing: None.
        descriptors: float (D, h, w), of the image.
        scale: Scalar, inverse temperature.

    Returns:
        A function of places (N, 2) in pixels of the descriptors' map.
    """
    head = network.canonical
    if head is None:
        return None
    step = (head.anchors[:, 0] * TRACING.chain_steps).long().clamp(0, TRACING.chain_steps - 1)
    share = torch.bincount(step, minlength=TRACING.chain_steps).clamp_min(1) / len(step)

    def likelihood(uv_px: FloatArray) -> FloatArray:
        places = torch.from_numpy(uv_px.astype(np.float32))
        with torch.inference_mode():
            seen = sample_descriptors(descriptors[None], places[None])[0]
            p = head.log_probabilities(seen, scale).exp()
            at_step = torch.zeros(len(p), TRACING.chain_steps).index_add_(1, step, p) / share
        floored = (at_step.double().numpy() + _FLOOR) / (1 + _FLOOR)
        return np.asarray(floored**_EXPONENT)

    return likelihood


def enlarged(traces: Sequence[Trace], factor: FloatArray) -> list[Trace]:
    """Return traces in an image with more pixels.

    Args:
        traces: The traces.
        factor: float64 (2,), pixels of the other image per pixel, (u, v).
    """
    length = float(factor.mean())
    return [
        replace(
            trace,
            uv_px=trace.uv_px * factor,
            length_px=trace.length_px * length,
            half_px=trace.half_px * length,
            nadir=trace.nadir.scaled(length),
        )
        for trace in traces
    ]


@dataclass(frozen=True)
class TracedPlaces:
    """Where pairs of traces carry N queries.

    Attributes:
        uv_px: float64 (K, N, 2), in pixels of the target.
        weight: float64 (K,), sums to 1.
        sigma_px: Standard deviation of a place.
        reversed_px: float64 (K, N, 2), where they carry them if the rope in the target runs the
            other way; None where a ball distinguishes its ends.
    """

    uv_px: FloatArray
    weight: FloatArray
    sigma_px: float
    reversed_px: FloatArray | None = None

    def weighted_log_p(self, log_p: torch.Tensor, candidates_px: FloatArray) -> torch.Tensor:
        """Return log p' of the module's formula along `uv_px`, float32 (N, M), normalised.

        Args:
            log_p: float (N, M), the network's.
            candidates_px: float64 (M, 2), in pixels of the target.
        """
        prior = np.log(self._density(candidates_px) + _EPSILON)
        return (_NETWORK_EXPONENT * log_p + torch.from_numpy(prior)).log_softmax(dim=1)

    def either_way(
        self, weighed: torch.Tensor, log_p: torch.Tensor, candidates_px: FloatArray
    ) -> torch.Tensor:
        """Return log p' of both ways along the rope, float32 (N, M), normalised.

        Args:
            weighed: float32 (N, M), from `weighted_log_p`; returned if there is one direction.
            log_p: float (N, M), the network's.
            candidates_px: float64 (M, 2), in pixels of the target.
        """
        if self.reversed_px is None:
            return weighed
        other = replace(self, uv_px=self.reversed_px).weighted_log_p(log_p, candidates_px)
        return torch.logaddexp(weighed, other) - np.log(2)

    def _density(self, candidates_px: FloatArray) -> Float32Array:
        """Return the sum of the weighted Gaussians, 1 at a place that all agree on: (N, M).

        Places are counted in cells of half a standard deviation, and the counts blurred:
        that costs the same for any number of places.
        """
        cell_px = self.sigma_px / _CELLS
        origin = candidates_px.min(axis=0)
        wanted = np.floor((candidates_px - origin) / cell_px).astype(np.int64)  # (M, 2)
        size = wanted.max(axis=0) + 1
        cell = np.floor((self.uv_px - origin) / cell_px).astype(np.int64)  # (K, N, 2)
        pair, query = np.nonzero(((cell >= 0) & (cell < size)).all(axis=2))
        column, row = cell[pair, query].T
        counted = np.zeros((self.uv_px.shape[1], size[1], size[0]), dtype=np.float32)
        np.add.at(counted, (query, row, column), self.weight[pair])
        blurred = gaussian_filter(counted, (0, _CELLS, _CELLS), mode="constant")
        blurred *= 2 * np.pi * _CELLS**2
        return np.asarray(blurred[:, wanted[:, 1], wanted[:, 0]])

    def share_within(self, uv_px: FloatArray, radius_px: float) -> FloatArray:
        """Return the weight of the places near positions (N, 2), float64 (N,), 0 to 1."""
        gap = np.linalg.norm(self.uv_px - uv_px, axis=-1)  # (K, N)
        return np.asarray((self.weight[:, None] * (gap < radius_px)).sum(axis=0))

    def refined(self, uv_px: FloatArray) -> FloatArray:
        """Return positions moved to the mean of the places near them.

        Args:
            uv_px: float64 (N, 2); those with hardly any place near them stay.
        """
        gap = np.linalg.norm(self.uv_px - uv_px, axis=-1)  # (K, N)
        weight = self.weight[:, None] * (gap < _NEAR * self.sigma_px)
        total = weight.sum(axis=0)[:, None]
        mean = (weight[..., None] * self.uv_px).sum(axis=0) / np.maximum(total, 1e-12)
        return np.where(total > _LEAST_WEIGHT, mean, uv_px)


def traced_places(
    source: TracedView, target: TracedView, scale: torch.Tensor, uv_a_px: Float32Array
) -> TracedPlaces | None:
    """Return where the traces carry queries, or None where a view has no trace.

    Args:
        source: The queries' image.
        target: The other image.
        scale: Scalar, inverse temperature.
        uv_a_px: float32 (N, 2), the queries.
    """
    if not source.traces or not target.traces:
        return None
    either_way = source.ends_alike and target.ends_alike
    gap = _descriptor_gap(source.along(), target.along(), scale)
    if either_way:
        gap = np.minimum(gap, _descriptor_gap(source.along(), target.along().flip(1), scale))
    log_odds = pair_log_odds(source.traces, target.traces) - _AGREEMENT * gap
    best = np.argsort(-log_odds, axis=None, kind="stable")[:_PAIRS]
    pairs = [divmod(int(number), len(target.traces)) for number in best]
    weight = softmax(log_odds.flat[best])
    sigma_px = SIGMA_SHARE * target.view.rgb.shape[1]
    located_in = [located(trace, uv_a_px) for trace in source.traces]

    def carried(traces: Sequence[Trace]) -> FloatArray:
        return np.stack([placed(traces[b], located_in[a]) for a, b in pairs])

    one = carried(target.traces)
    guessed = source.ball_unknown and target.ball_unknown
    if not either_way and not guessed:
        return TracedPlaces(one, weight, sigma_px)
    other = carried([replace(each, uv_px=each.uv_px[::-1]) for each in target.traces])
    if guessed:
        return TracedPlaces(one, weight, sigma_px, other)
    # Readings start at either end: those that run against the first one change sides.
    against = [np.linalg.norm(way - one[0], axis=-1).mean(axis=1) for way in (one, other)]
    swapped = (against[1] < against[0])[:, None, None]
    one, other = np.where(swapped, other, one), np.where(swapped, one, other)
    return TracedPlaces(one, weight, sigma_px, other)


def _descriptor_gap(source: torch.Tensor, target: torch.Tensor, scale: torch.Tensor) -> FloatArray:
    """Return the mean gap along traces, capped: (T, S, D) and (U, S, D) -> float64 (T, U)."""
    gap = (source[:, None] - target[None]).square().sum(dim=-1)  # (T, U, S)
    return (scale * gap).clamp_max(_MOST).mean(dim=-1).double().numpy()
