"""Metrics that are ratios of sums over image pairs, as a table.

Everything that is an average (RMSE, PCK, AJ …) is the quotient of two columns of the pair table,
summed. One list of quotients therefore serves tiers, slices, bootstrap intervals, comparisons and
leaderboards alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from pliant.evaluator.arrays import FloatArray
from pliant.spec.errors import SpecError

Better = Literal["lower", "higher", "neither"]


@dataclass(frozen=True)
class Ratio:
    """One averaged metric.

    Attributes:
        name: Its name in scores.json.
        numerator, denominator: Columns of the pair table.
        better: Which direction is better; `neither` where a target value is (a coverage).
        unit: Unit for people; empty for a share.
        root: Whether the root of the quotient is taken.
        over_pairs: Average the quotients of the pairs that have a denominator, each with the
            same weight, instead of dividing the sums (pooling).
        about: What it is, in one sentence.
    """

    name: str
    numerator: str
    denominator: str
    better: Better
    unit: str
    about: str
    root: bool = False
    over_pairs: bool = False

    def terms(self, columns: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return what is summed above and below, float64 (P,) each.

        Raises:
            SpecError: The table has no such column.
        """
        for name in (self.numerator, self.denominator):
            if name not in columns:
                raise SpecError(
                    "the table of pairs lacks a column of a metric",
                    where=self.name,
                    found=", ".join(sorted(columns)),
                    required=name,
                    fix="Evaluate the submission again with this version of Pliant.",
                )
        above, below = columns[self.numerator], columns[self.denominator]
        if not self.over_pairs:
            return above, below
        defined = below > 0
        value = np.divide(above, below, out=np.zeros(len(above)), where=defined)
        if self.root:
            value = np.sqrt(value)
        return value, defined.astype(np.float64)

    def finish(self, above: FloatArray, below: FloatArray) -> FloatArray:
        """Return the metric from the two sums; NaN where nothing was counted."""
        with np.errstate(invalid="ignore", divide="ignore"):
            value = np.where(below > 0, above / np.where(below > 0, below, 1), np.nan)
            return np.sqrt(value) if self.root and not self.over_pairs else value


def threshold_name(threshold: float) -> str:
    """Return a threshold as it stands in names: 4, 0.05, 0.1."""
    return f"{threshold:g}"


def ratios_of(metrics: Mapping[str, Mapping[str, Any]]) -> list[Ratio]:
    """Return the ratios that a protocol's families of metrics define.

    Args:
        metrics: The `metrics` of a protocol.
    """
    result: list[Ratio] = []
    if "localisation" in metrics:
        result += _localisation()
    if "pck" in metrics:
        result += _pck(metrics["pck"])
    if "symmetry" in metrics:
        result += _symmetry()
    if "tapvid" in metrics:
        result += _tapvid(metrics["tapvid"])
    if "geodesic" in metrics:
        result += _geodesic()
    if "continuity" in metrics:
        result += [
            Ratio(
                "jump_rate", "jumps", "neighbours", "lower", "",
                "share of neighbouring queries whose answers are torn apart",
            )
        ]  # fmt: skip
    if "jitter" in metrics:
        result += [
            Ratio(
                "jitter_px", "sum_jitter_px", "jitter_steps", "lower", "px",
                "mean change of the error from one frame of an episode to the next",
            )
        ]  # fmt: skip
    if "time" in metrics:
        result += _time(metrics["time"])
    if "distribution" in metrics:
        result += _distribution(metrics["distribution"])
    if "matches" in metrics:
        result += _matches()
    return result


def _localisation() -> list[Ratio]:
    pooled = Ratio(
        "rmse_px", "sum_squared_px2", "counted", "lower", "px",
        "root mean squared error, pooled over queries", root=True,
    )  # fmt: skip
    return [
        pooled,
        replace(
            pooled,
            name="rmse_px_mean_over_pairs",
            about="mean over image pairs of each pair's RMSE",
            over_pairs=True,
        ),
        Ratio("mean_px", "sum_error_px", "counted", "lower", "px", "mean error"),
        Ratio(
            "outside_image_rate", "outside_image", "answered", "neither", "",
            "share of answers outside the target image",
        ),
    ]  # fmt: skip


def _pck(settings: Mapping[str, Any]) -> list[Ratio]:
    result: list[Ratio] = []
    kinds = (("thresholds_px", "px", " px"), ("thresholds_box", "box", " of the object's box"))
    for key, suffix, words in kinds:
        for threshold in settings[key]:
            name = f"{threshold_name(threshold)}{suffix}"
            about = f"share of answers within {threshold_name(threshold)}{words}"
            pooled = Ratio(f"pck_{name}", f"within_{name}", "counted", "higher", "", about)
            mean = f"{about}, mean over image pairs"
            over_pairs = replace(
                pooled, name=f"pck_{name}_mean_over_pairs", about=mean, over_pairs=True
            )
            result += [pooled, over_pairs]
    return result


