"""Pixel centres, masks and brightness, worked out by hand."""

from __future__ import annotations

import numpy as np

from pliant.baselines import Frame
from pliant.baselines.features.local_features import dense_stride
from pliant.baselines.pixels import central_position, lies_on, luma, pixel_centres


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
