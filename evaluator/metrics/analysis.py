"""The paper's own analysis: histograms of errors and of each pair's RMSE, and the CDF.

The paper draws, per tier, distances divided by the image diagonal and L2 distances in pixels.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import numpy as np

from pliant.evaluator.metrics.base import Groups, Metric, Positive, ScoringContext, Summary
from pliant.evaluator.metrics.blocks import Block
from pliant.spec.arrays import FloatArray
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds

_CDF_PX: Final = (0.5, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)

_L2_STEP_PX: Final = 4.0
_L2_BINS: Final = 32


class AnalysisSettings(Settings):
    """Settings of `analysis`.

    Attributes:
        bin_px: Width of the bins that errors are counted in.
        normalise_by: What errors are divided by in the normalised histograms.
        bins: Number of bins of the normalised histograms.
    """

    bin_px: Positive
    normalise_by: Literal["image_diagonal"]
    bins: Annotated[int, Bounds(2)]


class Analysis(Metric[AnalysisSettings]):
    """Histograms of errors, counted in narrow bins while the blocks pass."""

    Settings = AnalysisSettings

    def __init__(self, settings: AnalysisSettings, context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._bin_px = settings.bin_px
        self._fine = int(np.ceil(context.queries.diagonal_px / self._bin_px))
        # The last bin takes everything beyond the diagonal.
        self._counts = np.zeros((len(context.queries.tiers), self._fine + 1))

    def update(self, block: Block) -> None:
        """Take in one block."""
        scaled = np.minimum(block.counted_error_px / self._bin_px, self._fine)
        width = self._fine + 1
        tier = self.context.queries.tier[block.pairs]
        key = tier[block.counted_pair] * width + scaled.astype(np.int64)
        self._counts += np.bincount(key, minlength=self._counts.size).reshape(self._counts.shape)

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add histograms, the CDF and the boxes."""
        diagonal = self.context.queries.diagonal_px
        bins = self.settings.bins
        columns = self.table.columns
        counted = columns["counted"]
        pair_rmse = np.sqrt(columns["sum_squared_px2"] / np.maximum(counted, 1))
        for index, name in groups:
            fine = self._counts.sum(axis=0) if index == 0 else self._counts[index - 1]
            total = fine.sum()
            if not total:
                continue
            held = np.concatenate([[0.0], np.cumsum(fine)]) / total
            edges_px = [x for x in _CDF_PX if x < diagonal]
            at = (np.array(edges_px) / self._bin_px).round().astype(int)
            cdf = {"error_px": edges_px, "share_below": held[at].tolist()}
            summary.add_curve(name, "cdf", cdf)
            summary.add_curve(name, "error_px", self._l2(fine))
            edges = np.linspace(0, 1, bins + 1)
            summary.add_curve(
                name,
                "normalised_error",
                {"edges": edges.tolist(), "share": self._coarse(fine, bins).tolist()},
            )
            rmse = pair_rmse[groups.masks[index] & (counted > 0)]
            share = np.histogram(np.minimum(rmse / diagonal, 1), edges)[0] / len(rmse)
            summary.add_curve(
                name, "normalised_pair_rmse", {"edges": edges.tolist(), "share": share.tolist()}
            )
            levels = (0.05, 0.25, 0.5, 0.75, 0.95)
            box = {f"p{level * 100:g}": float(np.quantile(rmse, level)) for level in levels}
            summary.add_curve(name, "pair_rmse_box_px", box)

    def _l2(self, fine: FloatArray) -> dict[str, Any]:
        """Return the histogram of errors in steps of 4 px up to 128 px, and the share beyond."""
        step = round(_L2_STEP_PX / self._bin_px)
        count = min(_L2_BINS, (len(fine) - 1) // step)
        share = fine[: count * step].reshape(count, step).sum(axis=1) / fine.sum()
        return {
            "edges_px": [index * _L2_STEP_PX for index in range(count + 1)],
            "share": share.tolist(),
            "share_beyond": float(max(0.0, 1 - share.sum())),
        }

    def _coarse(self, fine: FloatArray, bins: int) -> FloatArray:
        """Return the shares in `bins` equal bins up to the diagonal; the rest joins the last."""
        middle = (np.arange(len(fine)) + 0.5) * self._bin_px
        index = np.minimum(middle / self.context.queries.diagonal_px * bins, bins - 1)
        return np.bincount(index.astype(np.int64), fine, bins) / fine.sum()
