"""An answer as the explorer shows it, whatever kind of method gave it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pliant.baselines.matcher import Heat
from pliant.spec.arrays import FloatArray

Kind = Literal["live", "recorded"]
"""`live` answers any pixel, `recorded` the nearest query."""

PairErrors = dict[str, list[float | None]]
"""Split -> RMSE of each pair in pixels, None where it is not known."""


@dataclass(frozen=True)
class MethodAnswer:
    """Where a method sees one point.

    Attributes:
        uv_a_px: float64 (2,), the pixel that was asked; of recorded answers, the nearest query.
        uv_b_px: float64 (2,), the answer.
        true_px: float64 (2,), the recorded truth of a recorded answer, or None.
        visible: Probability that the target shows the point, or None.
        sigma_px: Standard deviation of the answer, or None.
        confidence: 0 to 1, or None.
        confidence_is: What the confidence is; empty for none.
        familiarity: 0 to 1, or None.
        heat: The belief over the target, or None.
        material: What the method itself reads off the pixel, by the names of the material
            coordinates, or None.
        warnings: What makes the answer doubtful, in sentences.
        seconds: Time that the method took.
    """

    uv_a_px: FloatArray
    uv_b_px: FloatArray
    true_px: FloatArray | None = None
    visible: float | None = None
    sigma_px: float | None = None
    confidence: float | None = None
    confidence_is: str = ""
    familiarity: float | None = None
    heat: Heat | None = None
    material: Mapping[str, float] | None = None
    warnings: Sequence[str] = ()
    seconds: float = 0.0
