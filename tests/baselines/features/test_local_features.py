"""Local features: pixels, distances and matches by hand, and keypoints that are no half pixel off.

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
from pliant.baselines.features.local_features import (
    ROWS_AT_ONCE,
    LocalFeatures,
    dense_stride,
    distances,
    nearest,
    ratio_test,
)
from pliant.baselines.features.opencv_features import Orb, Sift, intensity_centroid_deg
from pliant.baselines.features.surf import MahotasSurf
from pliant.baselines.pixels import central_position, lies_on, luma, pixel_centres
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


def rows(*values: tuple[float, ...]) -> np.ndarray:
    return np.array(values, dtype=np.float32)


def bits(*values: int) -> np.ndarray:
    return np.array([[value] for value in values], dtype=np.uint8)


def test_euclidean_distance() -> None:
    found = distances(rows((0, 0), (3, 4)), rows((3, 4), (0, 1), (0, 0)), "euclidean")
    np.testing.assert_allclose(found, [[5, 1, 0], [0, np.sqrt(18), 5]], rtol=1e-6)


def test_distances_of_whole_numbers_are_exact() -> None:
    """SIFT's descriptors have a length near 512; float32 holds their squares."""
    rng = np.random.default_rng(0)
    a, b = (rng.integers(0, 91, (40, 128)) for _ in range(2))
    exact = np.sqrt(((a[:, None] - b[None]) ** 2).sum(axis=2)).astype(np.float32)
    np.testing.assert_array_equal(distances(a, b, "euclidean"), exact)


def test_first_of_equals_is_taken_and_no_choice_is_said() -> None:
    row, decided = nearest(rows((0,), (5,)), rows((4,), (6,), (4,)), "euclidean")
    assert row.tolist() == [0, 0]  # 4 is nearer to 0; 4 and 6 are equally near to 5
    assert decided.tolist() == [True, False]


def test_single_candidate_is_no_choice() -> None:
    assert nearest(rows((1,)), rows((9,)), "euclidean")[1].tolist() == [False]


def test_queries_beyond_one_block() -> None:
    count = 2 * ROWS_AT_ONCE + 3
    candidates = np.arange(count, dtype=np.float32)[:, None]
    row, decided = nearest(candidates[::-1], candidates, "euclidean")
    np.testing.assert_array_equal(row, np.arange(count)[::-1])
    assert decided.all()
    a, b, _ = ratio_test(candidates[::-1], candidates, "euclidean", 0.8)
    np.testing.assert_array_equal(a, np.arange(count))
    np.testing.assert_array_equal(b, np.arange(count)[::-1])


@pytest.mark.parametrize(
    ("second", "score"),
    [
        (6.25, None),  # 5 / 6.25 = 0.8: not below the threshold
        (6.26, 1 - 5 / 6.26),
        (10.0, 0.5),
    ],
)
def test_ratio_is_strictly_below(second: float, score: float | None) -> None:
    a, b, scores = ratio_test(rows((0.0,)), rows((second,), (5.0,)), "euclidean", 0.8)
    if score is None:
        assert len(a) == len(b) == len(scores) == 0
    else:
        assert (a.tolist(), b.tolist()) == ([0], [1])
        np.testing.assert_allclose(scores, [score], rtol=1e-5)


def test_ratio_of_bits() -> None:
    a, b, scores = ratio_test(bits(0b0000, 0b0011), bits(0b0001, 0b1111), "hamming", 0.8)
    # 0000: 1 and 4 bits, ratio 1/4. 0011: 1 and 2 bits, ratio 1/2.
    assert (a.tolist(), b.tolist()) == ([0, 1], [0, 0])
    assert scores.tolist() == [0.75, 0.5]


def test_twins_in_the_target_are_ambiguous() -> None:
    assert len(ratio_test(rows((1.0,)), rows((1.0,), (1.0,)), "euclidean", 0.8)[0]) == 0


@pytest.mark.parametrize(("count_a", "count_b"), [(0, 5), (5, 0), (5, 1)])
def test_no_second_nearest_no_match(count_a: int, count_b: int) -> None:
    a, b, scores = ratio_test(
        np.zeros((count_a, 2), np.float32), np.ones((count_b, 2), np.float32), "euclidean", 0.8
    )
    assert (len(a), len(b), len(scores)) == (0, 0, 0)


def mask_of(*pixels: tuple[int, int], height: int = 4, width: int = 5) -> np.ndarray:
    mask = np.zeros((height, width), dtype=np.bool_)
    for row, column in pixels:
        mask[row, column] = True
    return mask


def test_luma_weighs_green_most() -> None:
    rgb = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [0, 0, 0]]])
    assert luma(rgb.astype(np.uint8)).tolist() == [[76, 150, 29, 255, 0]]


def test_centres_are_half_a_pixel_in() -> None:
    assert pixel_centres(mask_of((0, 0), (2, 3))).tolist() == [[0.5, 0.5], [3.5, 2.5]]


def test_stride_keeps_its_grid_and_stays_on_pixel_centres() -> None:
    full = np.ones((4, 5), dtype=np.bool_)
    assert pixel_centres(full, 2).tolist() == [[1.5, 1.5], [3.5, 1.5], [1.5, 3.5], [3.5, 3.5]]
    # row 1 of 0, 1, 2 and columns 1 and 4: a stride of 3 takes the middle of each block
    assert pixel_centres(full, 3).tolist() == [[1.5, 1.5], [4.5, 1.5]]


def test_mask_between_the_grid_lines_is_taken_whole() -> None:
    assert pixel_centres(mask_of((0, 0), (0, 2)), 2).tolist() == [[0.5, 0.5], [2.5, 0.5]]


def test_position_belongs_to_the_pixel_it_falls_into() -> None:
    mask = mask_of((2, 3))
    inside = [[3.0, 2.0], [3.999, 2.999]]
    outside = [[2.999, 2.5], [4.0, 2.5], [3.5, 1.999], [-0.5, -0.5], [99, 2.5]]
    uv_px = np.array(inside + outside, dtype=np.float32)
    assert lies_on(uv_px, mask).tolist() == [True] * 2 + [False] * 5


def test_centre_of_mask_or_image() -> None:
    rgb = np.zeros((4, 5, 3), dtype=np.uint8)
    assert central_position(Frame(rgb, mask_of((0, 0), (0, 2), (3, 1)))).tolist() == [1.5, 1.5]
    assert central_position(Frame(rgb)).tolist() == [2.5, 2.0]
    assert central_position(Frame(rgb, mask_of())).tolist() == [2.5, 2.0]


def test_stride_follows_from_the_limit() -> None:
    strides = [dense_stride(pixels, limit=100) for pixels in (0, 100, 101, 400, 401, 900)]
    assert strides == [1, 1, 2, 2, 3, 3]
