"""SIFT (Lowe, IJCV 2004), by OpenCV."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.features.local_features import Keypoints, LocalFeatureMatcher
from pliant.baselines.features.nearest import Descriptors, Metric
from pliant.baselines.features.opencv import (
    PADDING_PX,
    described,
    keypoints_at,
    load_opencv,
    padded,
    positions,
)
from pliant.baselines.features.orientation import dominant_gradient_deg

OCTAVE: Final = 0
"""Octave of the pyramid in which given pixels are described."""

LAYER: Final = 1
"""Layer of that octave: the first one in which a keypoint can be detected."""


def scale_px(octave: int) -> float:
    """Return the Gaussian scale of the layer in which given pixels are described.

    OpenCV calls twice as much a keypoint's size; the descriptor's 4x4 cells cover a square of 12
    scales.
    """
    return float(1.6 * 2 ** (octave + LAYER / 3))


class Sift:
    """SIFT descriptors at its own keypoints or at given pixels.

    Given pixels are described at one fixed scale and turned by the dominant gradient direction,
    as SIFT does at its keypoints.

    Args:
        octave: Octave in which given pixels are described, >= 0.
    """

    name = "sift"
    metric: Metric = "euclidean"

    def __init__(self, octave: int = OCTAVE) -> None:
        self._octave = octave
        self._scale_px = scale_px(octave)
        self._cv2 = load_opencv("SIFT")
        # The default pyramid, doubled by plain resizing, puts keypoints 0.25 px too far to the
        # right and down; the precise one does not.
        self._detector = self._cv2.SIFT_create(enable_precise_upscale=True)

    def __reduce__(self) -> tuple[Any, ...]:
        return Sift, (self._octave,)  # OpenCV's objects cannot be sent to another process

    def facts(self) -> Mapping[str, Any]:
        """Return settings and versions for the submission's footer."""
        return {
            "implementation": "opencv",
            "version": str(self._cv2.__version__),
            "query_scale_px": round(self._scale_px, 3),
            "query_orientation": "dominant gradient",
        }

    def detect(self, grey: npt.NDArray[np.uint8]) -> Keypoints:
        """Find and describe the image's own keypoints.

        Args:
            grey: uint8 (H, W).
        """
        keypoints, descriptors = self._detector.detectAndCompute(grey, None)
        if not keypoints:
            return Keypoints(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32))
        return Keypoints(positions(keypoints), descriptors)

    def describe_at(
        self, grey: npt.NDArray[np.uint8], uv_px: npt.NDArray[np.float32]
    ) -> Descriptors:
        """Describe the patches around given positions.

        Args:
            grey: uint8 (H, W).
            uv_px: float32 (N, 2), inside the image.

        Returns:
            float32 (N, 128), whole numbers from 0 to 255.
        """
        image = padded(grey)
        angle_deg = dominant_gradient_deg(self._cv2, image, uv_px + PADDING_PX, self._scale_px)
        keypoints = keypoints_at(
            self._cv2,
            uv_px,
            angle_deg,
            size_px=2 * self._scale_px,
            octave=self._octave | LAYER << 8,
        )
        return described(self._detector, image, keypoints)


def sift() -> LocalFeatureMatcher:
    """Return the local feature SIFT (Lowe, 2004), by OpenCV.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """
    return LocalFeatureMatcher(Sift())
