from __future__ import annotations

import numpy as np
import pytest

from pliant.loaders.inputs import NetworkInput
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
