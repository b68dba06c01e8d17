"""Which changes of a dataset leave it a valid one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.parquet import read_table
from pliant.spec.io.parquet_columns import stacked
from pliant.spec.storage import layout

UNSEEN: Final = {
    "dataset.json": ("title", "description", "licence", "provenance"),
    "sequence.json": ("parameters", "noise", "tools", "files", "frame_info", "index"),
}
"""Fields of documents that are the publisher's word."""


def is_harmless(base: Path, changed: Path) -> bool:
    """Return whether a changed dataset still says what its base says.

    Args:
        base: The valid dataset.
        changed: A copy that was corrupted, and in which the validator found no fault.
    """
    try:
        before, after = Dataset.open(base), Dataset.open(changed)
        same = _same_document(before.info, after.info, "dataset.json")
        if not same or not _same_listing(base, changed):
            return False
        ids = sorted(sequence.id for sequence in before.sequences)
        if ids != sorted(sequence.id for sequence in after.sequences):
            return False
        same = all(_same_sequence(before.sequence(name), after.sequence(name)) for name in ids)
        if not same or before.splits_with_queries() != after.splits_with_queries():
            return False
        for split in before.splits_with_queries():
            if not before.queries(split).equals(after.queries(split)):
                return False
            # A publisher may leave the truth out; what is there must be the truth.
            if (changed / layout.truth_name(split)).exists() and not (
                before.truth(split).equals(after.truth(split))
            ):
                return False
        return True
    except SpecError:
        return False


def _same_document(before: dict[str, Any], after: dict[str, Any], name: str) -> bool:
    def told(document: dict[str, Any]) -> str:
        seen = {key: value for key, value in document.items() if key not in UNSEEN[name]}
        for tier in seen.get("tiers", []):
            for label in [tier, *tier["objects"], *tier["symmetries"]]:
                label.pop("name", None)
            tier.pop("variant", None)
            tier.pop("kind", None)
            for thing in tier["objects"]:
                for coordinate in thing["material"]:
                    # A wider range, another scale or name: the publisher's word.
                    coordinate.clear()
        return json.dumps(seen, sort_keys=True)

    return told(json.loads(json.dumps(before))) == told(json.loads(json.dumps(after)))


def _same_sequence(before: Any, after: Any) -> bool:
    if not _same_document(before.info, after.info, "sequence.json"):
        return False
    if not before.points().equals(after.points()):
        return False
    for frame in range(before.frames):
        old, new = before.correspondences(frame), after.correspondences(frame)
        for name in ("frame", "point", "visibility"):
            if not old.column(name).equals(new.column(name)):
                return False
        first = _projected(before, frame, old)
        # The new numbers through the new camera, and as they are written.
        for second in (_projected(after, frame, new), stacked(new, "u_px", "v_px", "depth_m")):
            gap = np.abs(first - second).max(axis=0)
            if gap[:2].max() > 0.03 or gap[2] > 5e-5:
                return False
        a, b = before.surface(frame), after.surface(frame)
        for name in ("depth_m", "m0", "m1", "object_id"):
            if not np.array_equal(getattr(a, name), getattr(b, name)):
                return False
        if after.rgb(frame).shape != before.rgb(frame).shape:
            return False
    return True


def _projected(sequence: Any, frame: int, rows: pa.Table) -> np.ndarray[Any, Any]:
    xyz = stacked(rows, "x_m", "y_m", "z_m")
    found: np.ndarray[Any, Any] = sequence.camera(frame).project(xyz.astype(np.float64))
    return found


def _same_listing(base: Path, changed: Path) -> bool:
    """Return whether sequences.parquet still says the same, in any order, `coverage` apart."""
    old, new = (
        read_table(root / layout.SEQUENCES_TABLE, "sequences")
        .drop_columns(["coverage"])
        .sort_by("id")
        for root in (base, changed)
    )
    return bool(old.equals(new))
