"""What a network sees of a frame: channels, and the grey that tells an object's colours apart."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from pliant.loaders.inputs import LUMA, NetworkInput, contrast_weights
from pliant.spec.errors import CallError

RGB = np.array([[[0, 255, 255]]], np.uint8).repeat(2, axis=1)
DEPTH = np.array([[1.0, np.inf]], np.float32)


def test_channels_of_each_kind() -> None:
    assert NetworkInput("rgb").image(RGB, None)[:, 0, 0].tolist() == pytest.approx([-2, 2, 2])
    assert NetworkInput("depth").image(None, DEPTH)[0, 0].tolist() == [0.0, 3.0]
    with pytest.raises(CallError, match="needs a depth map"):
        NetworkInput("depth").image(RGB, None)
    with pytest.raises(CallError, match="needs a colour image"):
        NetworkInput("grey").image(None, DEPTH)


def test_grey_is_luma() -> None:
    """Cyan: (0.587 + 0.114) of full scale, which runs from -2 to 2."""
    grey = NetworkInput("grey").image(RGB, None)
    assert grey.shape == (1, 1, 2)
    assert grey[0, 0, 0] == pytest.approx(4 * 0.701 - 2, abs=1e-5)


def test_masks_are_channels_and_a_missing_mask_is_zero() -> None:
    seen = NetworkInput("grey", masks=True)
    assert seen.names == ("grey", "mask", "objects")
    mask, objects = np.array([[True, False]]), np.array([[True, True]])
    assert seen.image(RGB, None, mask, objects)[1:, 0].tolist() == [[1, -1], [1, 1]]
    assert seen.image(RGB, None, mask)[1:, 0].tolist() == [[1, -1], [0, 0]]
    assert seen.image(RGB, None).shape == (seen.channels, 1, 2)


def test_depth_channel_is_in_tenths_of_a_metre_behind_the_median() -> None:
    depth = np.array([[0.9, 1.0, 1.15]], np.float32)
    expected = [-1, 0, 1.5]
    np.testing.assert_allclose(NetworkInput("depth").image(None, depth)[0, 0], expected, atol=1e-5)


# Colours of one luminance, 0.299 r + 0.587 g + 0.114 b = 98.
CYAN, VIOLET = (20, 142, 75), (150, 64, 137)
MASK = np.ones((40, 60), bool)


def cloth(*colours: tuple[int, int, int], shade: float = 0.0) -> npt.NDArray[np.uint8]:
    """Return vertical stripes of the colours, darker from top to bottom."""
    columns = np.array(colours, float)[np.arange(60) * len(colours) // 60]
    light = np.linspace(1, 1 - shade, 40)[:, None, None]
    return np.round(columns[None] * light).astype(np.uint8)


def gap(picture: npt.NDArray[np.uint8], kind: str, mask: npt.NDArray[np.bool_] | None) -> float:
    """Return how far the first and the last column are apart, of 255."""
    grey = NetworkInput(kind, masks=True).image(picture, None, mask)[0]  # type: ignore[arg-type]
    return float(abs(grey[:, 0] - grey[:, -1]).mean() * 255 / 4)


def test_colours_of_one_luminance_differ() -> None:
    picture = cloth(CYAN, VIOLET, shade=0.4)
    assert gap(picture, "grey", MASK) < 1
    assert gap(picture, "contrast", MASK) > 40


def test_a_bright_hem_does_not_hide_the_stripe() -> None:
    """Blue separates the hem best (200 of 255), and not the stripe from the cloth at all."""
    cloth_colour, stripe, hem = (150, 40, 40), (60, 110, 40), (250, 240, 240)
    picture = cloth(cloth_colour, stripe, hem)
    weights = contrast_weights(picture, MASK)
    stripe_gap = abs(np.subtract(cloth_colour, stripe) @ weights)
    assert stripe_gap > 50
    assert weights.sum() == np.float32(1)


def test_luminance_where_nothing_is_coloured() -> None:
    shaded = cloth((90, 120, 150), shade=0.8)
    for mask in (MASK, None):
        np.testing.assert_array_equal(contrast_weights(shaded, mask), LUMA)
    np.testing.assert_array_equal(contrast_weights(cloth(CYAN, VIOLET), ~MASK), LUMA)


def test_the_table_counts_only_without_a_mask() -> None:
    picture = cloth(CYAN, VIOLET)
    assert gap(picture, "contrast", None) > 40
    mask = MASK.copy()
    mask[:, 30:] = False
    np.testing.assert_array_equal(contrast_weights(picture, mask), LUMA)


def test_a_ragged_rim_does_not_count() -> None:
    """A mask that reaches a pixel into a blue table; counted, the table would choose blue."""
    picture = np.full((40, 60, 3), (100, 60, 250), np.uint8)
    picture[10:30, 20:30], picture[10:30, 30:40] = (100, 60, 60), (70, 80, 60)
    exact, ragged = np.zeros_like(MASK), np.zeros_like(MASK)
    exact[10:30, 20:40] = ragged[9:31, 19:41] = True
    for mask in (exact, ragged):
        np.testing.assert_array_equal(contrast_weights(picture, mask), [1, 0, 0])
