"""The truth of queries: its rows next to those of the queries, and what they must say."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.conventions import VISIBILITY_STATES
from pliant.spec.tables import TRUTH
from pliant.spec.validation.rules.tables import CheckedTable, numbers
from pliant.spec.validation.rules.tracks import Tracks

_MAX_ALTERNATIVES = 64  # as many as dataset.schema.json allows symmetries


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


class Aligned:
    """The truth's rows, handed out in the portions that the queries come in."""

    def __init__(self, truth: CheckedTable) -> None:
        self._problems = truth.problems
        self._batches = truth.batches(TRUTH.names)
        self._rest: pa.Table | None = None

    def take(self, count: int) -> dict[str, Any] | None:
        """Return the next rows as columns, or None if the file ends early."""
        parts, have = [], 0
        while have < count:
            if self._rest is None or self._rest.num_rows == 0:
                following = next(self._batches, None)
                if following is None:
                    return None
                self._rest = following[1]
            part = self._rest.slice(0, count - have)
            self._rest = self._rest.slice(part.num_rows)
            parts.append(part)
            have += part.num_rows
        rows = pa.concat_tables(parts)
        listed = sum(len(chunk.flatten()) for chunk in rows.column("alternatives").chunks)
        if listed > _MAX_ALTERNATIVES * count:
            self._problems.add(
                "VALUE_OUT_OF_RANGE",
                "alternatives",
                f"found {listed} in {count} rows; no tier has more than {_MAX_ALTERNATIVES}",
            )
            return None
        plain = {"tier", "visibility_b", "alternatives"}
        return {
            name: rows.column(name).to_pylist() if name in plain else numbers(rows, name)
            for name in TRUTH.names
        }
