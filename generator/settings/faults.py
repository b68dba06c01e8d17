"""Strengths of image noise and of a depth camera's faults."""

from __future__ import annotations

from typing import Annotated

from pliant.spec.configuration import configuration
from pliant.spec.constraints import Bounds, Range


@configuration(frozen=True)
class NoiseSettings:
    """Strengths, drawn uniformly for each frame; (low, high) with low <= high; 0 is none.

    Attributes:
        gaussian: Standard deviation, in 8-bit steps.
        photons: Photons that make a pixel white; fewer is noisier; 0 is no Poisson noise.
        salt_pepper: Share of the pixels that turn white or black.
        dropout: Share of the outline that is lost.
        dropout_px: How far from the outline pixels may be lost.
        dropout_scale_px: Size of the patches.
    """

    gaussian: Annotated[Range, Bounds(0, 128, "of 255")] = (0.5, 3.0)
    photons: Annotated[Range, Bounds(0, 1e9)] = (800.0, 4000.0)
    salt_pepper: Annotated[Range, Bounds(0, 1)] = (0.0, 0.0005)
    dropout: Annotated[Range, Bounds(0, 1)] = (0.0, 0.25)
    dropout_px: Annotated[int, Bounds(0, 16)] = 2
    dropout_scale_px: Annotated[float, Bounds(1, 1000)] = 12.0


@configuration(frozen=True)
class DepthCameraSettings:
    """Strengths, drawn uniformly for each frame; (low, high) with low <= high.

    Attributes:
        table_grey: Grey of the table where the camera looks, of 255: the scale of depth.
        noise_grey: Standard deviation of the depth before it is rounded, in grey steps.
        steepest: Slope (metres of depth a metre across) from which ground falling away to the
            right is lost.
        frayed_px: Mean length that a row loses of the right rim, inside the patches.
        patch_px: Size of the patches.
        pinholes: Share of the object's pixels that fail.
        specks: Specks beside the object.
    """

    table_grey: Annotated[Range, Bounds(1, 200, "of 255")] = (142.0, 154.0)
    noise_grey: Annotated[Range, Bounds(0, 64, "of 255")] = (0.05, 0.25)
    steepest: Annotated[Range, Bounds(0.05, 100)] = (1.1, 1.8)
    frayed_px: Annotated[Range, Bounds(0, 64)] = (0.3, 1.5)
    patch_px: Annotated[Range, Bounds(1, 1000)] = (6.0, 16.0)
    pinholes: Annotated[Range, Bounds(0, 1)] = (0.0, 0.0008)
    specks: Annotated[Range, Bounds(0, 10_000)] = (0.0, 8.0)
