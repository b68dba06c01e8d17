"""Figures for answers that come with a distribution, `sigma` or `modes`."""

from __future__ import annotations

from typing import Annotated, Final

import numpy as np

from pliant.evaluator.metrics import calibration, mixtures
from pliant.evaluator.metrics.base import (
    Groups,
    Level,
    Levels,
    Metric,
    Positive,
    ScoringContext,
    Summary,
)
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.mixtures import Mixtures
from pliant.evaluator.submission.answers import PlacedAnswers
from pliant.spec.arrays import BoolArray, FloatArray, IntArray
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds

_MOST_SORTED: Final = 4_000_000
"""Sparsification sorts: of more answers than this, every k-th is taken, and a note says so."""
_CHUNK_ROWS: Final = 1 << 15


class DistributionSettings(Settings):
    """Settings of `distribution`.

    Attributes:
        sigma_floor_px: Smaller standard deviations are raised to this.
        outlier_weight: Weight of a uniform density over the image in the NLL.
        ece_radius_px: An answer within this distance of the truth is right.
        ece_bins: Number of bins of the calibration error.
        regions: Probabilities of the regions whose coverage is reported.
        sparsification_steps: Number of removed shares.
        recall_radius_px: A mode within this distance of a position recalls it.
        recall_min_weight: Modes of a smaller weight recall nothing.
    """

    sigma_floor_px: Positive
    outlier_weight: Level
    ece_radius_px: Positive
    ece_bins: Annotated[int, Bounds(1)]
    regions: Levels
    sparsification_steps: Annotated[int, Bounds(2)]
    recall_radius_px: Positive
    recall_min_weight: Annotated[float, Bounds(0, 1)]


