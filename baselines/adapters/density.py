"""From similarities to a calibrated density: a few Gaussians for each query."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.special import softmax

from pliant.spec.arrays import FloatArray

TEMPERATURES: Final = tuple(np.geomspace(0.002, 0.5, 13).tolist())
SPREADS: Final = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
"""What `fit` tries."""

_MODES: Final = 4
_RADIUS_CELLS: Final = 2.5
_LEAST_WEIGHT: Final = 0.02
_STRAY: Final = 1e-6
"""Density, per square pixel, that keeps the likelihood of a miss finite."""


@dataclass(frozen=True)
class DensityCalibration:
    """How similarities become a density.

    Attributes:
        temperature: Similarities are divided by it before the softmax, > 0.
        spread: Factor of the modes' standard deviations, > 0.
        fitted_on: Dataset and split; None for the defaults.
    """

    temperature: float = 0.05
    spread: float = 1.0
    fitted_on: str | None = None


def mixture(
    score: npt.NDArray[Any], uv_px: FloatArray, stride_px: float, calibration: DensityCalibration
) -> list[npt.NDArray[np.float32]]:
    """Summarise the softmax of similarities as Gaussians.

    The most probable cell takes all cells around it as one mode, then the next of what remains,
    up to three times; the rest becomes one wide mode. Modes of less than 2 % are left out.

    Args:
        score: float (N, M), M >= 1, similarities of the candidate cells.
        uv_px: float64 (M, 2), their centres.
        stride_px: Distance of neighbouring cells.
        calibration: Temperature and spread.

    Returns:
        For each query float32 (K, 4) of (u, v, sigma, weight); weights sum to 1.
    """
    logits = (score / calibration.temperature).astype(np.float64)
    left = softmax(logits, axis=1)  # (N, M)
    found = []
    for number in range(_MODES):
        part = left
        if number < _MODES - 1:
            peak = uv_px[left.argmax(axis=1)]
            distance = np.hypot(uv_px[:, 0] - peak[:, :1], uv_px[:, 1] - peak[:, 1:])
            part = np.where(distance <= _RADIUS_CELLS * stride_px, left, 0)
        left = left - part
        weight = part.sum(axis=1)
        share = part / np.maximum(weight, 1e-300)[:, None]
        mean = share @ uv_px
        square = np.maximum(share @ (uv_px**2).sum(axis=1) - (mean**2).sum(axis=1), 0) / 2
        sigma = calibration.spread * np.sqrt(square + stride_px**2 / 12)
        found.append(np.column_stack([mean, sigma, weight]))
    modes = np.stack(found, axis=1)  # (N, K, 4)
    kept = modes[..., 3] >= _LEAST_WEIGHT
    kept[:, 0] = True
    result = []
    for values, used in zip(modes, kept, strict=True):
        chosen = values[used]
        chosen[:, 3] /= chosen[:, 3].sum()
        result.append(chosen.astype(np.float32))
    return result


def fit(
    known: Sequence[tuple[npt.NDArray[Any], FloatArray, FloatArray]], stride_px: float, where: str
) -> DensityCalibration:
    """Return the calibration with the largest mean log likelihood.

    Args:
        known: For each image pair similarities (N, M), cell centres (M, 2), and the true places
            (N, 2), px.
        stride_px: Distance of neighbouring cells.
        where: Dataset and split.
    """
    best, chosen = -np.inf, DensityCalibration()
    for temperature in TEMPERATURES:
        found = [
            (modes, true)
            for score, uv_px, true_px in known
            for modes, true in zip(
                mixture(score, uv_px, stride_px, DensityCalibration(temperature)),
                true_px,
                strict=True,
            )
        ]
        for spread in SPREADS:
            mean = float(np.mean([_log_density(modes, true, spread) for modes, true in found]))
            if mean > best:
                best, chosen = mean, DensityCalibration(temperature, spread, where)
    return chosen


def _log_density(modes: npt.NDArray[np.float32], true_px: FloatArray, spread: float) -> float:
    variance = (spread * modes[:, 2].astype(np.float64)) ** 2
    square = ((modes[:, :2] - true_px) ** 2).sum(axis=1) / variance
    density = modes[:, 3] * np.exp(-square / 2) / (2 * np.pi * variance)
    return float(np.log(density.sum() + _STRAY))
