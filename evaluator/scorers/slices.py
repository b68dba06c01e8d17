"""The same errors, sliced: by shape, visibility, displacement, silhouette, coverage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa

from pliant.evaluator.arrays import BoolArray, FloatArray, IntArray
from pliant.evaluator.metrics.localisation import endpoint_error_px, sum_by_pair
from pliant.evaluator.scorers.base import Groups, Scorer, ScoringContext, Summary
from pliant.evaluator.submission.blocks import Block
from pliant.spec.conventions import VISIBILITY_STATES
from pliant.spec.io.parquet import read_table
from pliant.spec.storage import layout


class _Tally:
    """Count, error sums and hits in numbered bins."""

    def __init__(self, labels: Sequence[str]) -> None:
        self.labels = list(labels)
        self.sums = np.zeros((len(labels), 4))

    def add(self, index: IntArray, error_px: FloatArray, within: BoolArray | FloatArray) -> None:
        """Add queries, each to the bin `index`."""
        size = len(self.labels)
        self.sums[:, 0] += np.bincount(index, minlength=size)
        self.sums[:, 1] += np.bincount(index, error_px, size)
        self.sums[:, 2] += np.bincount(index, error_px**2, size)
        self.sums[:, 3] += np.bincount(index, within, size)

    def rows(self, within_px: float) -> list[dict[str, Any]]:
        """Return the bins that hold something."""
        result = []
        for label, (count, total, squared, within) in zip(self.labels, self.sums, strict=True):
            if count:
                result.append(
                    {
                        "slice": label,
                        "queries": int(count),
                        "rmse_px": float(np.sqrt(squared / count)),
                        "mean_px": float(total / count),
                        f"pck_{within_px:g}px": float(within / count),
                    }
                )
        return result


class SlicesScorer(Scorer):
    """Slices of the localisation error."""

    truth_columns: ClassVar[tuple[str, ...]] = ("point",)
    query_pixels: ClassVar[bool] = True

    def __init__(self, settings: Mapping[str, Any], context: ScoringContext) -> None:
        super().__init__(settings, context)
        self._state = _Tally(VISIBILITY_STATES)
        self._displacement = _Tally(_labels(settings["displacement_px"], "px"))
        self._silhouette = _Tally(_labels(settings["silhouette_px"], "px"))

    def update(self, block: Block) -> None:
        """Take in one block."""
        within = block.reach_px <= self.settings["within_px"]
        finite = np.isfinite(block.error_px)  # a hidden point may have no position
        self._state.add(block.state[finite], block.error_px[finite], within[finite])
        counted = block.counted
        error = block.error_px[counted]
        hit = within[counted]
        if block.uv_a_px is not None:
            moved = endpoint_error_px(block.true_px[counted], block.uv_a_px[counted])
            index = np.digitize(moved, self.settings["displacement_px"])
            self._displacement.add(index, error, hit)
        self.table.put(
            "within_slice", block.pairs, sum_by_pair(within & counted, block.starts[:-1])
        )
        facts = self.context.surfaces.facts(block, self.context.queries)
        known = facts.known & counted
        if known.any():
            index = np.digitize(facts.silhouette_px[known], self.settings["silhouette_px"])
            self._silhouette.add(index, block.error_px[known], within[known])

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add the slices; those of whole pairs come from the pair table."""
        within_px = self.settings["within_px"]
        tallies = {
            "visibility in the target": self._state,
            "displacement": self._displacement,
            "distance to the silhouette": self._silhouette,
        }
        for name, tally in tallies.items():
            rows = tally.rows(within_px)
            if rows:
                summary.slices[name] = rows
        queries = self.context.queries
        shapes, coverage = self._sequence_facts()
        shape = [
            f"{queries.tiers[tier]} {shapes[sequence]}" if shapes[sequence] else ""
            for tier, sequence in zip(queries.tier, queries.sequence_b, strict=True)
        ]
        self._pair_slice("shape", np.array(shape), summary)
        edges = self.settings["coverage"]
        labels = np.array([*_labels(edges, ""), ""])
        value = coverage[queries.sequence_b]
        index = np.where(np.isnan(value), len(labels) - 1, np.digitize(value, edges))
        self._pair_slice("coverage of the cloth", labels[index], summary)

    def _sequence_facts(self) -> tuple[list[str], FloatArray]:
        """Return the shape and coverage of each sequence of the queries."""
        dataset, queries = self.context.dataset, self.context.queries
        shapes = [dataset.sequence(name).shape or "" for name in queries.sequences]
        path = dataset.local(layout.SEQUENCES_TABLE)
        table: pa.Table = read_table(path, "sequences", ["id", "coverage"])
        known = dict(zip(*(table[name].to_pylist() for name in ("id", "coverage")), strict=True))
        coverage = [known.get(name) for name in queries.sequences]
        return shapes, np.array([np.nan if c is None else c for c in coverage], np.float64)

    def _pair_slice(self, name: str, label: np.ndarray, summary: Summary) -> None:  # type: ignore[type-arg]
        columns = self.table.columns
        rows = []
        for text in sorted(set(label.tolist()) - {""}):
            chosen = label == text
            count, total, squared, within = (
                float(columns[c][chosen].sum())
                for c in ("counted", "sum_error_px", "sum_squared_px2", "within_slice")
            )
            if count:
                rows.append(
                    {
                        "slice": text,
                        "queries": int(count),
                        "rmse_px": float(np.sqrt(squared / count)),
                        "mean_px": total / count,
                        f"pck_{self.settings['within_px']:g}px": within / count,
                    }
                )
        if rows:
            summary.slices[name] = rows


def _labels(edges: Sequence[float], unit: str) -> list[str]:
    words = [f"{edge:g}" for edge in edges]
    inner = [f"{low} to {high} {unit}" for low, high in pairwise(words)]
    result = [f"below {words[0]} {unit}", *inner, f"{words[-1]} {unit} and more"]
    return [" ".join(label.split()) for label in result]
