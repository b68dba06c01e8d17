"""The local features of OpenCV: SIFT (Lowe, IJCV 2004) and ORB (Rublee and others, ICCV 2011).

OpenCV describes keypoints; the orientation of the patch around a given pixel is computed here as
SIFT and ORB define it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from pliant.baselines.features.local_features import Descriptors, Keypoints, Metric
from pliant.baselines.pixels import HALF_PIXEL
from pliant.spec.arrays import Float32Array, FloatArray, ImageArray
from pliant.spec.errors import MissingExtraError


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


BINS: Final = 36


def dominant_gradient_deg(
    cv2: Any, image: ImageArray, uv_px: Float32Array, scale_px: float
) -> FloatArray:
    """Return the direction in which most of the gradient around each position points.

    The histogram of Lowe (IJCV 2004, section 5): 36 bins of gradient magnitude, weighted by
    a Gaussian of 1.5 scales, smoothed, its peak refined by a parabola.

    Args:
        cv2: The OpenCV module.
        image: uint8 (H, W).
        uv_px: float32 (N, 2), inside the image.
        scale_px: Gaussian scale at which gradients are taken.

    Returns:
        float64 (N,), degrees in [0, 360), from +u towards +v.
    """
    column, row = np.floor(uv_px).astype(np.int64).T  # (N,) each
    reach = int(np.ceil(8 * scale_px))  # Gaussian tails and gradients, with room to spare
    top, left = max(0, row.min() - reach), max(0, column.min() - reach)
    window = image[top : row.max() + reach + 1, left : column.max() + reach + 1]
    smooth = cv2.GaussianBlur(window.astype(np.float32), (0, 0), scale_px)
    right = np.zeros_like(smooth)
    down = np.zeros_like(smooth)
    right[:, 1:-1] = smooth[:, 2:] - smooth[:, :-2]
    down[1:-1] = smooth[2:] - smooth[:-2]
    turn = np.arctan2(down, right) * (BINS / (2 * np.pi))
    bins = np.rint(turn).astype(np.int64) % BINS
    magnitude = np.hypot(right, down)

    histogram = np.empty((BINS, len(uv_px)))
    for index in range(BINS):
        part = np.where(bins == index, magnitude, np.float32(0))
        weighted = cv2.GaussianBlur(part, (0, 0), 1.5 * scale_px)
        histogram[index] = weighted[row - top, column - left]
    smoothed = (
        6 * histogram
        + 4 * (np.roll(histogram, 1, axis=0) + np.roll(histogram, -1, axis=0))
        + np.roll(histogram, 2, axis=0)
        + np.roll(histogram, -2, axis=0)
    )
    peak = smoothed.argmax(axis=0)  # (N,)
    here = np.arange(len(uv_px))
    before, after = smoothed[peak - 1, here], smoothed[(peak + 1) % BINS, here]
    curvature = before + after - 2 * smoothed[peak, here]
    flat = curvature == 0
    shift = np.where(flat, 0.0, (before - after) / (2 * np.where(flat, 1.0, curvature)))
    return ((peak + shift) * (360 / BINS)) % 360


def intensity_centroid_deg(image: ImageArray, uv_px: Float32Array, radius_px: int) -> FloatArray:
    """Return the direction from each position to the centroid of the brightness around it.

    The orientation of ORB (Rublee and others, ICCV 2011, section 3.2): atan2(m01, m10) of
    the moments of a disc. They are summed in integers, hence exact.

    Args:
        image: uint8 (H, W).
        uv_px: float32 (N, 2), at least `radius_px` + 1 inside the image.
        radius_px: Radius of the disc.

    Returns:
        float64 (N,), degrees in [0, 360), from +u towards +v.
    """
    pixel = np.rint(uv_px - HALF_PIXEL).astype(np.int64)  # (N, 2) nearest pixel
    column, row = pixel.T
    padded = np.pad(image.astype(np.int64), ((0, 0), (1, 0)))
    mass = padded.cumsum(axis=1)  # mass[:, x] = sum of image[:, :x]
    lever = (padded * (np.arange(padded.shape[1]) - 1)).cumsum(axis=1)
    m10 = np.zeros(len(uv_px), dtype=np.int64)
    m01 = np.zeros(len(uv_px), dtype=np.int64)
    widths = _disc(radius_px)
    for down in range(-radius_px, radius_px + 1):
        half = widths[abs(down)]
        low, high = column - half, column + half + 1
        along = mass[row + down, high] - mass[row + down, low]  # (N,)
        m01 += down * along
        m10 += lever[row + down, high] - lever[row + down, low] - column * along
    return np.degrees(np.arctan2(m01, m10)) % 360


def _disc(radius_px: int) -> list[int]:
    """Return a disc's half width on each row from its centre, the same if axes are swapped."""
    rows = np.arange(radius_px + 1)
    rounded = np.rint(np.sqrt(radius_px**2 - rows**2)).astype(int).tolist()
    return [
        half if 2 * row**2 <= radius_px**2 else max(u for u, v in enumerate(rounded) if v >= row)
        for row, half in enumerate(rounded)
    ]


