"""An answer as the explorer shows it, whatever kind of method gave it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pliant.spec.arrays import FloatArray
from pliant.viewer.photo_match import PointMatch

Kind = Literal["live", "recorded"]
"""`live` answers any pixel, `recorded` the nearest query."""

PairErrors = dict[str, list[float | None]]
"""Split -> RMSE of each pair in pixels, None where it is not known."""


@dataclass(frozen=True)
class MethodAnswer:
    """Where a method sees one point.

    Attributes:
        point: The pixel that was asked (of recorded answers, the nearest query) and the answer.
        true_px: float64 (2,), the recorded truth of a recorded answer, or None.
        confidence: 0 to 1, or None.
        confidence_is: What the confidence is; empty for none.
        material: What the method itself reads off the pixel, by the names of the material
            coordinates, or None.
        warnings: What makes the answer doubtful, in sentences.
        seconds: Time that the method took.
    """

    point: PointMatch
    true_px: FloatArray | None = None
    confidence: float | None = None
    confidence_is: str = ""
    material: Mapping[str, float] | None = None
    warnings: Sequence[str] = ()
    seconds: float = 0.0
