"""What can be browsed: the tiers, sequences and pairs of a dataset, and the methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pliant.spec.dataset import Dataset
from pliant.viewer.explorer.layers import ERROR_SCALE_PX
from pliant.viewer.explorer.live import LiveMethod
from pliant.viewer.explorer.recorded import RecordedQueries
from pliant.viewer.explorer.submissions import Method


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