PADDING_PX: Final = 64
"""Width of the border replicated around an image before descriptors are computed at given
positions: OpenCV drops ORB keypoints nearer than 31 px to the edge, and fails on images of a
few pixels."""

SIFT_LAYER: Final = 1
"""Layer of SIFT's first octave in which given pixels are described: the first with keypoints."""

SIFT_SCALE_PX: Final = float(1.6 * 2 ** (SIFT_LAYER / 3))
"""Scale at which given pixels are described."""

MAX_ORB_KEYPOINTS: Final = 2000
ORB_PATCH_PX: Final = 31
ORB_PYRAMID_FACTOR: Final = 1.2


class OpencvFeatures:
    """A local feature of OpenCV, at its own keypoints or at given pixels.

    Attributes:
        name: Name of the method.
        metric: Distance between descriptors.
        size_px: Size of a keypoint at a given pixel, in OpenCV's convention.
        octave: OpenCV's packed octave field of a keypoint at a given pixel.
        settings: Settings for the submission's footer.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """

    name: str
    metric: Metric
    size_px: float
    octave: int = 0
    settings: Mapping[str, Any]

    def __init__(self) -> None:
        self._cv2 = load_opencv(self.name.upper())
        self._describer = self._make()

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), ()  # OpenCV's objects cannot be sent to another process

    def _make(self) -> Any:
        """Return OpenCV's `Feature2D`."""
        raise NotImplementedError

    def _orientation_deg(self, image: ImageArray, uv_px: Float32Array) -> FloatArray:
        """Return the orientation at given positions, degrees (N,)."""
        raise NotImplementedError

    def _positions(self, keypoints: list[Any], shape: tuple[int, ...]) -> Float32Array:
        """Return where keypoints of an image (H, W) are, float32 (N, 2)."""
        xy = np.array([keypoint.pt for keypoint in keypoints], dtype=np.float64)
        return (xy + HALF_PIXEL).astype(np.float32)

    def facts(self) -> Mapping[str, Any]:
        """Return settings and versions for the submission's footer."""
        version = str(self._cv2.__version__)
        return {"implementation": "opencv", "version": version, **self.settings}

    def detect(self, grey: ImageArray) -> Keypoints:
        """Find and describe the image's own keypoints.

        Args:
            grey: uint8 (H, W).
        """
        keypoints, descriptors = self._describer.detectAndCompute(grey, None)
        if not keypoints:
            return Keypoints(np.zeros((0, 2), np.float32), self._nothing())
        return Keypoints(self._positions(keypoints, grey.shape), descriptors)

    def describe_at(self, grey: ImageArray, uv_px: Float32Array) -> Descriptors:
        """Describe the patches around given positions; ORB rounds them to whole pixels.

        Args:
            grey: uint8 (H, W).
            uv_px: float32 (N, 2), inside the image.

        Returns:
            float32 (N, D), or uint8 (N, D) of packed bits.
        """
        if len(uv_px) == 0:
            return self._nothing()
        image = np.pad(grey, PADDING_PX, mode="edge")
        angle_deg = self._orientation_deg(image, uv_px + PADDING_PX)
        xy = uv_px.astype(np.float64) - HALF_PIXEL + PADDING_PX
        keypoints = [
            self._cv2.KeyPoint(x, y, self.size_px, angle, 0.0, self.octave, row)
            for row, ((x, y), angle) in enumerate(zip(xy.tolist(), angle_deg.tolist(), strict=True))
        ]
        kept, descriptors = self._describer.compute(image, keypoints)
        rows = np.array([keypoint.class_id for keypoint in kept])
        if len(rows) != len(keypoints):
            raise RuntimeError(f"OpenCV described {len(rows)} of {len(keypoints)} keypoints")
        ordered = np.empty_like(descriptors)
        ordered[rows] = descriptors
        return ordered

    def _nothing(self) -> Descriptors:
        """Return the descriptors of no keypoints."""
        kind = np.uint8 if self.metric == "hamming" else np.float32
        return np.zeros((0, self._describer.descriptorSize()), kind)


