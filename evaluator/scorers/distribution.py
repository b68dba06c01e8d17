"""Figures for answers that come with a distribution, `sigma` or `modes`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final

import numpy as np

from pliant.evaluator.arrays import BoolArray, FloatArray, IntArray
from pliant.evaluator.metrics import calibration, distribution
from pliant.evaluator.metrics.distribution import Mixtures
from pliant.evaluator.metrics.localisation import sum_by_pair
from pliant.evaluator.scorers.base import Groups, Scorer, ScoringContext, Summary
from pliant.evaluator.statistics.ratios import threshold_name
from pliant.evaluator.submission.blocks import Block

_MOST_SORTED: Final = 4_000_000
"""Sparsification sorts: of more answers than this, every k-th is taken, and a note says so."""


class DistributionScorer(Scorer):
    """NLL, calibration, regions, sparsification and mode recall."""

    truth_columns: ClassVar[tuple[str, ...]] = ("alternatives",)

    def __init__(self, settings: Mapping[str, Any], context: ScoringContext) -> None:
        super().__init__(settings, context)
        answers = context.answers
        self._present = answers.sigma_px is not None or answers.modes is not None
        self._bins = int(settings["ece_bins"])
        self._reliability = np.zeros((len(context.queries.tiers), self._bins, 3))
        self._missing = np.zeros(len(context.queries.tiers))
        if self._present:
            rows = context.queries.rows
            self._spread = context.scratch.full(rows, np.float64, np.nan)
            self._squared = context.scratch.full(rows, np.float64, np.nan)

    def update(self, block: Block) -> None:
        """Take in one block."""
        if not self._present:
            return
        usable = block.counted
        lost = np.zeros(len(usable), bool) if block.missing is None else usable & block.missing
        rows = np.flatnonzero(usable & ~lost)
        starts, pairs, put = block.starts[:-1], block.pairs, self.table.put
        put("distributions", pairs, sum_by_pair(usable, starts))
        sums: dict[str, FloatArray] = {"sum_nll": np.zeros(len(usable))}
        for level in self.settings["regions"]:
            sums[f"in_region_{threshold_name(level * 100)}"] = np.zeros(len(usable))
        recalled, recallable = np.zeros(len(usable)), np.zeros(len(usable))
        step = 1 << 15
        for first in range(0, len(rows), step):
            chosen = rows[first : first + step]
            mixtures = self._mixtures(block, chosen)
            self._add_sums(block, chosen, mixtures, sums)
            self._add_reliability(block, chosen, mixtures)
            self._spread[block.first_row + chosen] = distribution.spread_px(mixtures)
            self._squared[block.first_row + chosen] = block.squared_px2[chosen]
            self._add_recall(block, chosen, mixtures, recalled, recallable)
        if lost.any():
            self._add_missing(block, np.flatnonzero(lost), sums, recallable)
        for name, values in sums.items():
            put(name, pairs, sum_by_pair(values, starts))
        put("recalled", pairs, sum_by_pair(recalled, starts))
        put("recallable", pairs, sum_by_pair(recallable, starts))

    def _add_missing(
        self, block: Block, lost: IntArray, sums: dict[str, FloatArray], recallable: FloatArray
    ) -> None:
        """Count missing answers as the worst: certain, and wrong by the image diagonal."""
        width, height = self.context.queries.size
        sums["sum_nll"][lost] = np.log(width * height / self.settings["outlier_weight"])
        tier = self.context.queries.tier[block.first_pair + block.pair[lost]]
        self._missing += np.bincount(tier, minlength=len(self._missing))
        self._spread[block.first_row + lost] = 0.0
        self._squared[block.first_row + lost] = block.squared_px2[lost]
        asked = _recall_positions(block, lost)
        if asked is not None:
            recallable[lost] = asked[1].sum(axis=1)

    def _mixtures(self, block: Block, chosen: IntArray) -> Mixtures:
        """Return the distributions of some rows of a block, their sigma floored."""
        answers, floor = self.context.answers, self.settings["sigma_floor_px"]
        at = block.first_row + chosen
        if answers.sigma_px is not None:
            sigma = answers.sigma_px[at].astype(np.float64)
            own = block.answer_px[chosen].astype(np.float64)
            row = np.arange(len(chosen))
            return Mixtures(row, own, np.maximum(sigma, floor), np.ones(len(row)), len(row))
        if answers.modes is None or answers.mode_begin is None or answers.mode_count is None:
            raise RuntimeError("a submission without a distribution has no mixtures")
        count = answers.mode_count[at].astype(np.int64)
        row = np.repeat(np.arange(len(chosen)), count)
        within = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        modes = answers.modes[answers.mode_begin[at][row] + within].astype(np.float64)
        total = np.bincount(row, modes[:, 3], len(chosen))
        weight = modes[:, 3] / total[row]
        return Mixtures(row, modes[:, :2], np.maximum(modes[:, 2], floor), weight, len(chosen))

    def _add_sums(
        self, block: Block, chosen: IntArray, mixtures: Mixtures, sums: dict[str, FloatArray]
    ) -> None:
        width, height = self.context.queries.size
        true_px = block.true_px[chosen]
        sums["sum_nll"][chosen] = distribution.negative_log_likelihood(
            mixtures,
            true_px,
            outlier_weight=self.settings["outlier_weight"],
            area_px2=float(width * height),
        )
        levels = self.settings["regions"]
        regions = distribution.in_regions(mixtures, true_px, levels)
        for level, inside in zip(levels, regions, strict=True):
            sums[f"in_region_{threshold_name(level * 100)}"][chosen] = inside

    def _add_reliability(self, block: Block, chosen: IntArray, mixtures: Mixtures) -> None:
        radius = self.settings["ece_radius_px"]
        centre = block.answer_px[chosen].astype(np.float64)
        confidence = distribution.probability_within(mixtures, centre, radius)
        happened = block.error_px[chosen] <= radius
        tier = self.context.queries.tier[block.first_pair + block.pair[chosen]]
        for code in np.unique(tier).tolist():
            of_tier = tier == code
            self._reliability[code] += calibration.reliability_bins(
                confidence[of_tier], happened[of_tier], self._bins
            )

    def _add_recall(
        self,
        block: Block,
        chosen: IntArray,
        mixtures: Mixtures,
        recalled: FloatArray,
        recallable: FloatArray,
    ) -> None:
        positions = _recall_positions(block, chosen)
        if positions is None:
            return
        at, asked = positions
        near = distribution.modes_near(
            mixtures, at, self.settings["recall_radius_px"], self.settings["recall_min_weight"]
        )
        recalled[chosen] = (near & asked).sum(axis=1)
        recallable[chosen] = asked.sum(axis=1)

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add ECE, AUSE and their curves."""
        if not self._present:
            summary.notes["distribution"] = (
                "the submission has neither `sigma` nor `modes`: no figures of a distribution"
            )
            names = ["distributions", "sum_nll", "recalled", "recallable"]
            names += [f"in_region_{threshold_name(x * 100)}" for x in self.settings["regions"]]
            self.table.ensure(*names)
            return
        for index, name in groups:
            table = self._reliability.sum(axis=0) if index == 0 else self._reliability[index - 1]
            missing = self._missing.sum() if index == 0 else self._missing[index - 1]
            worst = np.array([[missing, missing, 0.0]])  # certain, and never within the radius
            error = calibration.expected_calibration_error(np.concatenate([table, worst]))
            summary.set(name, "ece", error)
            used, confidence, frequency = calibration.reliability_curve(table)
            curve = {
                "radius_px": self.settings["ece_radius_px"],
                "count": table[used, 0].astype(int).tolist(),
                "confidence": confidence.tolist(),
                "frequency": frequency.tolist(),
            }
            summary.add_curve(name, "reliability", curve)
            self._sparsify(index, name, groups, summary)

    def _sparsify(self, index: int, name: str, groups: Groups, summary: Summary) -> None:
        counted = self.table.columns["distributions"][groups.masks[index]].sum()
        every = max(1, int(np.ceil(counted / _MOST_SORTED)))
        spread, squared = (
            np.concatenate([part[::every] for part in groups.rows(index, store)])
            for store in (self._spread, self._squared)
        )
        fine = np.isfinite(spread)
        spread, squared = spread[fine], squared[fine]
        if not len(spread):
            summary.set(name, "ause", None)
            return
        if every > 1:
            summary.notes["ause"] = f"taken over every {every}th answer of the largest groups"
        steps = self.settings["sparsification_steps"]
        left = calibration.sparsification(squared, spread, steps)
        answered = np.where(spread > 0, squared, 0.0)  # the best order has no missing answers
        best = calibration.sparsification(answered, answered, steps)
        summary.set(name, "ause", calibration.area_under_sparsification_error(left, best))
        curve = {"removed": (np.arange(steps) / steps).tolist(), "rmse_px": left.tolist()}
        summary.add_curve(name, "sparsification", {**curve, "best_rmse_px": best.tolist()})


def _recall_positions(block: Block, chosen: IntArray) -> tuple[FloatArray, BoolArray] | None:
    """Return the equivalent positions of some rows, or None where the block has no partners.

    Returns:
        at_px: float64 (n, S + 1, 2), the true position and those of the partners.
        asked: bool (n, S + 1), positions that a mode should be near: none for a row without a
            visible partner.
    """
    partners = block.partners
    if partners is None or not len(partners.uv_px):
        return None
    count = (partners.begin[1:] - partners.begin[:-1])[chosen]
    width = int(count.max(initial=0))
    if not width:
        return None
    column = np.arange(width)
    exists: BoolArray = column < count[:, None]  # (n, S)
    index = np.where(exists, partners.begin[chosen, None] + column, 0)
    seen = exists & partners.visible[index]
    at = np.concatenate([block.true_px[chosen][:, None], partners.uv_px[index]], axis=1)
    return at, np.concatenate([seen.any(axis=1)[:, None], seen], axis=1)
