"""Answers of methods as JSON values, for the served page and for pages without a server."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np

from pliant.baselines.matcher import written_familiarity
from pliant.spec.queries import RecordedPair
from pliant.viewer.explorer.layers import heat_png
from pliant.viewer.explorer.submissions import Method
from pliant.viewer.explorer.truth import TruthFinder, rounded


def answer_document(
    truth: TruthFinder, method: Method, pair: RecordedPair
) -> dict[str, Any] | None:
    """Return a method's answer to the first pixel of a pair, with its error in pixels.

    Args:
        truth: The truth of any pixel.
        method: The method.
        pair: The frames and the pixel.

    Returns:
        JSON values, the heat map as a PNG in base64; None where the method has no answer.
    """
    answer = method.answer(pair)
    if answer is None:
        return None
    true_px, point = answer.true_px, answer.point
    if true_px is None and (found := truth.find(pair.at(point.uv_a_px))) is not None:
        true_px = found.uv_b_px
    known = point.familiarity
    error_px = None if true_px is None else float(np.linalg.norm(point.uv_b_px - true_px))
    heat = None if point.heat is None else base64.b64encode(heat_png(point.heat)).decode("ascii")
    return {
        "query": rounded(point.uv_a_px),
        "place": rounded(point.uv_b_px),
        "error_px": number(error_px),
        "visible": number(point.visible),
        "sigma_px": number(point.sigma_px),
        "confidence": number(answer.confidence),
        "confidence_is": answer.confidence_is,
        "familiarity": None if known is None else float(written_familiarity(known)),
        "material": answer.material,
        "warnings": list(answer.warnings),
        "heat": heat,
        "ms": round(1000 * answer.seconds, 1),
    }


def number(value: float | None) -> float | None:
    """Return a number that JSON can express, or None."""
    return None if value is None or not math.isfinite(value) else round(value, 4)
