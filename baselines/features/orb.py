"""ORB (Rublee and others, ICCV 2011), by OpenCV."""

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
)
from pliant.baselines.features.orientation import intensity_centroid_deg
from pliant.baselines.pixels import HALF_PIXEL

MAX_KEYPOINTS: Final = 2000
PATCH_PX: Final = 31
PYRAMID_FACTOR: Final = 1.2


class Orb:
    """ORB descriptors at its own keypoints or at given pixels.

    Given pixels are described at full resolution (a patch of 31 px), turned by the intensity
    centroid of the patch, as ORB does at its keypoints.
    """

    name = "orb"
    metric: Metric = "hamming"

    def __init__(self) -> None:
        self._cv2 = load_opencv("ORB")
        self._detector = self._cv2.ORB_create(
            nfeatures=MAX_KEYPOINTS, scaleFactor=PYRAMID_FACTOR, patchSize=PATCH_PX
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return Orb, ()  # OpenCV's objects cannot be sent to another process

    def facts(self) -> Mapping[str, Any]:
        """Return settings and versions for the submission's footer."""
        return {
            "implementation": "opencv",
            "version": str(self._cv2.__version__),
            "max_keypoints": MAX_KEYPOINTS,
            "query_patch_px": PATCH_PX,
            "query_orientation": "intensity centroid",
        }

    def detect(self, grey: npt.NDArray[np.uint8]) -> Keypoints:
        """Find and describe the image's own keypoints.

        A keypoint of level l is a whole pixel i of an image shrunk by 1.2^l, and OpenCV reports
        i·1.2^l. Its centre is at (i + 0.5)·f in Pliant's convention, with f the true ratio of
        the two images' sides, which are whole pixels too. On level 7 this is 1.8 px and more
        from what OpenCV reports.

        Args:
            grey: uint8 (H, W).
        """
        keypoints, descriptors = self._detector.detectAndCompute(grey, None)
        if not keypoints:
            return Keypoints(np.zeros((0, 2), np.float32), np.zeros((0, 32), np.uint8))
        xy = np.array([keypoint.pt for keypoint in keypoints])  # (N, 2)
        nominal = PYRAMID_FACTOR ** np.array([[keypoint.octave] for keypoint in keypoints])
        side = np.array(grey.shape[::-1])
        factor = side / np.rint(side / nominal)  # (N, 2)
        uv_px = (np.rint(xy / nominal) + HALF_PIXEL) * factor
        return Keypoints(uv_px.astype(np.float32), descriptors)

    def describe_at(
        self, grey: npt.NDArray[np.uint8], uv_px: npt.NDArray[np.float32]
    ) -> Descriptors:
        """Describe the patches around given positions; ORB rounds them to whole pixels.

        Args:
            grey: uint8 (H, W).
            uv_px: float32 (N, 2), inside the image.

        Returns:
            uint8 (N, 32), packed bits.
        """
        image = padded(grey)
        angle_deg = intensity_centroid_deg(image, uv_px + PADDING_PX, PATCH_PX // 2)
        keypoints = keypoints_at(self._cv2, uv_px, angle_deg, size_px=PATCH_PX, octave=0)
        return described(self._detector, image, keypoints).astype(np.uint8, copy=False)


def orb() -> LocalFeatureMatcher:
    """Return the local feature ORB (Rublee et al., 2011), by OpenCV.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """
    return LocalFeatureMatcher(Orb())
