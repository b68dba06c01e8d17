"""OpenCV as the classical methods use it: loading, padding, and keypoints at given positions."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.pixels import HALF_PIXEL
from pliant.spec.errors import MissingExtraError

PADDING_PX: Final = 64
"""Width of the border replicated around an image before descriptors are computed at given
positions: OpenCV drops ORB keypoints nearer than 31 px to the edge, and fails on images of a
few pixels."""


def load_opencv(feature: str) -> Any:
    """Return the `cv2` module.

    Args:
        feature: What needs it, for the message.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """
    try:
        import cv2
    except ImportError as error:
        raise MissingExtraError(feature, "classical") from error
    return cv2


def padded(grey: npt.NDArray[np.uint8], width: int = PADDING_PX) -> npt.NDArray[np.uint8]:
    """Return an image with its edge pixels repeated outwards.

    Args:
        grey: uint8 (H, W).
        width: Border, px.

    Returns:
        uint8 (H + 2 width, W + 2 width).
    """
    return np.pad(grey, width, mode="edge")


def keypoints_at(
    cv2: Any,
    uv_px: npt.NDArray[np.float32],
    angle_deg: npt.NDArray[np.float64],
    *,
    size_px: float,
    octave: int,
) -> list[Any]:
    """Return OpenCV keypoints at Pliant's positions, in an image padded by `PADDING_PX`.

    Args:
        cv2: The OpenCV module.
        uv_px: float32 (N, 2), centre of the first pixel at (0.5, 0.5).
        angle_deg: float64 (N,), orientation, from +u towards +v.
        size_px: Diameter that OpenCV takes for the keypoint's neighbourhood.
        octave: OpenCV's packed octave field (pyramid level for ORB).

    Returns:
        N keypoints; `class_id` contains the row.
    """
    xy = uv_px.astype(np.float64) - HALF_PIXEL + PADDING_PX
    return [
        cv2.KeyPoint(x, y, size_px, angle, 0.0, octave, row)
        for row, ((x, y), angle) in enumerate(zip(xy.tolist(), angle_deg.tolist(), strict=True))
    ]


def described(detector: Any, image: npt.NDArray[np.uint8], keypoints: list[Any]) -> Any:
    """Return a descriptor for each keypoint, in order.

    Args:
        detector: An OpenCV `Feature2D`.
        image: uint8 (H, W), in which the keypoints are well inside.
        keypoints: Keypoints whose `class_id` is their row.

    Returns:
        (N, D) array of the detector's descriptor type.
    """
    if not keypoints:
        return np.zeros((0, detector.descriptorSize()), dtype=np.float32)
    kept, descriptors = detector.compute(image, keypoints)
    rows = np.array([keypoint.class_id for keypoint in kept])
    if len(rows) != len(keypoints):
        raise RuntimeError(f"OpenCV described {len(rows)} of {len(keypoints)} keypoints")
    ordered = np.empty_like(descriptors)
    ordered[rows] = descriptors
    return ordered
