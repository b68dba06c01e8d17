"""What the measured points of a sequence say about it as a whole: shifts, depth, scale."""

from __future__ import annotations

from typing import Final

import numpy as np

from pliant.spec.arrays import FloatArray
from pliant.spec.model import Tier
from pliant.spec.storage.layout import DATASET_JSON
from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.alignment import Alignment, Measured, joined

MIN_POINTS: Final = 12
"""A median over fewer points says nothing."""

SHIFT_PX: Final = 0.1
"""A constant shift below this is left alone, pixels; statistical doubt is added."""

SCATTER_PX: Final = 0.1
"""Median distance from the median shift, pixels; the interpolation's error is added."""

NOISE: Final = 0.1
"""Noise from pixel to pixel, pixels of material or footprints of depth; curvature adds to it."""

DEPTH_SHIFT: Final = 0.15
"""Median depth residual, pixel footprints; what curvature explains is added."""

DEPTH_SCATTER: Final = 0.1
"""Twice the median distance of the depth residual from its median, pixel footprints."""

RESOLVED_PX: Final = 0.5
"""Error of the interpolation, pixels, below which slopes tell a scale: not on a rope 3 px wide."""

SCALE_FACTOR: Final = 3.0
"""How far a unit of the material may be from `metres_per_unit`."""


def check_agreement(
    tier: Tier, fitting: Alignment, others: Alignment, problems: FileProblems
) -> bool:
    """Check the measured points of a sequence.

    Args:
        tier: The sequence's tier.
        fitting: Points of frames whose surface image shows most of them.
        others: Points of the other frames, which have an issue of their own.
        problems: Those of the correspondence table. Gets `OFFSET_DISAGREES`,
            `OFFSET_SCATTERS`, `DEPTH_IMAGE_DISAGREES`, `DEPTH_IMAGE_SCATTERS`,
            `SURFACE_NOISY` and `SCALE_DISAGREES`.

    Returns:
        True if the images' depth is known not to be that of the tables.
    """
    frames = fitting.frames()
    measured = joined(frames)
    enough = measured is not None and len(measured) >= MIN_POINTS
    if measured is not None and enough and _check_shift(frames, measured, problems):
        return False  # the other measurements would follow from this
    measured = joined([*frames, *(part for part in others.frames() if _in_place(part))])
    if measured is None or len(measured) < MIN_POINTS:
        return False
    _check_noise(measured, problems)
    wrong_depth = _check_depth(measured, problems)
    if not wrong_depth:
        _check_scale(tier, measured, problems.findings.at(DATASET_JSON))
    return wrong_depth


def _in_place(part: Measured) -> bool:
    """Return whether an image shows the points' material where they are, whatever its depth."""
    return len(part) >= MIN_POINTS and float(np.median(np.abs(part.offset_px))) < 0.5


def _doubt(values: FloatArray, errors: float = 5.0) -> float:
    """Return some standard errors of the median of values (N, K): the largest of the columns."""
    spread = 1.4826 * np.median(np.abs(values - np.median(values, axis=0)), axis=0)
    return float(np.max(errors * 1.2533 * spread / np.sqrt(len(values))))


def _median_over(values: FloatArray, limit: float) -> bool:
    """Return whether the median of values (N,) is over a limit by two standard errors."""
    return float(np.median(values)) > limit + _doubt(values[:, None], 2.0)


def _check_shift(parts: list[Measured], measured: Measured, problems: FileProblems) -> bool:
    """Check where the points are; return True if that explains all that follows."""
    if _is_shifted(measured):
        problems.diagnose("OFFSET_DISAGREES", _shift_text(measured))
        return True
    shifted = [part for part in parts if len(part) >= MIN_POINTS and _is_shifted(part)]
    if shifted:
        frames = _few([int(part.frame[0]) for part in shifted])
        problems.add("OFFSET_DISAGREES", f"frames {frames}", _shift_text(shifted[0]))
    shift = np.median(measured.offset_px, axis=0)
    distance = np.abs(measured.offset_px - shift).max(axis=1)
    scatter = float(np.median(distance))
    if scatter > SCATTER_PX + float(np.median(measured.error_px)):
        problems.add(
            "OFFSET_SCATTERS",
            "",
            f"half of the points are more than {scatter:.2f} px from where the surface layer "
            f"shows their material (the interpolation explains "
            f"{float(np.median(measured.error_px)):.2f} px): noisy or rounded positions, a focal "
            "length that differs from the images', or a material layer of few bits?",
        )
        return True
    return bool(shifted)


def _is_shifted(part: Measured) -> bool:
    shift = np.abs(np.median(part.offset_px, axis=0)).max()
    return bool(shift > SHIFT_PX + _doubt(part.offset_px))


