"""Values and pictures that went through a coarser form, and those next to them that did not."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from pliant.spec.io.exr import Surface
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules import precision
from pliant.spec.validation.rules.precision import (
    GREY,
    _borders,
    _coarse,
    _compressed,
    _doubled,
    _high_frequencies,
    check_precision,
    coarse_form,
)
from pliant.spec.validation.rules.surfaces import ShownSurface

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


@pytest.mark.parametrize(
    ("count", "found"), [(199, False), (200, True), (4095, True), (4096, True), (4098, True)]
)
def test_pixels_of_objects_are_looked_at(count: int, found: bool) -> None:
    """From 200 on; of 4096 every second one, so that the others may hold anything."""
    values = np.round(RNG.uniform(0.9, 1.2, 8192), 2)
    if count >= 4096:
        values[np.arange(8192) % 2 == 1] += RNG.uniform(0, 0.01, 4096)
    on = (np.arange(8192) >= 8) & (np.arange(8192) < 8 + count)
    channels = [np.float32(each).reshape(64, 128) for each in (values, COMPUTED[0] + 0 * values)]
    surface = Surface(
        channels[0], channels[1], channels[0] / 3, on.astype(np.uint32).reshape(64, 128)
    )
    findings = Findings()
    check_precision(ShownSurface(surface), findings.at("x"))
    where = [issue.where for issue in findings.issues]
    assert where == (["Z", "surface.m1"] if found else [])


def test_a_depth_in_steps_that_float32_can_tell() -> None:
    """Its rounding, 1e-7 of the largest depth, is less than 0.05 steps: to 50 m for 0.1 mm."""
    steps = RNG.integers(0, 3000, 3000) / 1e4
    for depth, says in (
        (49.0, "0.1 mm"),
        (51.0, None),
        (496.0, "whole millimetres"),
        (501.0, None),
    ):
        values = depth + steps * (10 if depth > 99 else 1) - 0.3
        found = _coarse(values.astype(np.float32), "Z")
        assert (says in str(found)) if says else found is None, depth
    off = np.round(COMPUTED, 3) + 1e-6 * (np.arange(3000) == 7)
    assert _coarse(off.astype(np.float32), "Z") is None


@pytest.mark.parametrize(("off", "found"), [(0.019, True), (0.021, False), (-0.019, True)])
def test_levels_are_equally_spaced_to_a_fiftieth(off: float, found: bool) -> None:
    levels = np.arange(40.0)
    levels[20:] += off  # one gap of 1 + off, or of the smallest one
    values = np.repeat(np.float32(0.31 + levels / 256), 10)
    assert (_coarse(values, "surface.m0") is not None) is found


def stepped(even: float, odd: float, width: int = 40, size: float = 100.0) -> npt.NDArray[Any]:
    """Return rows whose steps from column to column are two numbers in turn."""
    steps = size * np.where(np.arange(width - 1) % 2 == 0, even, odd)
    return np.tile(np.concatenate([[0], np.cumsum(steps)]), (9, 1))


def test_columns_of_a_pair_are_equal() -> None:
    for even, found in ((0.0199, True), (0.0201, False), (0.0, True)):
        assert _doubled(stepped(even, 1.0)) is found
        assert not _doubled(stepped(1.0, even))
    for size, found in ((0.514, True), (0.512, False)):  # 19 of 39 steps: a mean of 0.25
        assert _doubled(stepped(0.0, 1.0, 41, size)) is found
    wild = np.concatenate([stepped(0.0199, 1.0), np.full((9, 1), -9e9)], axis=1)
    assert _doubled(wild)  # an odd last column is left out


def test_what_curves_less_in_a_pair() -> None:
    """Third differences of 1 from one pair to the next and of 0.74 or 0.76 inside."""
    for inside, found in ((0.74, True), (0.76, False)):
        third = np.where(np.arange(37) % 2 == 0, 1.0, -inside)
        luma = third
        for _ in range(3):
            luma = np.concatenate([[0], np.cumsum(luma)])
        assert _doubled(np.tile(luma, (9, 1))) is found
        assert not _doubled(np.tile(luma[1:-1], (9, 1)))


@pytest.mark.parametrize("largest", range(7))
def test_steps_between_blocks_and_inside(largest: int) -> None:
    """3 between blocks, 2 at one column inside, 1 at the others."""
    steps = np.tile(np.where(np.arange(8) == largest, 2.0, 1.0), 5)
    steps[7::8] = 3
    luma = np.tile(np.concatenate([[0], np.cumsum(steps)]), (9, 1))
    assert _borders(luma) == 1.5
    assert _borders(-luma) == 1.5


def test_high_frequencies_of_a_block() -> None:
    """A product of cosines is one coefficient, 4 times its size; 21 of 64 are high."""
    at = np.pi * (2 * np.arange(8) + 1) / 16
    for i, j, size, found in (
        (2, 7, 5.0, [20 / np.sqrt(21)]), (2, 6, 5.0, [0.0]), (7, 2, 4.01, [16.04 / np.sqrt(21)]),
        (7, 7, 3.99, []),  # a deviation of half its size: less than 2 grey levels
    ):  # fmt: skip
        block = size * np.outer(np.cos(i * at), np.cos(j * at))
        assert _high_frequencies(block) == pytest.approx(found, abs=1e-9)
        luma = np.full((23, 31), 9.0)
        luma[8:16, 16:24] = block
        assert _high_frequencies(luma) == pytest.approx(found, abs=1e-9)


@pytest.mark.parametrize(
    ("borders", "blocks", "on", "found"),
    [
        ((1.26, 1.26), 12, 0.49, True),
        ((1.24, 1.24), 12, 0.49, False),
        ((2.4, 0.2), 12, 0.49, True),  # the mean of both directions counts
        ((1.0, 1.4), 12, 0.49, False),
        ((1.26, 1.26), 11, 0.49, False),
        ((1.26, 1.26), 12, 0.51, False),
    ],
)
def test_compression_has_borders_and_no_high_frequencies(
    borders: tuple[float, float],
    blocks: int,
    on: float,
    found: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Eight grids, the first of which is that of the file."""
    shapes = []
    along = iter(borders)

    def frequencies(luma: npt.NDArray[Any]) -> npt.NDArray[Any]:
        shapes.append(luma.shape)
        return np.full(blocks, on if len(shapes) == 1 else 1.0)

    monkeypatch.setattr(precision, "_borders", lambda _: next(along))
    monkeypatch.setattr(precision, "_high_frequencies", frequencies)
    assert _compressed(np.zeros((80, 90))) is found
    assert shapes == [] or shapes[:3] == [(80, 90), (76, 86), (80, 86)]
