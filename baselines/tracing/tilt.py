"""What the widths along a rope say of the camera's tilt.

A rope is equally thick everywhere, so its apparent width is inversely proportional to its distance
from the camera, and that is linear in the image of a table: with q = (x - x_0) / f,

    width / sqrt(1 + (n q)^2) = a (1 + t q),

where t is the tangent of the camera's tilt, as a vector, and n the direction across the rope: the
root is how much wider than its radius a cylinder appears off the optical axis.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pliant.baselines.tracing.depth_in_mask import FloatArray
from pliant.baselines.tracing.nadir import Nadir

_PRIOR: Final = 0.06
"""Standard deviation of a small tilt before anything is measured, tangent of an angle."""

_LEAST_PLACES: Final = 40
_ROUNDS: Final = 15


def small_tilt(
    places_px: FloatArray, normals: FloatArray, widths_px: FloatArray, nadir: Nadir, copies: float
) -> FloatArray:
    """Return the camera's tilt, drawn towards 0 by as much as the widths leave it open.

    Args:
        places_px: float64 (N, 2), places on the middle of a rope.
        normals: float64 (N, 2), unit vectors across the rope.
        widths_px: float64 (N,), the mask's width there.
        nadir: Where a camera without tilt would look straight down.
        copies: How many of the places, on average, say the same: neighbours on one rope.

    Returns:
        float64 (2,), tangents of angles: the vector t of the module's formula.
    """
    if len(places_px) < _LEAST_PLACES * copies:
        return np.zeros(2)
    aside = (places_px - nadir.place_px) / nadir.focal_px
    apparent = widths_px / np.sqrt(1 + (normals * aside).sum(axis=1) ** 2)
    design = np.column_stack([np.ones(len(aside)), aside])
    solution, covariance = robust_fit(design, apparent, 0.0)
    tilt = solution[1:] / solution[0]
    uncertain = copies * covariance[1:, 1:] / solution[0] ** 2
    return np.asarray(_PRIOR**2 * np.linalg.solve(_PRIOR**2 * np.eye(2) + uncertain, tilt))


def robust_fit(
    design: FloatArray, values: FloatArray, least_deviation: float
) -> tuple[FloatArray, FloatArray]:
    """Return the solution of a linear model with Cauchy's weights, and its covariance.

    Args:
        design: float64 (N, P).
        values: float64 (N,).
        least_deviation: Residuals are taken to scatter by this much at least.

    Returns:
        float64 (P,) and (P, P).
    """
    root = np.ones_like(values)
    solution = np.zeros(design.shape[1])
    deviation = least_deviation
    for _ in range(_ROUNDS):
        solution = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
        residual = np.abs(values - design @ solution)
        deviation = max(1.48 * float(np.median(residual)), least_deviation, 1e-9)
        root = 1 / np.hypot(1, residual / (2 * deviation))
    weighed = design * root[:, None]
    return solution, np.linalg.pinv(weighed.T @ weighed) * deviation**2
