"""Values and pictures that went through a coarser form, and those next to them that did not."""

from __future__ import annotations

import io

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from pliant.spec.validation.rules.precision import GREY, _coarse, coarse_form

RNG = np.random.default_rng(0)
COMPUTED = RNG.uniform(0.9, 1.2, 3000).astype(np.float32)
BYTES = 0.31 + 0.67 * RNG.integers(0, 256, 3000) / 255
Picture = npt.NDArray[np.uint8]


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (COMPUTED, None),
        (COMPUTED.astype(np.float16), "all values fit into float16"),
        (np.round(COMPUTED, 2), "all values are multiples of whole centimetres"),
        (np.round(COMPUTED, 3), "all values are multiples of whole millimetres"),
        (np.round(COMPUTED, 4), "all values are multiples of 0.1 mm"),
        (np.round(COMPUTED, 5), None),
        (np.round(1000 * COMPUTED) + 1 / 3, None),
        (BYTES, "3000 pixels have 256 equally spaced values"),
        (BYTES[:1024], f"1024 pixels have {len(np.unique(BYTES[:1024]))} equally spaced values"),
        (np.where(BYTES > 0.5, BYTES + 0.001, BYTES), None),  # not equally spaced
        (0.31 + 0.67 * RNG.integers(0, 257, 3000) / 256, None),  # 257 levels
        (np.repeat(BYTES[:7], 100), None),  # too few levels to tell
        (np.repeat(np.unique(BYTES)[:8], 3), None),  # 3 pixels for each level
        (np.repeat(np.unique(BYTES)[:8], 4), "32 pixels have 8 equally spaced values"),
        (np.repeat(1 + 15 * 2.0**-23 * np.arange(9), 9), None),  # neighbours in float32, nearly
        (np.repeat(1 + 17 * 2.0**-23 * np.arange(9), 9), "81 pixels have 9 equally spaced"),
    ],
)
def test_coarse_values(values: npt.NDArray[np.float32], says: str | None) -> None:
    found = _coarse(values.astype(np.float32), "Z")
    assert found is None if says is None else str(found).startswith(says), found


def test_only_depth_is_in_metres() -> None:
    assert _coarse(np.round(COMPUTED, 3), "surface.m0") is None
    # At 100 m float32 cannot tell multiples of 0.1 mm from other numbers.
    assert _coarse(np.round(100 * COMPUTED, 4), "Z") is None


def texture(height: int, width: int) -> Picture:
    return RNG.integers(0, 256, (height, width, 3), np.uint8)


def enlarged(picture: Picture, filter_: Image.Resampling) -> Picture:
    height, width, _ = picture.shape
    return np.asarray(Image.fromarray(picture).resize((2 * width, 2 * height), filter_))


def compressed(picture: Picture, quality: int) -> Picture:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=quality)
    return np.asarray(Image.open(file))


def test_a_picture_is_grey_only_if_every_pixel_is() -> None:
    grey = np.repeat(texture(40, 50)[..., :1], 3, axis=2)
    assert coarse_form(grey) == GREY
    for channel in range(3):
        coloured = grey.copy()
        coloured[17, 5, channel] ^= 1  # not one of those that are looked at first
        assert coarse_form(coloured) is None


def test_a_picture_of_half_the_size() -> None:
    says = "look like pictures of half the size, enlarged"
    small = texture(12, 16)
    assert coarse_form(enlarged(small, Image.Resampling.NEAREST)) == says
    assert coarse_form(enlarged(small[:11], Image.Resampling.NEAREST)) is None  # 22 rows: too few
    assert coarse_form(np.repeat(small, 2, axis=0)) is None
    assert coarse_form(enlarged(texture(60, 80), Image.Resampling.BILINEAR)) == says
    assert coarse_form(texture(48, 64)) is None
    flat = np.full((12, 16, 3), (9, 9, 200), np.uint8)
    assert coarse_form(enlarged(flat, Image.Resampling.NEAREST)) is None  # without detail


def test_strong_compression() -> None:
    smooth = np.asarray(
        Image.fromarray(texture(24, 32)).resize((256, 192), Image.Resampling.BICUBIC)
    )
    grain = RNG.normal(0, 12, smooth.shape)
    natural = np.clip(smooth + grain, 0, 255).astype(np.uint8)
    says = "have the blocks of strong JPEG compression"
    assert coarse_form(natural) is None
    assert coarse_form(compressed(natural, 15)) == says
    assert coarse_form(compressed(natural, 95)) is None
    # Blocks that begin elsewhere are not those of a file that was compressed as it is.
    assert coarse_form(compressed(natural, 15)[3:, 5:]) is None
    assert coarse_form(compressed(natural, 15)[:24, :24]) is None  # 9 blocks: too few
