"""Answers to points that have an equal partner elsewhere: the two ends of a rope without its ball.

No picture distinguishes such a point from its partner, so an error in pixels says little: a matcher
that finds both and chooses one at random has a large RMSE. These figures use the discs around the
point and its visible partners, of queries whose discs do not overlap.
"""

from __future__ import annotations

import itertools

import numpy as np

from pliant.evaluator.metrics import mixtures
from pliant.evaluator.metrics.base import Groups, Metric, Positive, Summary
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.distribution import answered_mixtures, equivalent_positions
from pliant.evaluator.metrics.errors import endpoint_error_px
from pliant.spec.arrays import BoolArray, FloatArray, IntArray
from pliant.spec.configuration import Settings


class OrbitSettings(Settings):
    """Settings of `orbit`.

    Attributes:
        radius_px: Radius of the discs around a point and its partners.
        sigma_floor_px: Smaller standard deviations are raised to this.
    """

    radius_px: Positive
    sigma_floor_px: Positive


class Orbit(Metric[OrbitSettings]):
    """How often answers are at a partner, and how much probability is at each."""

    Settings = OrbitSettings
    truth_columns = ("alternatives",)

    def update(self, block: Block) -> None:
        """Take in one block."""
        if block.partners is None or not len(block.partners.uv_px):
            return
        chosen = np.flatnonzero(block.counted & block.partners.any_visible)
        positions = equivalent_positions(block, chosen)
        if positions is None:
            return
        at_px, exists = positions
        asked = np.flatnonzero(self._apart(at_px, exists))
        self._add(block, chosen[asked], at_px.take(asked, axis=0), exists.take(asked, axis=0))

    def _apart(self, at_px: FloatArray, exists: BoolArray) -> BoolArray:
        """Return which points have discs that do not overlap, bool (n,)."""
        apart = np.ones(len(at_px), bool)
        for one, other in itertools.combinations(range(at_px.shape[1]), 2):
            gap = endpoint_error_px(at_px[:, one], at_px[:, other])
            apart &= (gap > 2 * self.settings.radius_px) | ~(exists[:, one] & exists[:, other])
        return apart

    def _add(self, block: Block, chosen: IntArray, at_px: FloatArray, exists: BoolArray) -> None:
        """Take in some rows of a block; a missing answer is a flip without probability."""
        answers, radius = self.context.answers, self.settings.radius_px
        lost, answer_px = block.lost[chosen], block.answer_px.take(chosen, axis=0)
        own, *others = (
            np.where(seen & ~lost, endpoint_error_px(answer_px, place_px), np.inf)
            for seen, place_px in zip(exists.T, at_px.swapaxes(0, 1), strict=True)
        )
        nearest = np.minimum.reduce(others)
        hit = np.minimum(own, nearest) <= radius
        flips = (hit & (nearest < own)) | lost
        counts = {"points": None, "hits": hit, "decided": hit | lost, "flips": flips}
        if answers.has_distribution:
            counts["distributions"] = None
        pair, pairs = block.pair.take(chosen), len(block.starts) - 1
        for name, wanted in counts.items():
            self.table.put(f"orbit_{name}", block.pairs, np.bincount(pair, wanted, pairs))
        if not answers.has_distribution:
            return
        kept = np.flatnonzero(~lost)
        found = answered_mixtures(answers, block, chosen[kept], self.settings.sigma_floor_px)
        mass = np.stack(
            [
                mixtures.probability_within(found, at_px[kept, slot], radius)
                for slot in range(at_px.shape[1])
            ],
            axis=1,
        )  # (k, S + 1)
        seen = exists[kept]
        partners = np.where(seen, mass, 0)[:, 1:].sum(axis=1) / seen[:, 1:].sum(axis=1)
        least = np.where(seen, mass, 1).min(axis=1)
        masses = {"own_mass": mass[:, 0], "partner_mass": partners, "least_mass": least}
        for name, values in masses.items():
            rows = np.zeros(len(block.state))
            rows[chosen[kept]] = values
            self.add_sums(block, **{f"orbit_{name}": rows})

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Say why there are no masses."""
        del groups
        if not self.context.answers.has_distribution:
            at = f"{self.settings.radius_px:g}px"
            summary.notes[f"mass_{at}"] = "the submission has neither `sigma` nor `modes`"
