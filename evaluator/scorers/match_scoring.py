"""Scores keypoint matches through the dense truth: the surface images of both frames.

The matter under the source keypoint is looked up in the source frame's surface image and found
again in the target's. Where it shows there is the truth; where it does not show, the match
cannot be right and is counted as not visible. A surface image has one value a pixel, so the
truth of a match is known to about half a pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pliant.evaluator.arrays import BoolArray, FloatArray
from pliant.evaluator.metrics.geodesic import (
    nearest_object_pixel,
    surface_material,
)
from pliant.evaluator.metrics.localisation import endpoint_error_px
from pliant.evaluator.metrics.pck import threshold_level, within_by_pair
from pliant.evaluator.scorers.base import Groups, PairTable, Summary
from pliant.evaluator.scorers.surfaces import ObjectSurface, Surfaces
from pliant.evaluator.statistics.ratios import threshold_name
from pliant.evaluator.submission.matches import Matches
from pliant.evaluator.submission.queries import Queries
from pliant.spec.errors import SpecError
from pliant.spec.model import MaterialObject

_CHUNK_CELLS: Final = 1 << 21
_TORN: Final = 8.0
"""Neighbouring pixels further apart than so many median footprints lie on different folds."""


@dataclass(frozen=True)
class DenseTruth:
    """Where the matter under some source pixels is in the target frame.

    Attributes:
        on_object: bool (M,), source positions on the queried object.
        visible: bool (M,), whether that matter shows in the target frame.
        uv_b_px: float64 (M, 2), where; NaN where it does not.
    """

    on_object: BoolArray
    visible: BoolArray
    uv_b_px: FloatArray


def dense_truth(
    source: ObjectSurface,
    target: ObjectSurface,
    uv_a_px: FloatArray,
    queried: MaterialObject,
    footprints: float,
) -> DenseTruth:
    """Find the matter under source positions in the target frame.

    Args:
        source: The queried object in the source frame.
        target: The queried object in the target frame.
        uv_a_px: float64 (M, 2), positions in the source frame.
        queried: The queried object.
        footprints: The matter shows where a target pixel is within so many times what one
            pixel spans there.
    """
    count = len(uv_a_px)
    row, column, on_object = nearest_object_pixel(source.on_object, uv_a_px, 0)
    result = DenseTruth(on_object, np.zeros(count, bool), np.full((count, 2), np.nan))
    rows_b, columns_b = np.nonzero(target.on_object)
    asked = np.flatnonzero(on_object)
    if not len(rows_b) or not len(asked):
        return result
    wanted = surface_material(source.m0, source.m1, row[asked], column[asked])
    there = surface_material(target.m0, target.m1, rows_b, columns_b)
    footprint = _footprint_m(target, queried)[rows_b, columns_b]
    step = max(1, _CHUNK_CELLS // len(there))
    for first in range(0, len(asked), step):
        part = slice(first, first + step)
        distance = queried.distance_m(wanted[part, None], there[None])
        nearest = distance.argmin(axis=1)
        least = distance[np.arange(len(nearest)), nearest]
        shown = least <= footprints * footprint[nearest]
        chosen = asked[part][shown]
        result.visible[chosen] = True
        result.uv_b_px[chosen, 0] = columns_b[nearest[shown]] + 0.5
        result.uv_b_px[chosen, 1] = rows_b[nearest[shown]] + 0.5
    return result


def _footprint_m(surface: ObjectSurface, queried: MaterialObject) -> FloatArray:
    """Return how much material one pixel spans, float64 (H, W), metres; 0 off the object."""
    field = np.stack([surface.m0, surface.m1], axis=-1).astype(np.float64)
    on = surface.on_object
    across = np.where(on[:, 1:] & on[:, :-1], queried.distance_m(field[:, 1:], field[:, :-1]), 0)
    down = np.where(on[1:] & on[:-1], queried.distance_m(field[1:], field[:-1]), 0)
    steps = np.concatenate([across[across > 0], down[down > 0]])
    typical = float(np.median(steps)) if len(steps) else 0.0
    result = np.where(on, typical, 0.0)
    for span, first, second in (
        (across, np.s_[:, 1:], np.s_[:, :-1]),
        (down, np.s_[1:], np.s_[:-1]),
    ):
        whole = np.where(span <= _TORN * typical, span, 0)
        result[first] = np.maximum(result[first], whole)
        result[second] = np.maximum(result[second], whole)
    return result


def score_matches(
    matches: Matches,
    queries: Queries,
    metrics: Mapping[str, Mapping[str, Any]],
    table: PairTable,
    groups: Groups,
    summary: Summary,
    surfaces: Surfaces,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Fill the pair table with what the matches are worth.

    Raises:
        SpecError: The dataset holds no surface images of a pair.
    """
    pairs = queries.pairs
    error = np.full(len(matches.uv_a_px), np.nan)
    on_object = np.zeros(len(error), bool)
    target_on_object = np.zeros(len(error), bool)
    outside = np.zeros(len(error), bool)
    for pair in np.flatnonzero(np.diff(matches.starts)).tolist():
        if progress is not None:
            progress(pair, pairs)
        rows = slice(int(matches.starts[pair]), int(matches.starts[pair + 1]))
        source = _surface(surfaces, queries, pair, "a")
        target = _surface(surfaces, queries, pair, "b")
        truth = dense_truth(
            source,
            target,
            matches.uv_a_px[rows],
            surfaces.queried(queries.tiers[queries.tier[pair]]),
            float(metrics["matches"]["visible_within_footprints"]),
        )
        at = matches.uv_b_px[rows]
        error[rows] = endpoint_error_px(at, truth.uv_b_px)
        on_object[rows] = truth.on_object
        target_on_object[rows] = nearest_object_pixel(target.on_object, at, 0)[2] & truth.on_object
        outside[rows] = np.any((at < 0) | (at > np.array(queries.size)), axis=1)
    counted = np.isfinite(error)
    pair_of = np.repeat(np.arange(pairs), np.diff(matches.starts))
    everything = slice(0, pairs)

    def put(name: str, weights: Any) -> None:
        table.put(name, everything, np.bincount(pair_of, weights, pairs))

    put("matches", np.ones(len(error)))
    put("answered", np.ones(len(error)))
    put("on_object", on_object)
    put("target_on_object", target_on_object)
    put("outside_image", outside)
    put("counted", counted)
    put("sum_error_px", np.where(counted, error, 0))
    put("sum_squared_px2", np.where(counted, error, 0) ** 2)
    table.put("queries", everything, np.diff(queries.starts))
    table.put("matched", everything, table.columns["counted"] > 0)
    thresholds = metrics["pck"]["thresholds_px"]
    level = threshold_level(error[counted], thresholds, metrics["pck"]["comparison"])
    within = within_by_pair(level, pair_of[counted], pairs, len(thresholds))
    for index, threshold in enumerate(thresholds):
        table.put(f"within_{threshold_name(threshold)}px", everything, within[:, index])
    names = {0.5: "median_px"}
    for index, name in groups:
        mine = error[counted & groups.masks[index][pair_of]]
        for quantile in metrics["localisation"]["quantiles"]:
            value = float(np.quantile(mine, quantile)) if len(mine) else None
            summary.set(name, names.get(quantile, f"p{quantile * 100:g}_px"), value)


def _surface(surfaces: Surfaces, queries: Queries, pair: int, side: str) -> ObjectSurface:
    sequence = getattr(queries, f"sequence_{side}")[pair]
    frame = int(getattr(queries, f"frame_{side}")[pair])
    surface = surfaces.frame(queries.sequences[sequence], frame)
    if surface is None:
        raise SpecError(
            "keypoint matches are scored through surface images, and one is missing",
            path=surfaces.path(queries.sequences[sequence], frame),
            fix="Score where the whole dataset is, or submit answers instead.",
        )
    return surface
