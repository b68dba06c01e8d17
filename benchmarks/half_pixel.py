"""Where OpenCV and mahotas say that things are, before and after Pliant's corrections.

    python benchmarks/half_pixel.py [--quick] [--json FILE]

`offset_px_…`: mean distance right and down (the larger of the two) from the true centres of
Gaussian blobs to the keypoints found on them, half a pixel already added. `right_matches_…`: share
of ratio-test matches within 3 px, between a random texture and itself turned.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from mahotas.features import surf as mahotas_surf
from record import Value, main

from pliant.baselines.features.local_features import Keypoints
from pliant.baselines.features.nearest import ratio_test
from pliant.baselines.features.opencv_features import MAX_ORB_KEYPOINTS, OpencvFeatures
from pliant.baselines.features.surf import (
    MAHOTAS_MAX_POINTS,
    MAHOTAS_OCTAVES,
    MAHOTAS_SCALES,
    MAHOTAS_THRESHOLD,
    MahotasSurf,
)
from pliant.spec.arrays import ImageArray


def measure(quick: bool) -> Mapping[str, Value]:
    """Return the offsets and shares; `quick` changes nothing, it takes seconds."""
    figures: dict[str, Value] = {}
    image, centres = blobs()
    detectors: dict[str, Any] = {
        "sift_by_default": cv2.SIFT_create(),
        "orb_by_default": cv2.ORB_create(MAX_ORB_KEYPOINTS),
    }
    for name, detector in detectors.items():
        found = np.array([keypoint.pt for keypoint in detector.detect(image, None)]) + 0.5
        figures[f"offset_px_{name}"] = offset(found, centres)
    for name in ("sift", "orb"):
        figures[f"offset_px_{name}"] = offset(OpencvFeatures(name).detect(image).uv_px, centres)
    figures["offset_px_surf"] = offset(MahotasSurf().detect(image).uv_px, centres)
    grey = texture()
    for angle in (45, 180):
        turned, matrix = turn(grey, angle)
        pairs = {
            "as_it_comes": (plain_surf(grey), plain_surf(turned)),
            "corrected": (MahotasSurf().detect(grey), MahotasSurf().detect(turned)),
        }
        for name, (a, b) in pairs.items():
            row_a, row_b, _ = ratio_test(a.descriptors, b.descriptors, "euclidean", 0.8)
            expected = a.uv_px[row_a] @ matrix[:, :2].T + matrix[:, 2]
            right = np.hypot(*(b.uv_px[row_b] - expected).T) < 3
            figures[f"right_matches_surf_{name}_{angle}_deg"] = float(right.mean())
    return figures


def blobs() -> tuple[ImageArray, npt.NDArray[np.float64]]:
    """Draw bright blobs of 4 px at centres known to a fraction of a pixel."""
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.arange(8), np.arange(6)), axis=-1).reshape(-1, 2)
    centres = 60 + 70 * grid + rng.uniform(0, 1, grid.shape)
    v, u = np.mgrid[0:480, 0:640] + 0.5
    image = np.full(u.shape, 60.0)
    for centre_u, centre_v in centres:
        image += 150 * np.exp(-((u - centre_u) ** 2 + (v - centre_v) ** 2) / 32)
    return np.rint(image).astype(np.uint8), centres


def offset(found: npt.NDArray[Any], centres: npt.NDArray[np.float64]) -> float:
    """Return the mean offset of what is within 3 px of a centre."""
    difference = found[:, None] - centres[None]  # (N, M, 2)
    nearest = difference[np.arange(len(found)), (difference**2).sum(axis=2).argmin(axis=1)]
    near = nearest[np.hypot(*nearest.T) < 3]
    return float(np.abs(near.mean(axis=0)).max())


def texture() -> ImageArray:
    """Make a random texture with structure at several scales."""
    rng = np.random.default_rng(0)
    image = np.zeros((480, 640), dtype=np.float32)
    for sigma in (1.5, 4, 10):
        noise = rng.standard_normal(image.shape).astype(np.float32)
        image += sigma * cv2.GaussianBlur(noise, (0, 0), sigma)
    image = (image - image.min()) / np.ptp(image) * 255
    return np.rint(image).astype(np.uint8)


def turn(image: ImageArray, angle_deg: float) -> tuple[ImageArray, npt.NDArray[np.float64]]:
    """Turn an image about a point near its centre; return it and the 2x3 map of positions."""
    angle = np.radians(angle_deg)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    centre = np.array([320.0, 240.0])
    shift = centre - rotation @ centre + [3.3, 1.2]
    opencv = np.column_stack([rotation, shift + rotation @ [0.5, 0.5] - 0.5])
    turned = cv2.warpAffine(image, opencv, (640, 480), flags=cv2.INTER_CUBIC)
    return turned, np.column_stack([rotation, shift])


def plain_surf(image: ImageArray) -> Keypoints:
    """Detect and describe by mahotas as it comes."""
    rows = mahotas_surf.surf(
        image,
        MAHOTAS_OCTAVES,
        MAHOTAS_SCALES,
        threshold=MAHOTAS_THRESHOLD,
        max_points=MAHOTAS_MAX_POINTS,
    )
    return Keypoints((rows[:, 1::-1] + 0.5).astype(np.float32), rows[:, 6:].astype(np.float32))


if __name__ == "__main__":
    main("half_pixel", measure, __doc__)
