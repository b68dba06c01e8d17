"""Whether float32 values went through a coarser number format on their way into the file.

Values of a float32 image that all fit into float16, into 256 levels or onto whole millimetres were
not computed in float64 and rounded once. Sampled pixels tell it; a plane seen head-on, whose depth
is one number, does not count.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.surfaces import ShownSurface

SAMPLES: Final = 2048
MIN_SAMPLES: Final = 200
MIN_LEVELS: Final = 8
"""Fewer distinct values are a plane or a line of pixels, not a format."""

MAX_LEVELS: Final = 256
PIXELS_PER_LEVEL: Final = 4

_STEPS_M = ((1e-2, "whole centimetres"), (1e-3, "whole millimetres"), (1e-4, "0.1 mm"))


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
        if np.all(np.abs(steps - np.rint(steps)) < 0.02 * np.maximum(steps, 1)):
            return f"{values.size} pixels have {levels.size} equally spaced values: 8 bits?"
    return None
