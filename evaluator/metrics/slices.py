"""The same errors, sliced: by shape, visibility, displacement, silhouette, coverage."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.evaluator.metrics.base import (
    Groups,
    Metric,
    Positive,
    ScoringContext,
    Summary,
    listed_figures,
)
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.errors import endpoint_error_px
from pliant.evaluator.metrics.pck import threshold_level
from pliant.evaluator.statistics.ratios import Figure
from pliant.spec.arrays import BoolArray, FloatArray, IntArray, StateArray
from pliant.spec.configuration import Settings
from pliant.spec.conventions import VISIBILITY_STATES
from pliant.spec.io.parquet import read_table
from pliant.spec.storage import layout


class SlicesSettings(Settings):
    """Settings of `slices`.

    Attributes:
        displacement_px: Edges of the slices by the distance between query and true position.
        silhouette_px: Edges of the slices by the distance to the object's silhouette; none leaves
            out these slices, and the reading of surface images.
        coverage: Edges of the slices by the share of a cloth that is covered.
        within_px: Threshold of the share that is given for each slice.
        moving_px: A point moves if its true position is farther than this from the query; None
            gives no figures of moving points.
    """

    displacement_px: tuple[float, ...]
    silhouette_px: tuple[float, ...]
    coverage: tuple[float, ...]
    within_px: Positive
    moving_px: Positive | None = None


class _Tally:
    """Count, sum of errors, sum of squared errors and hits in labelled bins."""

    def __init__(self, labels: Sequence[str]) -> None:
        self.labels = labels
        self.sums = np.zeros((len(labels), 4))

    def add(self, index: IntArray | StateArray, error_px: FloatArray, within: BoolArray) -> None:
        """Add queries, each to the bin `index`."""
        bins = index.astype(np.intp, copy=False)
        hits = np.bincount(2 * bins + within, minlength=2 * len(self.labels)).reshape(-1, 2)
        self.sums[:, 0] += hits.sum(axis=1)
        for column, weights in ((1, error_px), (2, error_px**2)):
            self.sums[:, column] += np.bincount(bins, weights, len(self.labels))
        self.sums[:, 3] += hits[:, 1]

    def rows(self, within_px: float) -> list[dict[str, Any]]:
        """Return the bins that are not empty."""
        return [
            {
                "slice": label,
                "queries": int(count),
                "rmse_px": float(np.sqrt(squared / count)),
                "mean_px": float(total / count),
                f"pck_{within_px:g}px": float(within / count),
            }
            for label, (count, total, squared, within) in zip(self.labels, self.sums, strict=True)
            if count
        ]


class Slices(Metric[SlicesSettings]):
    """Slices of the localisation error."""

    Settings = SlicesSettings
    truth_columns = ("point",)
    query_pixels = True

    def __init__(self, settings: SlicesSettings, context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._state = _Tally(VISIBILITY_STATES)
        self._displacement = _Tally(_labels(settings.displacement_px, "px"))
        self._silhouette = _Tally(_labels(settings.silhouette_px, "px"))

    @classmethod
    def of_slice(cls, settings: SlicesSettings) -> list[Figure]:
        """Return what the figures of one slice are, whether the protocol reports them or not."""
        within = {"thresholds_px": (settings.within_px,), "thresholds_box": ()}
        errors = listed_figures("localisation", {"quantiles": ()})
        return [*errors, *listed_figures("pck", within)]

    def update(self, block: Block) -> None:
        """Take in one block."""
        within = block.reach_px <= self.settings.within_px
        finite = np.isfinite(block.error_px)  # a hidden point may have no position
        kept = slice(None) if finite.all() else finite
        self._state.add(block.state[kept], block.error_px[kept], within[kept])
        counted, rows = block.counted, block.counted_rows
        self.add_sums(block, within_slice=within & counted)
        self.table.put("slice_error_px", block.pairs, block.pair_error_px)
        self.table.put("slice_squared_px2", block.pairs, block.pair_squared_px2)
        if block.uv_a_px is not None:
            moved = endpoint_error_px(block.true_px, block.uv_a_px)
            index = threshold_level(moved.take(rows), self.settings.displacement_px, "<")
            self._displacement.add(index, block.counted_error_px, within.take(rows))
            if self.settings.moving_px is not None:
                moving = counted & (moved > self.settings.moving_px)
                squared = np.where(moving, block.squared_px2, 0.0)
                self.add_sums(block, moving_counted=moving, moving_within=within & moving)
                self.add_sums(block, moving_squared_px2=squared)
        if not self.settings.silhouette_px:
            return
        facts = self.context.surfaces.facts(block, self.context.queries)
        known = rows[facts.known[rows]]
        index = threshold_level(facts.silhouette_px[known], self.settings.silhouette_px, "<")
        self._silhouette.add(index, block.error_px[known], within[known])

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add the slices; those of whole pairs come from the pair table."""
        queries = self.context.queries
        shapes, coverage = self._sequence_facts()
        shape = [
            f"{queries.tiers[tier]} {shapes[sequence]}" if shapes[sequence] else ""
            for tier, sequence in zip(queries.tier, queries.sequence_b, strict=True)
        ]
        edges = self.settings.coverage
        labels = np.array([*_labels(edges, ""), ""])
        value = coverage[queries.sequence_b]
        index = np.where(np.isnan(value), len(labels) - 1, np.digitize(value, edges))
        tallies = {
            "visibility in the target": self._state,
            "displacement": self._displacement,
            "distance to the silhouette": self._silhouette,
            "shape": self._by_pair(np.array(shape)),
            "coverage of the cloth": self._by_pair(labels[index]),
        }
        for name, tally in tallies.items():
            rows = tally.rows(self.settings.within_px)
            if rows:
                summary.slices[name] = rows

    def _sequence_facts(self) -> tuple[list[str], FloatArray]:
        """Return the shape and coverage of each sequence of the queries."""
        dataset, queries = self.context.dataset, self.context.queries
        shapes = [dataset.sequence(name).shape or "" for name in queries.sequences]
        path = dataset.local(layout.SEQUENCES_TABLE)
        table: pa.Table = read_table(path, "sequences", ["id", "coverage"])
        known = dict(zip(*(table[name].to_pylist() for name in ("id", "coverage")), strict=True))
        coverage = [known.get(name) for name in queries.sequences]
        return shapes, np.array([np.nan if c is None else c for c in coverage], np.float64)

    def _by_pair(self, label: npt.NDArray[np.str_]) -> _Tally:
        """Return the tally of pairs by their label; pairs without one are left out."""
        names = ("counted", "slice_error_px", "slice_squared_px2", "within_slice")
        tally = _Tally([text for text in np.unique(label).tolist() if text])
        for row, text in enumerate(tally.labels):
            tally.sums[row] = [self.table.columns[name][label == text].sum() for name in names]
        return tally


def _labels(edges: Sequence[float], unit: str) -> list[str]:
    if not edges:
        return [""]
    words = [f"{edge:g}" for edge in edges]
    inner = [f"{low} to {high} {unit}" for low, high in pairwise(words)]
    result = [f"below {words[0]} {unit}", *inner, f"{words[-1]} {unit} and more"]
    return [" ".join(label.split()) for label in result]
