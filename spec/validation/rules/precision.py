"""Whether images went through a coarser form on their way into the file.

Values of a float32 image that all fit into float16, into 256 levels or onto whole millimetres were
not computed in float64 and rounded once. Sampled pixels tell it; a plane seen head-on, whose depth
is one number, does not count.

A colour image that was grey, half the size, or strongly compressed keeps a trace that does not
depend on what it shows. Grey has three equal channels. Doubling the size makes even and odd pixels
differ in kind. JPEG sets the high frequencies of blocks of 8x8 pixels to zero on one grid, and on
that grid alone.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.surfaces import ShownSurface

SAMPLES: Final = 2048
MIN_SAMPLES: Final = 200
MIN_LEVELS: Final = 8
"""Fewer distinct values are a plane or a line of pixels, not a format."""

MAX_LEVELS: Final = 256
PIXELS_PER_LEVEL: Final = 4

_FLOAT32_STEPS: Final = 16
"""Values that are this many float32 steps apart prove no format: a flat cloth seen from above."""

_STEPS_M = ((1e-2, "whole centimetres"), (1e-3, "whole millimetres"), (1e-4, "0.1 mm"))


BLOCK: Final = 8
HIGH: Final = 9
"""Coefficients (i, j) with i + j from here on are high frequencies."""

MIN_BLOCKS: Final = 12
"""So many blocks with some texture are needed."""

_GRIDS: Final = ((0, 0), (4, 4), (0, 4), (4, 0), (2, 6), (6, 2), (2, 2), (6, 6))
"""Where the first block of a grid begins (v, u): that of JPEG, and others."""

TEXTURE: Final = 2.0
"""A block's standard deviation from which it has texture, grey levels."""

LOST: Final = 0.5
"""High frequencies on the grid over those on another one, below which they were removed."""

BORDERS: Final = 1.25
"""Step between blocks over the largest step inside, from which borders are visible."""

EQUAL: Final = 0.02
PHASES: Final = 0.75
"""First, third differences at one phase over those at the other: below this, a doubled size."""

MIN_DETAIL: Final = 0.25
"""Mean difference of neighbours from which a picture has detail, grey levels."""

GREY: Final = "are grey: red, green and blue are equal"
JPEG: Final = "have the blocks of strong JPEG compression"
_GREY: Final = np.array([0.299, 0.587, 0.114])


def check_precision(surface: ShownSurface, problems: FileProblems) -> None:
    """Check the values of a frame's depth and surface image.

    Args:
        surface: A valid surface image.
        problems: Gets `PRECISION_LOST`, at most once for each channel.
    """
    if surface.count < MIN_SAMPLES:
        return
    chosen = surface.pixels[:: max(1, surface.count // SAMPLES)]
    image = surface.image
    for name, channel in (("Z", image.depth_m), ("surface.m0", image.m0), ("surface.m1", image.m1)):
        coarse = _coarse(channel.ravel()[chosen], name)
        if coarse is not None:
            text = f"{coarse}; required: float32, computed in float64 and rounded once"
            problems.add("PRECISION_LOST", name, text)


def _coarse(values: npt.NDArray[Any], name: str) -> str | None:
    """Return the coarser format that all values fit, or None."""
    levels = np.unique(values)
    if levels.size < MIN_LEVELS:
        return None
    with np.errstate(over="ignore"):
        if np.array_equal(values.astype(np.float16).astype(np.float32), values):
            return "all values fit into float16: converted to half precision?"
    if name == "Z":
        for step, text in _STEPS_M:
            steps = levels.astype(np.float64) / step
            rounding = 1e-7 * float(levels.max()) / step + 1e-9
            if rounding < 0.05 and np.all(np.abs(steps - np.rint(steps)) <= rounding):
                return f"all values are multiples of {text}: stored as integers?"
    if levels.size <= MAX_LEVELS and values.size >= PIXELS_PER_LEVEL * levels.size:
        gaps = np.diff(levels.astype(np.float64))
        steps = gaps / gaps.min()
        finest = _FLOAT32_STEPS * np.spacing(np.abs(levels).max())
        equal = np.abs(steps - np.rint(steps)) < 0.02 * np.maximum(steps, 1)
        if gaps.min() > finest and np.all(equal):
            return f"{values.size} pixels have {levels.size} equally spaced values: 8 bits?"
    return None


def coarse_form(rgb: npt.NDArray[np.uint8]) -> str | None:
    """Return what a picture went through, or None.

    Args:
        rgb: uint8 (H, W, 3), not of one colour.
    """
    if all((part == part[..., :1]).all() for part in (rgb[::16, ::16], rgb)):  # few pixels first
        return GREY
    luma = rgb @ _GREY
    if min(luma.shape) < 3 * BLOCK:
        return None
    if _compressed(luma):
        return JPEG
    rows, columns = (max(1, side // 120) for side in luma.shape)  # some of them are enough
    if _doubled(luma[::rows]) and _doubled(luma.T[::columns]):
        return "look like pictures of half the size, enlarged"
    return None


def _doubled(luma: FloatArray) -> bool:
    """Return whether columns 2k and 2k + 1 are alike in a way that 2k - 1 and 2k are not."""
    width = luma.shape[1] // 2 * 2
    step = np.abs(np.diff(luma[:, :width], axis=1))
    if step.mean() < MIN_DETAIL:
        return False
    # Columns of a pair are equal, or what curves from one pair to the next curves less in it.
    bend = np.abs(np.diff(luma[:, :width], 3, axis=1))  # of columns k to k + 3
    return bool(
        step[:, 0::2].mean() < EQUAL * step[:, 1::2].mean()
        or bend[:, 1::2].mean() < PHASES * bend[:, 0::2].mean()
    )


def _compressed(luma: FloatArray) -> bool:
    """Return whether blocks of 8x8 pixels lack high frequencies and have visible borders."""
    if _borders(luma) + _borders(luma.T) <= 2 * BORDERS:
        return False
    parts = [_high_frequencies(luma[v:, u:]) for v, u in _GRIDS]
    if min(len(part) for part in parts) < MIN_BLOCKS:
        return False
    on, *off = (float(np.median(part)) for part in parts)
    return on < LOST * float(np.median(off))


def _borders(luma: FloatArray) -> float:
    """Return the mean step from one block to the next over the largest at another column."""
    step = np.abs(np.diff(luma, axis=1))
    inside = max(float(step[:, column::BLOCK].mean()) for column in range(BLOCK - 1))
    return float(step[:, BLOCK - 1 :: BLOCK].mean()) / max(inside, 1e-9)


def _high_frequencies(luma: FloatArray) -> FloatArray:
    """Return the root mean square of the high frequencies of each block with texture, (N,)."""
    from scipy.fft import dctn

    height, width = (side // BLOCK * BLOCK for side in luma.shape)
    blocks = luma[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK)
    blocks = blocks.transpose(0, 2, 1, 3).reshape(-1, BLOCK, BLOCK)
    blocks = blocks[blocks.std(axis=(1, 2)) > TEXTURE]
    values = dctn(blocks, axes=(1, 2), norm="ortho")
    return np.sqrt((values[:, _IS_HIGH] ** 2).mean(axis=1))


_IS_HIGH: Final[npt.NDArray[Any]] = np.add.outer(np.arange(BLOCK), np.arange(BLOCK)) >= HIGH
