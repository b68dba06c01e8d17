"""The descriptors of queries against those of the pixels that compete to be their match.

Intermediate results of the matcher follow: before and after the choice of a distribution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from pliant.baselines.tracing import Reframed
from pliant.models.don.certainty import Calibration
from pliant.models.don.described import ViewDescriber
from pliant.models.don.settings import AnswerSettings
from pliant.models.don.tracing import TracedPlaces
from pliant.models.losses.distributional import log_probabilities
from pliant.models.losses.matches import widened
from pliant.models.networks.descriptor_network import pixel_grid, sample_descriptors
from pliant.spec.arrays import BoolArray, Float32Array, FloatArray
from pliant.spec.frame import Frame

_PRINT_WEIGHT = 0.7  # of 0.7, 1 and 1.4, on four sets of printed validation cloths
_MIRROR_WEIGHT = 1 / 3  # with 1/2, more sheets come out on the wrong side


@dataclass(frozen=True)
class Comparison:
    """The descriptors of N queries against those of the target's candidates.

    Attributes:
        log_p: float (N, M), log probabilities over the candidates, before calibration.
        uv_px: float (M, 2), the candidates, in pixels of the network.
        distance: float64 (N,), squared descriptor distance to the best one times the scale.
        query: float (N, D), the queries' descriptors in the upright source.
    """

    log_p: torch.Tensor
    uv_px: torch.Tensor
    distance: FloatArray
    query: torch.Tensor


def compare(
    views: ViewDescriber,
    settings: AnswerSettings,
    source: Frame,
    target: Frame,
    uv_a_px: Float32Array,
    sharpness: float,
    every_px: int = 1,
    *,
    by_print: bool = True,
) -> Comparison:
    """Compare the queries' descriptors with those of the target's candidates, in all copies.

    Args:
        views: What describes images.
        settings: Where candidates are looked for.
        source: The image the queries are in.
        target: The image to find them in.
        uv_a_px: float32 (N, 2), in pixels of the source.
        sharpness: Factor of the log probabilities.
        every_px: Only the pixels of every so many rows and columns compete.
        by_print: Match the prints too, where both images show one.
    """
    a, b = views.described(source), views.described(target)
    width, height = views.size
    scale_a = views.pixel_scale(source)
    query_uv = torch.as_tensor(np.asarray(uv_a_px, dtype=np.float64) / scale_a, dtype=torch.float32)
    chosen = _searched(b.mask, views.size, settings)
    if every_px > 1:
        kept = (chosen % width % every_px == 0) & (chosen // width % every_px == 0)
        chosen = chosen[kept] if kept.any() else chosen
    uv = pixel_grid(height, width, 1, torch.device("cpu"))[chosen]
    total = torch.zeros(len(query_uv), len(uv))
    distance = torch.zeros(len(query_uv))
    queries = []
    with torch.inference_mode():
        scale = views.network.scale.detach().cpu()
        for turn, map_a, map_b in zip(views.turns, a.maps, b.maps, strict=True):
            turned = _turned_uv(query_uv, turn, width, height)
            query = sample_descriptors(map_a[None], turned[None])  # (1, N, D)
            queries.append(query[0])
            upright = torch.rot90(map_b, turn, (1, 2))
            rows = upright.flatten(1).T[chosen]  # (M, D)
            total += log_probabilities(query, rows[None], scale)[0]
            gap = torch.cdist(query[0], rows).square().min(dim=1).values
            distance += gap * scale
        turns = len(a.maps)
        mean = total / turns
        if a.mirrored is not None and b.mirrored is not None:
            query = sample_descriptors(a.mirrored[None], query_uv[None])
            rows = b.mirrored.flatten(1).T[chosen]
            mirrored = log_probabilities(query, rows[None], scale)[0]
            mean = (1 - _MIRROR_WEIGHT) * mean + _MIRROR_WEIGHT * mirrored
    log_p = mean * sharpness
    if by_print and views.prints is not None and a.prints is not None and b.prints is not None:
        with torch.inference_mode():
            query = sample_descriptors(a.prints[None], query_uv[None])
            rows = b.prints.flatten(1).T[chosen]
            log_p_print = log_probabilities(query, rows[None], views.prints.scale)[0]
        log_p = log_p + _PRINT_WEIGHT * log_p_print
    log_p = log_p.log_softmax(dim=1)
    return Comparison(log_p, uv, (distance / turns).double().numpy(), queries[0])


def _searched(
    mask: BoolArray | None, size: tuple[int, int], settings: AnswerSettings
) -> torch.Tensor:
    """Return the numbers of the pixels that compete, int64 (M,)."""
    width, height = size
    if mask is None or not mask.any() or settings.search == "image":
        return torch.arange(width * height)
    wide = widened(torch.from_numpy(mask)[None], settings.margin_px)
    return wide.flatten().nonzero()[:, 0]


def _turned_uv(uv_px: torch.Tensor, turn: int, width: int, height: int) -> torch.Tensor:
    """Return positions in an image turned clockwise by quarter turns (`rot90(image, -turn)`)."""
    u, v = uv_px.unbind(dim=-1)
    for _ in range(turn):
        u, v = height - v, u
        width, height = height, width
    return torch.stack([u, v], dim=-1)


@dataclass(frozen=True)
class Search(Comparison):
    """The probabilities of N queries, before a distribution is chosen.

    Attributes:
        traced: Where a rope's traces carry the queries, or None. They are weighed into `log_p`.
        deciding: float (N, M), what the answers are read from: `log_p`, or one way along a rope
            where `log_p` is the mean of both, or one side of a cloth.
    """

    traced: TracedPlaces | None
    deciding: torch.Tensor

    @property
    def either_way(self) -> bool:
        """Whether they are on a rope whose ends look alike."""
        return self.traced is not None and self.traced.reversed_px is not None


@dataclass(frozen=True)
class PairDistribution:
    """The distribution over the target that answers, σ, heat map and confidence are computed from.

    Attributes:
        source, target: The views as they are answered in.
        found: What was found in them.
        calibration: What holds for them, or None for a network without one.
        position_px: float64 (N, 2), the answers, in pixels of the target as seen.
    """

    source: Reframed
    target: Reframed
    found: Search
    calibration: Calibration | None
    position_px: FloatArray
