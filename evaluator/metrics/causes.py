"""Why answers are wrong: each gets one cause from the truth, and the shares add up to the error.

The causes belong to no protocol: every evaluation of answers on a dataset with surface images has
them, and no score or rank depends on them. docs/scoring.md, "Causes", has the definitions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.evaluator.metrics.base import Groups, Metric, Positive, ScoringContext, Summary
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.surfaces import SurfaceFacts
from pliant.spec.arrays import FloatArray
from pliant.spec.configuration import Settings

CAUSES_VERSION: Final = "1.0"


@dataclass(frozen=True)
class Cause:
    """One cause of an error.

    Attributes:
        name: Its name in scores.json.
        label: Its name for people.
        about: When an answer has it, in one sentence.
    """

    name: str
    label: str
    about: str


CAUSES: Final = (
    Cause("imprecision", "Imprecision", "the answer is close to the right place"),
    Cause(
        "flip", "Flip",
        "the answer is at a point that looks the same: the other end, a symmetric partner",
    ),
    Cause(
        "off_object", "Off the object", "the answer is on the background or on another object"
    ),
    Cause(
        "layer", "Neighbouring strand or layer",
        "the answer is near in the image and on the object, but far away on the material",
    ),
    Cause("across", "Across the rope", "the right place along the rope, but another side of it"),
    Cause("along", "Wrong place on the object", "the answer is elsewhere along the rope or cloth"),
    Cause("missing", "No answer", "the query was not answered"),
    Cause(
        "hidden", "Hidden point",
        "the point is not visible in the target; its error is not in the RMSE",
    ),
)  # fmt: skip
"""In the order of a report; the first that applies decides, except that hidden and missing come
before all others."""

CODES: Final = {cause.name: code for code, cause in enumerate(CAUSES)}
NO_CAUSE: Final = 255
_OUTSIDE_RMSE: Final = "hidden"


class CausesSettings(Settings):
    """Lengths of the definitions, as shares of the longer side of the image.

    Attributes:
        precise: Answers so near the truth are imprecise, not wrong; answers so near the object are
            on it. 4 px at 640 px.
        partner: Answers so near a symmetric partner may be flips. 16 px at 640 px.
        near: Answers so near the truth may be on a neighbouring strand or layer. 32 px at 640 px.
        stretch: Such an answer is on another strand or layer if it is more than so many times
            farther away on the material than in the image.
    """

    precise: Positive = 1 / 160
    partner: Positive = 1 / 40
    near: Positive = 1 / 20
    stretch: Positive = 3.0


class Causes(Metric[CausesSettings]):
    """Number of answers and squared error of each cause."""

    Settings = CausesSettings
    truth_columns = ("point", "alternatives")

    def __init__(self, settings: CausesSettings, context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._side_px = max(context.queries.size)
        tiers = [context.dataset.tiers[name] for name in context.queries.tiers]
        # (T,), which tiers ask about a tube, whose second coordinate is closed.
        self._tubes = np.array([each.queried.material[1].period is not None for each in tiers])
        rows = len(context.answers.uv_px)
        self.codes: npt.NDArray[np.uint8] = np.full(rows, NO_CAUSE, np.uint8)
        """Cause of each answer as its index in `CAUSES`, `NO_CAUSE` where none is known."""

    def update(self, block: Block) -> None:
        """Take in one block."""
        facts = self.context.surfaces.facts(block, self.context.queries)
        code = self._classify(block, facts)
        self.codes[block.rows] = code
        error = np.where(np.isfinite(block.squared_px2), block.squared_px2, 0.0)
        for index, cause in enumerate(CAUSES):
            chosen = code == index
            sums = {"answers": chosen, "px2": chosen * error}
            self.add_sums(block, **{f"cause_{cause.name}_{key}": sums[key] for key in sums})
        self.add_sums(block, causes_known=facts.known)

    def _classify(self, block: Block, facts: SurfaceFacts) -> npt.NDArray[np.uint8]:
        """Return the cause of each row, uint8 (N,); later assignments win."""
        settings, side = self.settings, self._side_px
        error, steps = block.error_px, np.abs(facts.steps_m)
        code = np.full(len(error), NO_CAUSE, np.uint8)
        known = facts.known
        code[known] = CODES["along"]
        tube = self._tubes[self.context.queries.tier[block.pairs]][block.pair]
        code[known & tube & (steps[:, 1] > steps[:, 0])] = CODES["across"]
        span_px = np.hypot(*steps.T) / np.where(facts.pixel_m > 0, facts.pixel_m, np.inf)
        near = error <= settings.near * side
        code[known & near & (span_px > settings.stretch * error)] = CODES["layer"]
        code[known & np.isnan(steps[:, 0])] = CODES["off_object"]
        partner = _nearest_partner_px(block)
        flipped = (partner <= settings.partner * side) & (2 * partner <= error)
        code[known & flipped] = CODES["flip"]
        code[known & (error <= settings.precise * side)] = CODES["imprecision"]
        code[known & block.lost] = CODES["missing"]
        code[~block.counted & np.isfinite(error)] = CODES["hidden"]
        return code

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add the table of causes of each group, and say how many pairs it leaves out."""
        columns = self.table.columns
        pairs = columns["counted"] > 0
        without = int((pairs & (columns["causes_known"] == 0)).sum())
        if without == pairs.sum():
            return
        for index, group in groups:
            mask = groups.masks[index]
            summary.causes[group] = cause_rows(
                {name: float(values[mask].sum()) for name, values in columns.items()}
            )
        if without:
            summary.notes["causes"] = (
                f"{without:,} of {int(pairs.sum()):,} pairs have no surface image in this dataset "
                "and are left out"
            )


def cause_rows(sums: dict[str, float]) -> dict[str, dict[str, Any]]:
    """Return cause -> its answers and its part of the squared error, from sums of the pair table.

    Returns:
        For each cause `answers`, their number; `answers_share`, of the visible points;
        `squared_error_share`, which adds up to 1; `rmse_px` of these answers. Both shares are None
        for hidden points, which the RMSE does not count, and where the error is 0.
    """
    counted = [cause.name for cause in CAUSES if cause.name != _OUTSIDE_RMSE]
    known = sum(sums[f"cause_{name}_answers"] for name in counted)
    total = sum(sums[f"cause_{name}_px2"] for name in counted)
    rows: dict[str, dict[str, Any]] = {}
    for cause in CAUSES:
        answers, squared = (sums[f"cause_{cause.name}_{key}"] for key in ("answers", "px2"))
        inside = cause.name != _OUTSIDE_RMSE
        rows[cause.name] = {
            "answers": int(answers),
            "answers_share": answers / known if inside and known else None,
            "squared_error_share": squared / total if inside and total else None,
            "rmse_px": float(np.sqrt(squared / answers)) if answers else None,
        }
    return rows


def _nearest_partner_px(block: Block) -> FloatArray:
    """Return the distance of each answer to the nearest symmetric partner, float64 (N,), or inf."""
    nearest = np.full(len(block.state), np.inf)
    if block.partners is None or not len(block.partners.uv_px):
        return nearest
    row = block.partners.query
    distance = np.hypot(*(block.answer_px.take(row, axis=0) - block.partners.uv_px).T)
    np.minimum.at(nearest, row, np.where(np.isfinite(distance), distance, np.inf))
    return nearest
