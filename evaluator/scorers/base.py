"""What all scorers share: the pair table, the groups figures are given for, and the results."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from pliant.evaluator.arrays import BoolArray, FloatArray
from pliant.evaluator.scorers.surfaces import Surfaces
from pliant.evaluator.submission.answers import Answers
from pliant.evaluator.submission.blocks import Block
from pliant.evaluator.submission.queries import Queries
from pliant.evaluator.submission.scratch import Scratch
from pliant.spec.dataset import Dataset

OVERALL: Final = "overall"


class PairTable:
    """One row an image pair; columns appear when something is first put into them."""

    def __init__(self, pairs: int) -> None:
        self.pairs = pairs
        self.columns: dict[str, FloatArray] = {"one": np.ones(pairs)}

    def put(self, name: str, pairs: slice, values: npt.NDArray[Any]) -> None:
        """Set a column's values for consecutive pairs; untouched pairs hold 0."""
        if name not in self.columns:
            self.columns[name] = np.zeros(self.pairs)
        self.columns[name][pairs] = values

    def ensure(self, *names: str) -> None:
        """Make sure that columns exist, whether or not a block had anything for them."""
        for name in names:
            self.put(name, slice(0, 0), np.empty(0))


@dataclass(frozen=True)
class Groups:
    """The groups of pairs that figures are given for: the whole split, then each tier.

    Attributes:
        names: `overall` and the tiers.
        masks: bool (P,) for each.
        queries: The split's queries.
    """

    names: list[str]
    masks: list[BoolArray]
    queries: Queries

    @classmethod
    def of(cls, queries: Queries) -> Groups:
        """Return the groups of a split."""
        masks = [np.ones(queries.pairs, bool)]
        masks += [queries.tier == code for code in range(len(queries.tiers))]
        return cls([OVERALL, *queries.tiers], masks, queries)

    def rows(self, index: int, values: npt.NDArray[Any]) -> list[npt.NDArray[Any]]:
        """Return a group's parts of an array with a value for each query of the split."""
        edges = np.diff(self.masks[index].astype(np.int8), prepend=0, append=0)
        first, end = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        starts = self.queries.starts
        return [
            values[starts[a] : starts[b]] for a, b in zip(first.tolist(), end.tolist(), strict=True)
        ]

    def __iter__(self) -> Iterator[tuple[int, str]]:
        return iter(enumerate(self.names))


@dataclass
class Summary:
    """What the scorers found out.

    Attributes:
        values: Group -> metric -> value; None where it is not defined.
        curves: Group -> curve -> JSON-able lists.
        slices: Slice -> its JSON-able rows.
        notes: Metric or family -> why it has no value, or what was assumed.
    """

    values: dict[str, dict[str, float | None]] = field(default_factory=dict)
    curves: dict[str, dict[str, Any]] = field(default_factory=dict)
    slices: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    notes: dict[str, str] = field(default_factory=dict)

    def set(self, group: str, metric: str, value: float | None) -> None:
        """Set a metric; NaN becomes None."""
        fine = value is not None and np.isfinite(value)
        self.values.setdefault(group, {})[metric] = (
            float(value) if fine and value is not None else None
        )

    def add_curve(self, group: str, name: str, curve: Mapping[str, Any]) -> None:
        """Add a curve or histogram, as lists."""
        self.curves.setdefault(group, {})[name] = dict(curve)


@dataclass(frozen=True)
class ScoringContext:
    """What is scored, handed to every scorer.

    Attributes:
        dataset: The dataset.
        queries: The split's queries.
        answers: The answers in the order of the queries.
        table: The pair table, which scorers fill.
        scratch: Where long arrays live.
        surfaces: The surface images of the target frames.
    """

    dataset: Dataset
    queries: Queries
    answers: Answers
    table: PairTable
    scratch: Scratch
    surfaces: Surfaces


class Scorer:
    """Gathers one family of metrics.

    Args:
        settings: The family's settings in the protocol.
        context: What is scored.
    """

    truth_columns: ClassVar[tuple[str, ...]] = ()
    query_pixels: ClassVar[bool] = False

    def __init__(self, settings: Mapping[str, Any], context: ScoringContext) -> None:
        self.settings = settings
        self.context = context
        self.table = context.table

    def update(self, block: Block) -> None:
        """Take in one block; blocks come in order, each once."""
        raise NotImplementedError

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add what is no ratio of the pair table: quantiles, curves, slices, notes."""
