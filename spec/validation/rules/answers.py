"""The truth of queries: its rows next to those of the queries, and what the tables say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.conventions import VISIBILITY_STATES
from pliant.spec.io.parquet import read_table
from pliant.spec.io.parquet_columns import codes, stacked
from pliant.spec.storage import layout
from pliant.spec.tables import TRUTH
from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.result import SequenceResult
from pliant.spec.validation.rules.tables import numbers

_MAX_ALTERNATIVES = 64  # as many as dataset.schema.json allows symmetries


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

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(array.nbytes for array in vars(self).values())


def read_tracks(context: Context, known: SequenceResult) -> Tracks | None:
    """Return a sequence's tables, None if they are not sound enough to compare with."""
    if not known.tables_sound:
        return None
    folder = layout.sequence_name(known.tier, known.id)
    points = read_table(context.files.get(f"{folder}/{layout.POINTS_TABLE}"), "points")
    count = points.num_rows
    partners = points.column("partners").combine_chunks()
    queried = context.tiers[known.tier].queried_object
    surface = codes(points.column("kind"), ("surface",)) == 0
    askable = surface & (numbers(points, "object") == queried)
    path = context.files.get(f"{folder}/{layout.CORRESPONDENCES_TABLE}")
    table = read_table(path, "correspondences", ["u_px", "v_px", "visibility"])
    state = codes(table.column("visibility"), VISIBILITY_STATES).astype(np.int8)
    return Tracks(
        stacked(table, "u_px", "v_px").reshape(known.frames, count, 2),
        state.reshape(known.frames, count),
        askable,
        partners.flatten().to_numpy().reshape(count, -1),
    )


def compare_answers(
    tracks: Tracks,
    frame: int,
    answers: dict[str, Any],
    point: npt.NDArray[np.int64],
    problems: list[list[str]],
) -> None:
    """Compare answers with the target's table; float32 values must be equal."""
    for index, asked in enumerate(point):
        if asked < 0:
            continue
        if answers["point"][index] != asked:
            problems[index].append(
                f"point is {answers['point'][index]}; the query is on point {asked}"
            )
            continue
        found = (answers["u_b"][index], answers["v_b"][index])
        if not np.array_equal(tracks.uv_px[frame, asked], found):
            problems[index].append(
                f"u_b, v_b are {found[0]}, {found[1]}; the correspondences have "
                f"{tracks.uv_px[frame, asked].tolist()}"
            )
        state = VISIBILITY_STATES[tracks.state[frame, asked]]
        if answers["visibility_b"][index] != state:
            problems[index].append(
                f"visibility_b is {answers['visibility_b'][index][:40]!r}; the "
                f"correspondences have {state}"
            )
        required = [
            (*tracks.uv_px[frame, partner].tolist(), VISIBILITY_STATES[state])
            for partner, state in (
                (partner, tracks.state[frame, partner]) for partner in tracks.partners[asked]
            )
        ]
        listed = [(a["u"], a["v"], a["visibility"]) for a in answers["alternatives"][index]]
        if listed != required:
            problems[index].append("alternatives are not where the point's partners are")


def has_few_alternatives(truth: pa.Table, problems: FileProblems) -> bool:
    """Return whether no row has more alternatives than a tier may have symmetries, on average."""
    listed = sum(len(chunk.flatten()) for chunk in truth.column("alternatives").chunks)
    if listed > _MAX_ALTERNATIVES * len(truth):
        problems.add(
            "VALUE_OUT_OF_RANGE",
            "alternatives",
            f"found {listed} in {len(truth)} rows; no tier has more than {_MAX_ALTERNATIVES}",
        )
        return False
    return True


def answer_columns(truth: pa.Table) -> dict[str, Any]:
    """Return the columns of some rows: numbers as arrays, all else as lists."""
    plain = {"tier", "visibility_b", "alternatives"}
    return {
        name: truth.column(name).to_pylist() if name in plain else numbers(truth, name)
        for name in TRUTH.names
    }
