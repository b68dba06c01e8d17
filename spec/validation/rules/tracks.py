"""The tables of a sequence as the rules of queries and truth look things up in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pliant.spec.conventions import VISIBILITY_STATES
from pliant.spec.io.parquet import open_table, select_schema
from pliant.spec.io.parquet_columns import load_columns
from pliant.spec.storage import layout
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.sequences import SequenceResult
from pliant.spec.validation.rules.tables import codes_of, numbers


@dataclass(frozen=True)
class Tracks:
    """The tables of one sequence, by frame and point.

    Attributes:
        uv_px: float32 (F, P, 2).
        state: int8 (F, P), index into `VISIBILITY_STATES`.
        askable: bool (P,), surface points of the queried object.
        partners: int32 (P, S).
    """

    uv_px: npt.NDArray[np.float32]
    state: npt.NDArray[np.int8]
    askable: npt.NDArray[np.bool_]
    partners: npt.NDArray[np.int32]


def read_tracks(context: Context, known: SequenceResult) -> Tracks | None:
    """Return a sequence's tables, None if they are not sound enough to compare with."""
    if not known.tables_sound:
        return None
    folder = layout.sequence_name(known.tier, known.id)
    path = context.files.get(f"{folder}/{layout.POINTS_TABLE}")
    points = load_columns(open_table(path), path, select_schema("points"))
    count = points.num_rows
    partners = points.column("partners").combine_chunks()
    queried = context.tiers[known.tier].queried_object
    askable = (numbers(points, "object") == queried) & (codes_of(points, "kind", ("surface",)) == 0)
    path = context.files.get(f"{folder}/{layout.CORRESPONDENCES_TABLE}")
    file = open_table(path)
    schema = select_schema("correspondences", ["u_px", "v_px", "visibility"])
    table = load_columns(file, path, schema)
    uv = np.stack([numbers(table, "u_px"), numbers(table, "v_px")], axis=1)
    state = codes_of(table, "visibility", VISIBILITY_STATES).astype(np.int8)
    return Tracks(
        uv.reshape(known.frames, count, 2),
        state.reshape(known.frames, count),
        askable,
        partners.flatten().to_numpy().reshape(count, -1),
    )
