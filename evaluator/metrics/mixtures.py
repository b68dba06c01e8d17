"""Whether a predicted distribution is right: density, probability and regions.

An answer's distribution is a mixture of isotropic Gaussians in the target frame; one with
`sigma` alone is a mixture of one. Every mixture of a batch is written as flat arrays of modes
with the row they belong to.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pliant.spec.arrays import BoolArray, FloatArray, IntArray

_RIM_NODES: Final = 128
"""Nodes on the rim of a disc. For a disc of 8 px and a standard deviation of 0.5 px or more the
trapezoidal sum is exact to double precision (its error falls like exp(-2 (pi sigma / h)^2),
h the distance of the nodes)."""

_CHUNK_DISCS: Final = 4096
_CHUNK_DENSITIES: Final = 1 << 20
_RING_EDGES: Final = (
    0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.89, 0.92, 0.94, 0.96, 0.98, 1.0,
)  # fmt: skip
"""Probability inside the rings between which a mode's points are, finer towards its tail."""
_MOST_SPOKES: Final = 8
_MODES_OF_MOST_SPOKES: Final = 8
"""A mixture of more modes takes fewer points per mode, so that all its modes together take at most
960; the work per mixture is then proportional to its number of modes."""
_GOLDEN_ANGLE: Final = np.pi * (3 - 5**0.5)


@dataclass(frozen=True)
class Mixtures:
    """The distributions of N answers.

    Attributes:
        row: int64 (M,), the answer a mode belongs to, ascending; every answer has a mode.
        uv_px: float64 (M, 2), centres.
        sigma_px: float64 (M,), standard deviations, > 0.
        weight: float64 (M,), weights that sum to 1 in each answer.
        rows: N.
    """

    row: IntArray
    uv_px: FloatArray
    sigma_px: FloatArray
    weight: FloatArray
    rows: int


def _total(mixtures: Mixtures, values: FloatArray) -> FloatArray:
    """Sum a value of every mode over the modes of each answer, float64 (N,)."""
    sums: FloatArray = np.bincount(mixtures.row, values, mixtures.rows).astype(np.float64)
    return sums


def density(mixtures: Mixtures, at_px: FloatArray) -> FloatArray:
    """Return each answer's probability density at a position, float64 (N,), per square pixel.

    Args:
        mixtures: N distributions.
        at_px: float64 (N, 2), one position for each.
    """
    offset = at_px[mixtures.row] - mixtures.uv_px
    variance = mixtures.sigma_px**2
    squared = np.einsum("mk,mk->m", offset, offset)
    terms = mixtures.weight / (2 * np.pi * variance) * np.exp(-squared / (2 * variance))
    return _total(mixtures, terms)


def negative_log_likelihood(
    mixtures: Mixtures, true_px: FloatArray, *, outlier_weight: float, area_px2: float
) -> FloatArray:
    """Return -log p(truth) in nats, p per square pixel, with a floor.

    The density is mixed with a uniform one over the image, so that one confident error costs
    much but not everything: p' = (1 - e) p + e / area.

    Args:
        mixtures: N distributions; their sigma is floored beforehand.
        true_px: float64 (N, 2).
        outlier_weight: e.
        area_px2: Area of the image.

    Returns:
        float64 (N,), nats; at most log(area / e).
    """
    p = density(mixtures, true_px)
    return -np.log((1 - outlier_weight) * p + outlier_weight / area_px2)


