"""Where a method says something is: no half pixel off, in either direction of the conversion.

OpenCV puts the centre of the first pixel at (0, 0), and each library has faults of its own. A
conversion forgotten shifts every keypoint; a conversion forgotten on both sides hides, since
two equal shifts cancel, until one picture is turned by 180 degrees and they add up.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pliant.baselines import METHODS, Frame
from pliant.baselines.features.local_features import LocalFeatures
from pliant.baselines.features.opencv_features import Orb, Sift, intensity_centroid_deg
from pliant.baselines.features.surf import MahotasSurf
from pliant.spec.arrays import Float32Array, FloatArray, ImageArray
from pliant.spec.frame import Pair

FEATURES: dict[str, Callable[[], LocalFeatures]] = {"sift": Sift, "orb": Orb, "surf": MahotasSurf}


def offsets(found_px: Float32Array, uv_px: FloatArray) -> FloatArray:
    """Found minus true, for what lies within 3 px of a true place."""
    difference = found_px[:, None].astype(np.float64) - uv_px[None]  # (N, M, 2)
    nearest = difference[np.arange(len(difference)), np.hypot(*difference.T).T.argmin(axis=1)]
    return nearest[np.hypot(*nearest.T) < 3]


def texture(height: int, width: int) -> ImageArray:
    """A blurred random image of uneven, unlike sides."""
    rng = np.random.default_rng(2)
    image = rng.standard_normal((height, width))
    for axis in (0, 1):
        for _ in range(3):
            image = (np.roll(image, 1, axis) + image + np.roll(image, -1, axis)) / 3
    image = (image - image.min()) / np.ptp(image) * 255
    return np.rint(image).astype(np.uint8)


@pytest.mark.parametrize("name", sorted(FEATURES))
def test_turned_keypoints_match_their_own_places(name: str) -> None:
    """Any shift of the convention shows twice under a turn by 180 degrees."""
    image = texture(201, 264)
    features = FEATURES[name]()
    plain, turned = features.detect(image), features.detect(image[::-1, ::-1].copy())
    expected = [264, 201] - plain.uv_px
    off = offsets(turned.uv_px, expected.astype(np.float64))
    assert len(off) > 0.8 * len(plain.uv_px)
    assert np.abs(off.mean(axis=0)).max() < 0.06


@pytest.mark.parametrize(("name", "exact"), [("sift", 0.9), ("orb", 0.7), ("surf", 0.4)])
def test_answers_in_a_turned_picture_are_the_turned_pixels(name: str, exact: float) -> None:
    grey = texture(161, 184)
    rgb = np.repeat(grey[..., None], 3, axis=2)
    queries = np.random.default_rng(1).integers([30, 30], [154, 131], (50, 2)) + 0.5
    inner = np.zeros(grey.shape, dtype=np.bool_)
    inner[25:136, 25:159] = True
    answers = METHODS[name]().answer(  # type: ignore[union-attr]
        Pair(
            Frame(rgb, inner),
            Frame(rgb[::-1, ::-1].copy(), inner[::-1, ::-1].copy()),
            queries.astype(np.float32),
        )
    )
    off = answers.uv_px - ([184, 161] - queries)
    assert (off == 0).all(axis=1).mean() >= exact
    assert np.abs(np.median(off, axis=0)).max() == 0


def test_orb_angle_is_opencvs() -> None:
    """At the keypoints that OpenCV itself finds at full resolution."""
    cv2: Any = pytest.importorskip("cv2")
    image = texture(201, 264)
    found = [k for k in cv2.ORB_create(500).detect(image, None) if k.octave == 0]
    uv_px = np.array([k.pt for k in found], dtype=np.float32) + 0.5
    ours = intensity_centroid_deg(image, uv_px, 15)
    turn = (ours - [k.angle for k in found] + 180) % 360 - 180
    assert len(found) > 50
    assert np.abs(turn).max() < 0.05
