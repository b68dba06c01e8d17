"""The local features of OpenCV, one recipe each.

SIFT (Lowe, IJCV 2004) and ORB (Rublee and others, ICCV 2011).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.features.local_features import Keypoints
from pliant.baselines.features.nearest import Descriptors, Metric
from pliant.baselines.features.opencv import (
    PADDING_PX,
    described,
    keypoints_at,
    load_opencv,
    padded,
    positions,
)
from pliant.baselines.features.orientation import dominant_gradient_deg, intensity_centroid_deg
from pliant.baselines.pixels import HALF_PIXEL
from pliant.spec.arrays import Float32Array, ImageArray

SIFT_LAYER: Final = 1
"""Layer of SIFT's octave in which given pixels are described: the first with keypoints."""

MAX_ORB_KEYPOINTS: Final = 2000
ORB_PATCH_PX: Final = 31
ORB_PYRAMID_FACTOR: Final = 1.2


@dataclass(frozen=True)
class Recipe:
    """How OpenCV runs one local feature.

    Attributes:
        describer: OpenCV `Feature2D` that computes the descriptors.
        metric: Distance between descriptors.
        size_px: Size of a keypoint at a given pixel, in the convention of `describer`.
        facts: Settings for the submission's footer.
        orientation: (image, positions (N, 2)) -> degrees (N,) at given pixels.
        octave: OpenCV's packed octave field of a keypoint at a given pixel.
        positions: (keypoints, (H, W)) -> float32 (N, 2), in Pliant's pixel convention.
    """

    describer: Any
    metric: Metric
    size_px: float
    facts: Mapping[str, Any]
    orientation: Callable[[ImageArray, Float32Array], npt.NDArray[np.float64]]
    octave: int = 0
    positions: Callable[[list[Any], tuple[int, ...]], Float32Array] = positions


def _sift(cv2: Any, octave: int = 0) -> Recipe:
    """SIFT: a fixed scale and the dominant gradient direction at given pixels."""
    scale_px = float(1.6 * 2 ** (octave + SIFT_LAYER / 3))
    return Recipe(
        # The default pyramid, doubled by plain resizing, puts keypoints 0.25 px too far to the
        # right and down; the precise one does not.
        describer=cv2.SIFT_create(enable_precise_upscale=True),
        metric="euclidean",
        size_px=2 * scale_px,
        facts={"query_scale_px": round(scale_px, 3), "query_orientation": "dominant gradient"},
        octave=octave | SIFT_LAYER << 8,
        orientation=partial(dominant_gradient_deg, cv2, scale_px=scale_px),
    )


def _orb(cv2: Any) -> Recipe:
    """ORB: full resolution and the intensity centroid of the patch at given pixels."""
    return Recipe(
        describer=cv2.ORB_create(
            nfeatures=MAX_ORB_KEYPOINTS, scaleFactor=ORB_PYRAMID_FACTOR, patchSize=ORB_PATCH_PX
        ),
        metric="hamming",
        size_px=ORB_PATCH_PX,
        facts={
            "max_keypoints": MAX_ORB_KEYPOINTS,
            "query_patch_px": ORB_PATCH_PX,
            "query_orientation": "intensity centroid",
        },
        orientation=partial(intensity_centroid_deg, radius_px=ORB_PATCH_PX // 2),
        positions=_orb_positions,
    )


def _orb_positions(keypoints: list[Any], shape: tuple[int, ...]) -> Float32Array:
    """Return where ORB's keypoints are.

    A keypoint of level l is a whole pixel i of an image shrunk by 1.2^l, and OpenCV reports
    i·1.2^l. Its centre is at (i + 0.5)·f in Pliant's convention, with f the true ratio of the two
    images' sides, which are whole pixels too. On level 7 this is 1.8 px and more from what OpenCV
    reports.
    """
    xy = np.array([keypoint.pt for keypoint in keypoints])  # (N, 2)
    nominal = ORB_PYRAMID_FACTOR ** np.array([[keypoint.octave] for keypoint in keypoints])
    side = np.array(shape[::-1])
    factor = side / np.rint(side / nominal)  # (N, 2)
    return ((np.rint(xy / nominal) + HALF_PIXEL) * factor).astype(np.float32)


RECIPES: Final[dict[str, Callable[..., Recipe]]] = {
    "sift": _sift,
    "orb": _orb,
}
"""Name -> recipe, from the `cv2` module."""


class OpencvFeatures:
    """A local feature of OpenCV, at its own keypoints or at given pixels.

    Args:
        name: One of `RECIPES`.
        settings: Arguments of the recipe (SIFT: `octave` in which given pixels are described).

    Raises:
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, name: str, **settings: Any) -> None:
        self.name = name
        self._settings = settings
        self._cv2 = load_opencv(name.upper())
        self._recipe = RECIPES[name](self._cv2, **settings)
        self.metric: Metric = self._recipe.metric

    def __reduce__(self) -> tuple[Any, ...]:
        # OpenCV's objects cannot be sent to another process
        return partial(OpencvFeatures, self.name, **self._settings), ()

    def facts(self) -> Mapping[str, Any]:
        """Return settings and versions for the submission's footer."""
        return {
            "implementation": "opencv",
            "version": str(self._cv2.__version__),
            **self._recipe.facts,
        }

    def detect(self, grey: ImageArray) -> Keypoints:
        """Find and describe the image's own keypoints.

        Args:
            grey: uint8 (H, W).
        """
        recipe = self._recipe
        keypoints, descriptors = recipe.describer.detectAndCompute(grey, None)
        if not keypoints:
            return Keypoints(np.zeros((0, 2), np.float32), described(recipe.describer, grey, []))
        return Keypoints(recipe.positions(keypoints, grey.shape), descriptors)

    def describe_at(self, grey: ImageArray, uv_px: Float32Array) -> Descriptors:
        """Describe the patches around given positions; ORB rounds them to whole pixels.

        Args:
            grey: uint8 (H, W).
            uv_px: float32 (N, 2), inside the image.

        Returns:
            float32 (N, D), or uint8 (N, D) of packed bits.
        """
        recipe, image = self._recipe, padded(grey)
        angle_deg = recipe.orientation(image, uv_px + PADDING_PX)
        keypoints = keypoints_at(
            self._cv2, uv_px, angle_deg, size_px=recipe.size_px, octave=recipe.octave
        )
        found = described(recipe.describer, image, keypoints)
        return found.astype(np.uint8, copy=False) if self.metric == "hamming" else found