def _symmetry() -> list[Ratio]:
    return [
        Ratio(
            "symmetric_rmse_px", "symmetric_squared_px2", "counted", "lower", "px",
            "RMSE under the symmetry that is best for each pair", root=True,
        ),
        Ratio(
            "symmetric_rmse_px_mean_over_pairs", "symmetric_squared_px2", "counted", "lower", "px",
            "mean over image pairs of the same", root=True, over_pairs=True,
        ),
        Ratio(
            "point_symmetric_rmse_px", "point_symmetric_squared_px2", "counted", "lower", "px",
            "RMSE where each point may be taken for a visible partner", root=True,
        ),
        Ratio(
            "flip_rate", "flipped_pairs", "symmetric_pairs", "lower", "",
            "share of pairs that a symmetry other than the identity explains best",
        ),
        Ratio(
            "point_flip_rate", "flipped_points", "symmetric_points", "lower", "",
            "share of points whose answer is nearer to a visible partner",
        ),
    ]  # fmt: skip


def _tapvid(settings: Mapping[str, Any]) -> list[Ratio]:
    mean = "mean over image pairs (TAP-Vid: over videos)"
    result = [
        Ratio("oa", "oa_pair", "one", "higher", "", f"occlusion accuracy, {mean}"),
        Ratio(
            "delta_avg", "delta_avg_pair", "tapvid_pair", "higher", "",
            f"share of visible points within the thresholds, averaged over them, {mean}",
        ),
        Ratio(
            "aj", "aj_pair", "jaccard_pair", "higher", "",
            f"average Jaccard over the thresholds, {mean}",
        ),
    ]  # fmt: skip
    for threshold in settings["thresholds"]:
        t = threshold_name(threshold)
        result += [
            Ratio(
                f"delta_{t}", f"delta_{t}_pair", "tapvid_pair", "higher", "",
                f"share of visible points within {t} scaled px, {mean}",
            ),
            Ratio(
                f"jaccard_{t}", f"jaccard_{t}_pair", "jaccard_pair", "higher", "",
                f"Jaccard at {t} scaled px, {mean}",
            ),
        ]  # fmt: skip
    return result


def _geodesic() -> list[Ratio]:
    return [
        Ratio(
            "geodesic_mean_m", "sum_geodesic_m", "geodesic_points", "lower", "m",
            "mean distance on the material between the right point and what lies under the answer",
        ),
        Ratio(
            "geodesic_rmse_m", "sum_squared_geodesic_m2", "geodesic_points", "lower", "m",
            "root mean squared distance on the material", root=True,
        ),
        Ratio(
            "off_object_rate", "off_object", "geodesic_asked", "lower", "",
            "share of answers that do not lie on the queried object",
        ),
    ]  # fmt: skip


def _time(settings: Mapping[str, Any]) -> list[Ratio]:
    return [
        Ratio(
            f"rmse_px_after_{frames}", f"time_squared_px2_{frames}", f"time_counted_{frames}",
            "lower", "px", f"RMSE {frames} frames after the query, in its episode", root=True,
        )
        for frames in settings["frames"]
    ]  # fmt: skip


def _distribution(settings: Mapping[str, Any]) -> list[Ratio]:
    result = [
        Ratio(
            "nll", "sum_nll", "distributions", "lower", "nats",
            "mean negative log likelihood of the truth, density per square pixel",
        )
    ]  # fmt: skip
    for level in settings["regions"]:
        percent = threshold_name(level * 100)
        result.append(
            Ratio(
                f"coverage_{percent}", f"in_region_{percent}", "distributions", "neither", "",
                f"share of truths inside the smallest region that holds {percent} %",
            )
        )  # fmt: skip
    result.append(
        Ratio(
            "mode_recall", "recalled", "recallable", "higher", "",
            "share of the equivalent visible positions that have a mode near them",
        )
    )  # fmt: skip
    return result


def _matches() -> list[Ratio]:
    return [
        Ratio(
            "match_coverage", "matched", "one", "higher", "",
            "share of image pairs with at least one match that could be scored",
        ),
        Ratio("matches_per_pair", "matches", "one", "neither", "", "mean number of matches a pair"),
        Ratio(
            "on_object_rate", "on_object", "matches", "higher", "",
            "share of matches whose source keypoint lies on the queried object",
        ),
        Ratio(
            "partner_visible_rate", "counted", "on_object", "higher", "",
            "share of those whose point is visible in the target frame",
        ),
        Ratio(
            "target_on_object_rate", "target_on_object", "on_object", "higher", "",
            "share of those whose target keypoint lies on the queried object",
        ),
    ]  # fmt: skip
