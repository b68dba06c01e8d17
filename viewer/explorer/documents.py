"""What the page shows as JSON values: what there is, what two frames lack, answers of methods.

Imported and withheld frames have fewer files than others.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from pliant.baselines.matcher import written_familiarity
from pliant.spec.dataset import Dataset
from pliant.spec.queries import RecordedPair
from pliant.spec.sequence import RecordedFrame, SequenceRecord
from pliant.spec.storage import layout
from pliant.viewer.explorer.layers import ERROR_SCALE_PX, heat_png
from pliant.viewer.explorer.live import LiveMethod
from pliant.viewer.explorer.recorded import RecordedQueries
from pliant.viewer.explorer.submissions import Method
from pliant.viewer.explorer.truth import TruthFinder, rounded

NO_SCENE: Final = "3D needs tracked points and cameras, which the dataset does not have here"

_NO_DEPTH: Final = "the dataset does not have depth here"
_NO_INDEX: Final = "index colours need surface images, which the dataset does not have here"
_NO_MASK: Final = "the dataset does not have masks here"
_NO_ERROR: Final = (
    "the error map needs the true place of every pixel (surface images), which the dataset does "
    "not have here"
)


def catalogue(
    dataset: Dataset, queries: RecordedQueries, methods: Sequence[Method]
) -> dict[str, Any]:
    """Return what the page lists, as JSON values.

    `sequences` has [id, tier, split, shape, frames, temporal] and `pairs` has [split, number in the
    split, source sequence, source frame, target sequence, target frame, queries], sequences by
    their number in the list. Each method has `errors`, one RMSE in pixels or null per pair.
    """
    number = {sequence.id: k for k, sequence in enumerate(dataset.sequences)}
    return {
        "title": str(dataset.info.get("title") or dataset.id),
        "id": dataset.id,
        "version": dataset.version,
        "size": list(dataset.size),
        "tiers": {name: tier.kind for name, tier in dataset.tiers.items()},
        "sequences": [
            [each.id, each.tier, each.split, each.shape, each.frames, each.temporal]
            for each in dataset.sequences
        ],
        "pairs": [
            [
                split,
                pair.pair_id,
                *(number[pair.source.sequence.id], pair.source.index),
                *(number[pair.target.sequence.id], pair.target.index),
                len(pair),
            ]
            for split, found in queries.splits.items()
            for pair in found.pairs
        ],
        "methods": [_method(each, queries) for each in methods],
        "error_scale_px": list(ERROR_SCALE_PX),
    }


def _method(method: Method, queries: RecordedQueries) -> dict[str, Any]:
    errors: list[float | None] = []
    for split, found in queries.splits.items():
        known = method.errors.get(split)
        errors += [None] * len(found.pairs) if known is None else list(known)
    return {
        "name": method.name,
        "kind": method.kind,
        **(method.shows if isinstance(method, LiveMethod) else {"answered": method.answered}),
        "errors": [None if each is None else round(each, 3) for each in errors],
    }


def missing(pair: RecordedPair) -> dict[str, str]:
    """Return what two frames lack: a layer or `scene` -> the reason, as text for the page."""
    frames = (pair.source, pair.target)
    found = {
        "depth": (_NO_DEPTH, all(_has(each, layout.camera_depth_name) for each in frames)),
        "index": (_NO_INDEX, all(each.has_surface for each in frames)),
        "mask": (_NO_MASK, all(_has(each, layout.mask_name) for each in frames)),
        "error": (_NO_ERROR, all(each.has_surface for each in frames)),
        "scene": (NO_SCENE, all(has_scene(each.sequence) for each in frames)),
    }
    return {name: reason for name, (reason, there) in found.items() if not there}


def has_scene(sequence: SequenceRecord) -> bool:
    """Return whether a sequence has what the 3D view shows."""
    tables = (layout.POINTS_TABLE, layout.CORRESPONDENCES_TABLE)
    return sequence.has_cameras and all(sequence.has(name) for name in tables)


def _has(frame: RecordedFrame, name: Callable[[int], str]) -> bool:
    return frame.has_surface or frame.sequence.has(name(frame.index))


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