class Distribution(Metric[DistributionSettings]):
    """NLL, calibration, regions, sparsification and mode recall."""

    Settings = DistributionSettings
    truth_columns: tuple[str, ...] = ("alternatives",)

    def __init__(self, settings: DistributionSettings, context: ScoringContext) -> None:
        super().__init__(settings, context)
        # One more bin than asked for: missing answers, certain and never within the radius.
        tiers = len(context.queries.tiers)
        self._reliability = np.zeros((tiers, settings.ece_bins + 1, 3))
        if not context.answers.has_distribution:
            self.truth_columns = ()
        else:
            self._spread, self._squared = np.full((2, context.queries.rows), np.nan)

    def update(self, block: Block) -> None:
        """Take in one block."""
        if not self.context.answers.has_distribution:
            return
        usable = block.counted
        lost = usable & block.lost
        names = [f"in_region_{level * 100:g}" for level in self.settings.regions]
        rows = {name: np.zeros(len(usable)) for name in ("sum_nll", "recalled", "recallable")}
        rows |= {name: np.zeros(len(usable)) for name in names}
        answered = np.flatnonzero(usable & ~lost)
        for first in range(0, len(answered), _CHUNK_ROWS):
            self._add(block, answered[first : first + _CHUNK_ROWS], rows, names)
        if lost.any():
            self._add_missing(block, np.flatnonzero(lost), rows)
        self.add_sums(block, distributions=usable, **rows)

    def _add(
        self, block: Block, chosen: IntArray, rows: dict[str, FloatArray], names: list[str]
    ) -> None:
        """Take in some answered rows of a block."""
        settings, queries = self.settings, self.context.queries
        at, true_px = block.first_row + chosen, block.true_px[chosen]
        found = answered_mixtures(self.context.answers, block, chosen, settings.sigma_floor_px)
        self._spread[at] = mixtures.spread_px(found)
        self._squared[at] = block.squared_px2[chosen]
        rows["sum_nll"][chosen] = mixtures.negative_log_likelihood(
            found, true_px, outlier_weight=settings.outlier_weight, area_px2=queries.area_px2
        )
        regions = mixtures.in_regions(found, true_px, settings.regions)
        for name, inside in zip(names, regions, strict=True):
            rows[name][chosen] = inside
        radius = settings.ece_radius_px
        centre = block.answer_px[chosen].astype(np.float64)
        confidence = mixtures.probability_within(found, centre, radius)
        happened = block.error_px[chosen] <= radius
        tier = queries.tier[block.first_pair + block.pair[chosen]]
        for code in np.unique(tier).tolist():
            self._reliability[code, :-1] += calibration.reliability_bins(
                confidence[tier == code], happened[tier == code], settings.ece_bins
            )
        positions = equivalent_positions(block, chosen)
        if positions is not None:
            at_px, asked = positions
            near = mixtures.modes_near(
                found, at_px, settings.recall_radius_px, settings.recall_min_weight
            )
            rows["recalled"][chosen] = (near & asked).sum(axis=1)
            rows["recallable"][chosen] = asked.sum(axis=1)

    def _add_missing(self, block: Block, lost: IntArray, rows: dict[str, FloatArray]) -> None:
        """Count missing answers as the worst: certain, and wrong by the image diagonal."""
        queries = self.context.queries
        rows["sum_nll"][lost] = np.log(queries.area_px2 / self.settings.outlier_weight)
        tier = queries.tier[block.first_pair + block.pair[lost]]
        missing = np.bincount(tier, minlength=len(self._reliability))
        self._reliability[:, -1, :2] += missing[:, None]
        self._spread[block.first_row + lost] = 0.0
        self._squared[block.first_row + lost] = block.squared_px2[lost]
        positions = equivalent_positions(block, lost)
        if positions is not None:
            rows["recallable"][lost] = positions[1].sum(axis=1)

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add what is pooled over answers."""
        if not self.context.answers.has_distribution:
            summary.notes["distribution"] = (
                "the submission has neither `sigma` nor `modes`: no figures of a distribution"
            )
            return
        for index, name in groups:
            table = self._reliability.sum(axis=0) if index == 0 else self._reliability[index - 1]
            summary.set(name, "ece", calibration.expected_calibration_error(table))
            used, confidence, frequency = calibration.reliability_curve(table[:-1])
            curve = {
                "radius_px": self.settings.ece_radius_px,
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
            np.concatenate([part[::every] for part in groups.parts(index, store)])
            for store in (self._spread, self._squared)
        )
        fine = np.isfinite(spread)
        spread, squared = spread[fine], squared[fine]
        if not len(spread):
            summary.set(name, "ause", None)
            return
        if every > 1:
            summary.notes["ause"] = f"taken over every {every}th answer of the largest groups"
        steps = self.settings.sparsification_steps
        left = calibration.sparsification(squared, spread, steps)
        answered = np.where(spread > 0, squared, 0.0)  # the best order has no missing answers
        best = calibration.sparsification(answered, answered, steps)
        summary.set(name, "ause", calibration.area_under_sparsification_error(left, best))
        curve = {"removed": (np.arange(steps) / steps).tolist(), "rmse_px": left.tolist()}
        summary.add_curve(name, "sparsification", {**curve, "best_rmse_px": best.tolist()})


def answered_mixtures(
    answers: PlacedAnswers, block: Block, chosen: IntArray, sigma_floor_px: float
) -> Mixtures:
    """Return the distributions of some rows of a block, their sigma floored.

    Args:
        answers: Answers with `sigma` or `modes`.
        block: A block of them.
        chosen: int64 (n,), rows of the block with an answer.
        sigma_floor_px: Smaller standard deviations are raised to this.
    """
    at = block.first_row + chosen
    if answers.sigma_px is not None:
        sigma = answers.sigma_px[at].astype(np.float64)
        own = block.answer_px[chosen].astype(np.float64)
        row = np.arange(len(chosen))
        return Mixtures(row, own, np.maximum(sigma, sigma_floor_px), np.ones(len(row)), len(row))
    count, modes = answers.modes_of(at)
    row = np.repeat(np.arange(len(chosen)), count)
    weight = modes[:, 3] / np.bincount(row, modes[:, 3], len(chosen))[row]
    sigma = np.maximum(modes[:, 2], sigma_floor_px)
    return Mixtures(row, modes[:, :2], sigma, weight, len(chosen))


def equivalent_positions(block: Block, chosen: IntArray) -> tuple[FloatArray, BoolArray] | None:
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
    seen = exists & partners.visible.take(index)
    at = np.empty((len(chosen), 1 + width, 2))
    at[:, 0], at[:, 1:] = block.true_px.take(chosen, axis=0), partners.uv_px.take(index, axis=0)
    return at, np.concatenate([seen.any(axis=1)[:, None], seen], axis=1)
