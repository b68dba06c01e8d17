"""What the attacks on published queries work with: the public queries and the private answers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet_columns import stacked

Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Queries:
    """The public queries of one tier.

    Attributes:
        pair: int64 (N,), pair of each row, ascending.
        source: int64 (N,), number of the source frame.
        target: int64 (N,), number of the target frame.
        uv_px: float64 (N, 2), query pixels.
        shown: Frame -> float64 (M, 2), the query pixels of the largest pair with this source, in
            the order of the rows.
        single: Whether every sequence has one frame, so that frames are independent.
    """

    pair: Ints
    source: Ints
    target: Ints
    uv_px: FloatArray
    shown: dict[int, FloatArray]
    single: bool

    @property
    def rows(self) -> list[Ints]:
        """The rows of each pair."""
        return np.split(np.arange(len(self.pair)), np.flatnonzero(np.diff(self.pair)) + 1)

    def shown_to(self, rows: Ints) -> FloatArray:
        """Return the query pixels of a pair's target frame, float64 (M, 2), which may be none."""
        return self.shown.get(int(self.target[rows[0]]), np.zeros((0, 2)))


@dataclass(frozen=True)
class Answers:
    """The private answers of the same rows.

    Attributes:
        uv_px: float64 (N, 2).
        visible: bool (N,).
        point: int64 (N,), material points.
        places_px: Target frame -> float64 (P, 2), where every material point is.
        seen: Target frame -> bool (P,), visible surface points of the queried object.
    """

    uv_px: FloatArray
    visible: npt.NDArray[np.bool_]
    point: Ints
    places_px: dict[int, FloatArray]
    seen: dict[int, npt.NDArray[np.bool_]]


def read_queries(public: Path, split: str) -> dict[str, Queries]:
    """Read the public queries of a split, by tier; no other file of the public half is opened.

    Args:
        public: The public half.
        split: The split.
    """
    table = Dataset.open(public).queries(split)
    tiers = np.array(table["tier"].to_pylist())
    return {str(tier): _queries(table.filter(pa.array(tiers == tier))) for tier in np.unique(tiers)}


def _frames(table: pa.Table, side: str) -> list[tuple[str, int]]:
    names = table[f"sequence_{side}"].to_pylist()
    return list(zip(names, table[f"frame_{side}"].to_pylist(), strict=True))


def _queries(table: pa.Table) -> Queries:
    number = frame_numbers(table)
    pair = table["pair_id"].to_numpy().astype(np.int64)
    source = np.array([number[each] for each in _frames(table, "a")])
    target = np.array([number[each] for each in _frames(table, "b")])
    uv_px = stacked(table, "u_a", "v_a").astype(float)
    shown = {}
    for frame in np.unique(source):
        pairs, counts = np.unique(pair[source == frame], return_counts=True)
        shown[int(frame)] = uv_px[pair == pairs[counts.argmax()]]
    single = all(frame == 0 for _, frame in number)
    return Queries(pair, source, target, uv_px, shown, single)


def frame_numbers(table: pa.Table) -> dict[tuple[str, int], int]:
    """Return the number of each frame that a queries table names, by name and frame."""
    return {key: k for k, key in enumerate(sorted({*_frames(table, "a"), *_frames(table, "b")}))}


def read_answers(whole: Path, split: str, tier: str) -> Answers:
    """Read the answers of a tier's queries from the dataset that was published.

    Args:
        whole: The dataset with truth and correspondences.
        split: The split.
        tier: The tier.
    """
    dataset = Dataset.open(whole)
    mine = pa.array(np.array(dataset.queries(split)["tier"].to_pylist()) == tier)
    queries, truth = dataset.queries(split).filter(mine), dataset.truth(split).filter(mine)
    places, seen = {}, {}
    targets = set(_frames(queries, "b"))
    queried = dataset.tiers[tier].queried_object
    for key, number in frame_numbers(queries).items():
        if key not in targets:
            continue
        sequence = dataset.sequence(key[0])
        table, points = sequence.correspondences(key[1]), sequence.points()
        places[number] = stacked(table, "u_px", "v_px").astype(float)
        askable = (points["object"].to_numpy() == queried) & (
            np.array(points["kind"].to_pylist()) == "surface"
        )
        seen[number] = askable & (np.array(table["visibility"].to_pylist()) == "visible")
    return Answers(
        stacked(truth, "u_b", "v_b").astype(float),
        np.array(truth["visibility_b"].to_pylist()) == "visible",
        truth["point"].to_numpy().astype(np.int64),
        places,
        seen,
    )