class Sift(OpencvFeatures):
    """SIFT: a fixed scale and the dominant gradient direction at given pixels."""

    name = "sift"
    metric: Metric = "euclidean"
    size_px = 2 * SIFT_SCALE_PX
    octave = SIFT_LAYER << 8
    settings: Mapping[str, Any] = {
        "query_scale_px": round(SIFT_SCALE_PX, 3),
        "query_orientation": "dominant gradient",
    }

    def _make(self) -> Any:
        # The default pyramid, doubled by plain resizing, puts keypoints 0.25 px too far to the
        # right and down; the precise one does not.
        return self._cv2.SIFT_create(enable_precise_upscale=True)

    def _orientation_deg(self, image: ImageArray, uv_px: Float32Array) -> FloatArray:
        return dominant_gradient_deg(self._cv2, image, uv_px, SIFT_SCALE_PX)


class Orb(OpencvFeatures):
    """ORB: full resolution and the intensity centroid of the patch at given pixels."""

    name = "orb"
    metric: Metric = "hamming"
    size_px = ORB_PATCH_PX
    settings: Mapping[str, Any] = {
        "max_keypoints": MAX_ORB_KEYPOINTS,
        "query_patch_px": ORB_PATCH_PX,
        "query_orientation": "intensity centroid",
    }

    def _make(self) -> Any:
        return self._cv2.ORB_create(
            nfeatures=MAX_ORB_KEYPOINTS, scaleFactor=ORB_PYRAMID_FACTOR, patchSize=ORB_PATCH_PX
        )

    def _orientation_deg(self, image: ImageArray, uv_px: Float32Array) -> FloatArray:
        return intensity_centroid_deg(image, uv_px, ORB_PATCH_PX // 2)

    def _positions(self, keypoints: list[Any], shape: tuple[int, ...]) -> Float32Array:
        """Return where ORB's keypoints are.

        A keypoint of level l is a whole pixel i of an image shrunk by 1.2^l, and OpenCV reports
        i·1.2^l. Its centre is at (i + 0.5)·f in Pliant's convention, with f the true ratio of the
        two images' sides, which are whole pixels too. On level 7 this is 1.8 px and more from what
        OpenCV reports.
        """
        xy = np.array([keypoint.pt for keypoint in keypoints])  # (N, 2)
        nominal = ORB_PYRAMID_FACTOR ** np.array([[keypoint.octave] for keypoint in keypoints])
        side = np.array(shape[::-1])
        factor = side / np.rint(side / nominal)  # (N, 2)
        return ((np.rint(xy / nominal) + HALF_PIXEL) * factor).astype(np.float32)