def probability_within(mixtures: Mixtures, centre_px: FloatArray, radius_px: float) -> FloatArray:
    """Return the probability each distribution gives to a disc.

    For a Gaussian about the disc's own centre it is 1 - exp(-r^2 / (2 sigma^2)). Otherwise the
    integral of the density over the disc is turned, by the divergence theorem, into one over
    its rim of the field (1 - exp(-d^2 / (2 sigma^2))) / (2 pi d^2) x, whose divergence is the
    density; a smooth periodic integrand, which the trapezoidal rule integrates to rounding.

    Args:
        mixtures: N distributions.
        centre_px: float64 (N, 2), centres of the discs.
        radius_px: Their radius.

    Returns:
        float64 (N,), 0 to 1.
    """
    offset = centre_px[mixtures.row] - mixtures.uv_px  # (M, 2)
    two_variances = 2 * mixtures.sigma_px**2
    share = -np.expm1(-(radius_px**2) / two_variances)
    away = np.flatnonzero(np.any(offset != 0, axis=1))
    for first in range(0, len(away), _CHUNK_DISCS):
        part = away[first : first + _CHUNK_DISCS]
        share[part] = _disc_share(offset[part], two_variances[part], radius_px)
    return np.clip(_total(mixtures, mixtures.weight * share), 0.0, 1.0)


def _disc_share(offset: FloatArray, two_variances: FloatArray, radius_px: float) -> FloatArray:
    angle = 2 * np.pi * np.arange(_RIM_NODES) / _RIM_NODES
    normal = np.stack([np.cos(angle), np.sin(angle)])  # (2, nodes)
    along = offset @ normal + radius_px  # (M, nodes): rim point dot normal
    squared = radius_px**2 + np.einsum("mk,mk->m", offset, offset)[:, None]
    squared = squared + 2 * radius_px * (offset @ normal)
    squared = np.maximum(squared, 1e-12)
    field = -np.expm1(-squared / two_variances[:, None]) / squared
    return radius_px * np.mean(field * along, axis=1)


def in_regions(mixtures: Mixtures, true_px: FloatArray, levels: Sequence[float]) -> BoolArray:
    """Return whether the truth is in the smallest region of a given probability.

    For one Gaussian that is the disc of radius sigma sqrt(-2 log(1 - level)), exactly. For a
    mixture the density on its border is estimated from points in every mode, 15 radii in 8
    directions (fewer directions above 8 modes), to one to three per cent of probability.

    Args:
        mixtures: N distributions.
        true_px: float64 (N, 2).
        levels: L probabilities, 0 to 1.

    Returns:
        bool (L, N).
    """
    count = np.bincount(mixtures.row, minlength=mixtures.rows)
    single = count[mixtures.row] == 1
    result = np.zeros((len(levels), mixtures.rows), bool)
    offset = true_px[mixtures.row[single]] - mixtures.uv_px[single]
    squared = np.einsum("mk,mk->m", offset, offset)
    for of_level, level in zip(result, levels, strict=True):
        radius = mixtures.sigma_px[single] * np.sqrt(-2 * np.log1p(-level))
        of_level[mixtures.row[single]] = squared <= radius**2
    if not single.all():
        _mixture_regions(mixtures, true_px, levels, count, result)
    return result