def _shift_text(part: Measured) -> str:
    u, v = (round(float(value), 1) + 0.0 for value in -np.median(part.offset_px, axis=0))
    cause = "the images are shifted, or of another camera?"
    if {abs(u), abs(v)} <= {0.0, 0.5}:
        cause = "pixel centres at whole numbers in one of them (OpenCV convention)?"
    elif {abs(u) % 1, abs(v) % 1} == {0.0}:
        cause = "the depth images are shifted by whole pixels?"
    return (
        f"u_px, v_px differ by about ({u:+.1f}, {v:+.1f}) px from where the surface layer shows "
        f"the points' material: {cause}"
    )


def _few(numbers: list[int]) -> str:
    shown = ", ".join(str(number) for number in numbers[:5])
    return shown + (f" and {len(numbers) - 5} more" if len(numbers) > 5 else "")


def _check_noise(measured: Measured, problems: FileProblems) -> None:
    noise = float(np.median(measured.noise_px))
    if _median_over(measured.noise_px, NOISE + 2 * float(np.median(measured.bend_px))):
        problems.add(
            "SURFACE_NOISY",
            "",
            f"the material coordinates of the surface layer have noise of {noise:.2f} px (median) "
            "from pixel to pixel: noise added, or values predicted instead of computed?",
        )


def _check_depth(measured: Measured, problems: FileProblems) -> bool:
    residual = measured.shown_m - measured.depth_m
    relative = residual / measured.footprint_m
    explained = float(np.median(measured.error_px))
    middle = float(np.median(relative))
    if abs(middle) > DEPTH_SHIFT + 2.2 * explained + _doubt(relative[:, None]):
        problems.diagnose("DEPTH_IMAGE_DISAGREES", _depth_text(measured))
        return True
    distance = 2 * np.abs(relative - middle)
    bend = float(np.median(measured.bend_depth))
    if _median_over(distance, DEPTH_SCATTER + 1.5 * explained + bend) or _median_over(
        measured.noise_depth, NOISE + 1.5 * explained + 4 * bend
    ):
        size = 1e3 * float(np.median(np.abs(residual - np.median(residual))))
        problems.add(
            "DEPTH_IMAGE_SCATTERS",
            "",
            f"the depth images differ from depth_m by {size:.2f} mm (median) in both directions: "
            "noisy, rounded or compressed depth?",
        )
    return False


def _depth_text(measured: Measured) -> str:
    ratio = measured.shown_m / measured.depth_m
    factor = float(np.median(ratio))
    for number, name in ((1000, "millimetres"), (100, "centimetres"), (1e-3, "kilometres")):
        if abs(factor / number - 1) < 0.05:
            return f"the depth images are {number:g} times depth_m: {name}?"
    plain = float(np.median(np.abs(ratio - factor)))
    along = float(np.median(np.abs(ratio / measured.ray - 1)))
    text = "the depth images hold other depths than the tables"
    if along < 0.3 * float(np.median(np.abs(ratio - 1))):
        return "the depth images have the length of the ray; required: planar z"
    shift = float(np.median(measured.shown_m - measured.depth_m))
    steady = float(np.median(np.abs(measured.shown_m - measured.depth_m - shift)))
    by_shift, by_factor = steady < 0.2 * abs(shift), plain < 0.2 * abs(factor - 1)
    # Where the depths are alike both may explain them; the right one leaves less.
    if by_shift and not (by_factor and plain * abs(shift) < steady * abs(factor - 1)):
        return f"{text}: they differ by about {1e3 * shift:+.1f} mm"
    if by_factor:
        return f"{text}: they are about {factor:.3g} times depth_m"
    return f"{text}: of another frame or another camera?"


def _check_scale(tier: Tier, measured: Measured, problems: FileProblems) -> None:
    resolved = np.isfinite(measured.metres).all(axis=1) & (measured.error_px < RESOLVED_PX)
    metres = measured.metres[resolved]
    if len(metres) < MIN_POINTS:
        return
    wrong = []
    for coordinate, found in zip(tier.queried.material, np.median(metres, axis=0), strict=True):
        declared = coordinate.metres_per_unit
        ratio = float(found) / declared
        if not 1 / SCALE_FACTOR <= ratio <= SCALE_FACTOR:
            about = declared * 10.0 ** round(float(np.log10(ratio)))
            wrong.append(f"of {coordinate.name} is {declared:g}, the images show {about:.3g}")
    if wrong:
        problems.add(
            "SCALE_DISAGREES",
            f"{tier.name}, {tier.queried.name}",
            f"metres_per_unit {'; '.join(wrong)}: a wrong power of ten, or positions in another "
            "unit than metres?",
        )
