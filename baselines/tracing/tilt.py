"""How a camera over a table is tilted, by how wide a rope appears.

A rope is equally thick everywhere, so its apparent width is inversely proportional to its distance
from the camera, and that is linear in the image of a table: with q = (x - x_0) / f,

    width / sqrt(1 + (n q)^2) = a (1 + t q),

where t is the tangent of the camera's tilt, as a vector, and n the direction across the rope: the
root is how much wider than its radius a cylinder appears off the optical axis. `slant` reads a
large tilt about the image's horizontal off the mask alone, before anything is traced; `small_tilt`
reads what remains off the widths across the traces.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pliant.baselines.tracing.mask_shape import depth_in_mask, ridge
from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import FloatArray, Mask
from pliant.spec.frame import Frame


@dataclass(frozen=True)
class Nadir:
    """The place below a camera whose optical axis is the table's normal.

    Attributes:
        place_px: float64 (2,), where the axis meets the image; it may be outside.
        focal_px: Focal length, px.
        tilt: float64 (2,), what the axis is off the table's normal after all: the vector t of the
            module's formula.
    """

    place_px: FloatArray
    focal_px: float
    tilt: FloatArray = field(default_factory=lambda: np.zeros(2))

    @property
    def below_px(self) -> FloatArray:
        """The place below the camera with its tilt, float64 (2,)."""
        return self.place_px + self.focal_px * self.tilt

    @classmethod
    def of_image(cls, shape: tuple[int, ...]) -> Nadir:
        """Return that of an unknown camera straight above, of an image (height, width, ...)."""
        height, width = shape[:2]
        return cls(np.array([width / 2, height / 2]), TRACING.focal_widths * width)

    @classmethod
    def of_frame(cls, frame: Frame) -> Nadir:
        """Return that of a frame's camera, taken for one straight above; see `of_image`."""
        if frame.camera is None:
            return cls.of_image(frame.rgb.shape)
        scale = frame.size[0] / frame.camera.size[0]
        return cls(scale * frame.camera.K[:2, 2], scale * float(frame.camera.K[0, 0]))

    def scaled(self, scale: float, shift_px: FloatArray | float = 0.0) -> Nadir:
        """Return that of the image magnified by `scale` and then moved by `shift_px`."""
        return Nadir(scale * self.place_px + shift_px, scale * self.focal_px, self.tilt)

    def magnification(self, places_px: FloatArray) -> FloatArray:
        """Return the table's scale at places (N, 2) over that at `place_px`, float64 (N,)."""
        aside = (places_px - self.place_px) / self.focal_px
        return np.asarray((1 + aside @ self.tilt).clip(0.5, 2.0))


def slant(mask: Mask, nadir: Nadir) -> float | None:
    """Return the tangent of a large angle between the optical axis and the table's normal.

    Args:
        mask: bool (H, W), the rope; the camera is not rolled.
        nadir: Where a camera without tilt would look straight down.

    Returns:
        0.36 to 1.2, positive where the lower part of the image is nearer; None where the widths
        show no such tilt.
    """
    half_px = depth_in_mask(mask, mask.shape[1])
    middle = ridge(half_px, 1.5)
    if middle.sum() < TRACING.slant_ridge:
        return None
    rows = np.nonzero(middle)[0] + 0.5
    widths = half_px[middle]
    relative = widths / np.median(widths)
    low, high = TRACING.slant_widths
    usual = (relative > low) & (relative < high)
    aside = ((rows[usual] - nadir.place_px[1]) / nadir.focal_px)[:, None]
    tilt, covariance = _fitted(aside, widths[usual], TRACING.slant_residual_px, 1.0)
    error = float(np.sqrt(covariance[0, 0]))
    if tilt[0] < max(TRACING.slant_least, TRACING.slant_significance * error):
        return None
    return min(float(tilt[0]), TRACING.slant_largest)


def small_tilt(
    places_px: FloatArray, normals: FloatArray, widths_px: FloatArray, nadir: Nadir, copies: float
) -> FloatArray:
    """Return the camera's tilt, estimated from widths with a Gaussian prior at 0.

    Args:
        places_px: float64 (N, 2), places on the middle of a rope.
        normals: float64 (N, 2), unit vectors across the rope.
        widths_px: float64 (N,), the mask's width there.
        nadir: Where a camera without tilt would look straight down.
        copies: How many of the places, on average, say the same: neighbours on one rope.

    Returns:
        float64 (2,), tangents of angles: the vector t of the module's formula.
    """
    if len(places_px) < TRACING.tilt_places * copies:
        return np.zeros(2)
    aside = (places_px - nadir.place_px) / nadir.focal_px
    apparent = widths_px / np.sqrt(1 + (normals * aside).sum(axis=1) ** 2)
    tilt, covariance = _fitted(aside, apparent, 0.0, copies)
    prior = TRACING.tilt_prior**2
    return np.asarray(prior * np.linalg.solve(prior * np.eye(2) + covariance, tilt))


def _fitted(
    aside: FloatArray, widths_px: FloatArray, least_deviation: float, copies: float
) -> tuple[FloatArray, FloatArray]:
    """Return t of width = a (1 + t q), by least squares with Cauchy's weights, and its covariance.

    Args:
        aside: float64 (N, P), q.
        widths_px: float64 (N,).
        least_deviation: Residuals are taken to scatter by this much at least.
        copies: How many of the places, on average, say the same.

    Returns:
        float64 (P,) and (P, P).
    """
    design = np.column_stack([np.ones(len(aside)), aside])
    root = np.ones_like(widths_px)
    solution = np.zeros(design.shape[1])
    deviation = least_deviation
    for _ in range(TRACING.fit_rounds):
        solution = np.linalg.lstsq(design * root[:, None], widths_px * root, rcond=None)[0]
        residual = np.abs(widths_px - design @ solution)
        deviation = max(1.48 * float(np.median(residual)), least_deviation, 1e-9)
        root = 1 / np.hypot(1, residual / (2 * deviation))
    weighed = design * root[:, None]
    covariance = np.linalg.pinv(weighed.T @ weighed) * deviation**2
    return solution[1:] / solution[0], copies * covariance[1:, 1:] / solution[0] ** 2