def _mixture_regions(
    mixtures: Mixtures,
    true_px: FloatArray,
    levels: Sequence[float],
    count: IntArray,
    result: BoolArray,
) -> None:
    begin = np.cumsum(count) - count
    true_density = density(mixtures, true_px)
    for modes in np.unique(count[count > 1]).tolist():
        rows = np.flatnonzero(count == modes)
        pattern, share = _sample_pattern(modes)
        step = max(1, _CHUNK_DENSITIES // (modes * modes * len(pattern)))
        for first in range(0, len(rows), step):
            chosen = rows[first : first + step]
            index = begin[chosen, None] + np.arange(modes)  # (n, m)
            centre, sigma = mixtures.uv_px[index], mixtures.sigma_px[index]
            weight = mixtures.weight[index]
            points = centre[:, :, None] + sigma[:, :, None, None] * pattern  # (n, m, k, 2)
            mass = (weight[:, :, None] * share).reshape(len(chosen), -1)  # (n, m k)
            points = points.reshape(*mass.shape, 2)
            height = weight / (2 * np.pi * sigma**2)
            exponent = np.square(points[:, :, None, 0] - centre[:, None, :, 0])  # (n, m k, m)
            exponent += np.square(points[:, :, None, 1] - centre[:, None, :, 1])
            exponent *= -0.5 / (sigma**2)[:, None]
            p = np.einsum("npm,nm->np", np.exp(exponent, out=exponent), height)
            for of_level, least in zip(result, _densities_at(p, mass, levels), strict=True):
                of_level[chosen] = true_density[chosen] >= least


def _sample_pattern(modes: int) -> tuple[FloatArray, FloatArray]:
    """Return points of a standard Gaussian, (K, 2), and the probability each stands for, (K,).

    Args:
        modes: Modes of the mixture; above 8 of them, each takes fewer points.
    """
    spokes = min(_MOST_SPOKES, max(1, _MOST_SPOKES * _MODES_OF_MOST_SPOKES // modes))
    edges = np.array(_RING_EDGES)
    middle = (edges[1:] + edges[:-1]) / 2
    radius = np.sqrt(-2 * np.log1p(-middle))
    ring = np.arange(len(radius))[:, None]
    half_step = np.pi / spokes  # by which every other ring is turned
    turn = half_step * (ring % 2) if spokes == _MOST_SPOKES else _GOLDEN_ANGLE * ring
    angle = 2 * np.pi * np.arange(spokes) / spokes + turn
    points = np.stack([radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)], axis=-1)
    return points.reshape(-1, 2), np.repeat(np.diff(edges) / spokes, spokes)


def _densities_at(p: FloatArray, mass: FloatArray, levels: Sequence[float]) -> Iterator[FloatArray]:
    """Yield, per level, the density at which the densest points have that mass, float64 (N,).

    Args:
        p: float64 (N, K), densities at the points.
        mass: float64 (N, K), the mass each point stands for; rows sum to 1.
        levels: 0 to 1.
    """
    order = np.argsort(-p, axis=1, kind="stable")
    p = np.take_along_axis(p, order, axis=1)
    mass = np.take_along_axis(mass, order, axis=1)
    held = np.cumsum(mass, axis=1) - mass / 2  # a point is in the middle of its mass
    for level in levels:
        after = np.clip((held < level).sum(axis=1), 1, p.shape[1] - 1)[:, None]
        low, high = (np.take_along_axis(held, index, axis=1) for index in (after - 1, after))
        before, behind = (
            np.log(np.maximum(np.take_along_axis(p, index, axis=1), 1e-300))
            for index in (after - 1, after)
        )
        share = (level - low) / np.maximum(high - low, 1e-12)
        yield np.exp(before + np.maximum(share, 0) * (behind - before))[:, 0]


def spread_px(mixtures: Mixtures) -> FloatArray:
    """Return the standard deviation of each distribution per axis, float64 (N,), pixels.

    The root of half the trace of the covariance; for one Gaussian its sigma.
    """
    weight = _total(mixtures, mixtures.weight)
    weighted = mixtures.weight[:, None] * mixtures.uv_px
    mean = np.stack([_total(mixtures, weighted[:, axis]) for axis in (0, 1)], axis=1)
    mean /= weight[:, None]
    offset = mixtures.uv_px - mean[mixtures.row]
    inner = 2 * mixtures.sigma_px**2 + np.einsum("mk,mk->m", offset, offset)
    return np.sqrt(_total(mixtures, mixtures.weight * inner) / weight / 2)


def modes_near(
    mixtures: Mixtures, at_px: FloatArray, radius_px: float, min_weight: float
) -> BoolArray:
    """Return which positions have a mode of theirs within a radius.

    Args:
        mixtures: N distributions.
        at_px: float64 (N, S, 2), S positions for each.
        radius_px: How near.
        min_weight: Modes of a smaller weight do not count.

    Returns:
        bool (N, S).
    """
    heavy = mixtures.weight >= min_weight
    row = mixtures.row[heavy]
    offset = at_px[row] - mixtures.uv_px[heavy][:, None]  # (M, S, 2)
    near = np.einsum("msk,msk->ms", offset, offset) <= radius_px**2
    result = np.zeros(at_px.shape[:2], bool)
    np.logical_or.at(result, row, near)
    return result
