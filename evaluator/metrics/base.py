"""What all metrics share: the pair table, the groups of pairs, the results, and the base class."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import resources
from typing import Annotated, Any, ClassVar, Final, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.surfaces import Surfaces
from pliant.evaluator.statistics.ratios import Figure, Ratio
from pliant.evaluator.submission.answers import PlacedAnswers
from pliant.evaluator.submission.queries import Queries
from pliant.spec.arrays import BoolArray, FloatArray, IntArray
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds
from pliant.spec.dataset import Dataset

OVERALL: Final = "overall"
_FIGURES: Final[dict[str, list[dict[str, Any]]]] = json.loads(
    (resources.files("pliant.evaluator.metrics") / "figures.json").read_bytes()
)

Positive = Annotated[float, Bounds(0, above=True)]
Positives = Annotated[tuple[float, ...], Bounds(0, above=True)]
Level = Annotated[float, Bounds(0, 1, above=True, below=True)]
Levels = Annotated[tuple[float, ...], Bounds(0, 1, above=True, below=True)]


class PairTable:
    """One row per image pair; further columns appear when something is put into them.

    Args:
        pairs: Number of pairs.
        names: Columns that exist from the start.
    """

    def __init__(self, pairs: int, names: Iterable[str]) -> None:
        self.pairs = pairs
        self.columns: dict[str, FloatArray] = {name: np.zeros(pairs) for name in names}
        self.columns["one"] = np.ones(pairs)

    def put(self, name: str, pairs: slice, values: npt.NDArray[Any]) -> None:
        """Set a column's values for consecutive pairs; all others are 0."""
        if name not in self.columns:
            self.columns[name] = np.zeros(self.pairs)
        self.columns[name][pairs] = values


@dataclass(frozen=True)
class Groups:
    """The groups of pairs that figures are given for: the whole split, then each tier.

    Attributes:
        names: `overall` and the tiers.
        masks: bool (P,) for each.
        starts: int64 (P + 1,), first scored row of each pair, and the number of rows.
    """

    names: list[str]
    masks: list[BoolArray]
    starts: IntArray

    @classmethod
    def of(cls, queries: Queries, starts: IntArray) -> Groups:
        """Return the groups of a split."""
        masks = [np.ones(queries.pairs, bool)]
        masks += [queries.tier == code for code in range(len(queries.tiers))]
        return cls([OVERALL, *queries.tiers], masks, starts)

    def parts(
        self, index: int, values: npt.NDArray[Any], number: npt.NDArray[Any] | None = None
    ) -> list[npt.NDArray[Any]]:
        """Return a group's parts of an array of values, those of the first pair first.

        Args:
            index: The group.
            values: The array.
            number: (P,), the number of values of each pair; None for one for each scored row.
        """
        starts = self.starts if number is None else np.append(0, np.cumsum(number.astype(np.int64)))
        edges = np.diff(self.masks[index].astype(np.int8), prepend=0, append=0)
        first, end = starts[np.flatnonzero(edges == 1)], starts[np.flatnonzero(edges < 0)]
        return [values[a:b] for a, b in zip(first.tolist(), end.tolist(), strict=True)]

    def __iter__(self) -> Iterator[tuple[int, str]]:
        return iter(enumerate(self.names))


@dataclass
class Summary:
    """What the metrics found.

    Attributes:
        values: Group -> metric -> value; None where it is not defined.
        curves: Group -> curve -> JSON-able lists.
        slices: Slice -> its JSON-able rows.
        notes: Metric or family -> why it has no value, or what was assumed.
        causes: Group -> cause of errors -> its JSON-able figures.
    """

    values: dict[str, dict[str, float | None]] = field(default_factory=dict)
    curves: dict[str, dict[str, Any]] = field(default_factory=dict)
    slices: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    notes: dict[str, str] = field(default_factory=dict)
    causes: dict[str, dict[str, dict[str, Any]]] = field(default_factory=dict)

    def set(self, group: str, metric: str, value: float | None) -> None:
        """Set a metric; NaN becomes None."""
        defined = value is not None and np.isfinite(value)
        self.values.setdefault(group, {})[metric] = float(value or 0) if defined else None

    def add_curve(self, group: str, name: str, curve: Mapping[str, Any]) -> None:
        """Add a curve or histogram, as lists."""
        self.curves.setdefault(group, {})[name] = dict(curve)


@dataclass(frozen=True)
class ScoringContext:
    """What is scored, given to every metric.

    Attributes:
        dataset: The dataset.
        queries: The split's queries.
        answers: The scored rows: the answers in the order of the queries, or keypoint matches.
        table: The pair table, which metrics fill.
        surfaces: The surface images of the target frames.
    """

    dataset: Dataset
    queries: Queries
    answers: PlacedAnswers
    table: PairTable
    surfaces: Surfaces


class NoSettings(Settings):
    """A family without settings."""


S = TypeVar("S")


class Metric(Generic[S]):
    """One family of metrics: its settings, its figures, and how blocks of answers give them.

    A protocol names a family by its module in `evaluator/metrics/`: `pck` is the class `Pck` of
    `pck.py`. See CONTRIBUTING.md, "Add a metric".

    Args:
        settings: The family's settings in the protocol.
        context: What is scored.

    Attributes:
        Settings: Class of the settings.
        truth_columns: What `update` needs of `point`, `box_px` and `alternatives`.
        query_pixels: Whether `update` needs the query pixels.
        episodes: Whether its figures need pairs of two frames of one episode.
    """

    Settings: ClassVar[type[Any]] = NoSettings
    episodes: ClassVar[bool] = False
    truth_columns: tuple[str, ...] = ()
    query_pixels: bool = False

    def __init__(self, settings: S, context: ScoringContext) -> None:
        self.settings = settings
        self.context = context
        self.table = context.table

    @classmethod
    def figures(cls, settings: Any) -> list[Figure]:
        """Return what the family reports, in the order of a report: its rows of figures.json."""
        return listed_figures(cls.__name__.lower(), settings)

    def update(self, block: Block) -> None:
        """Take in one block; blocks come in order, each once."""
        raise NotImplementedError

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add what is not a ratio of the pair table: quantiles, curves, slices, notes."""

    def add_sums(self, block: Block, **rows: npt.NDArray[Any]) -> None:
        """Put the sum over each pair of the block into the pair table.

        Args:
            block: The block.
            **rows: Column -> float64 (N,), or bool (N,), which is counted.
        """
        for name, values in rows.items():
            self.table.put(name, block.pairs, block.sum_by_pair(values))


def listed_figures(family: str, settings: Any, **words: str) -> list[Figure]:
    """Return what a family of metrics reports, in the order of a report: its rows of figures.json.

    A row has the fields of a `Figure`, or of a `Ratio` where `over` names the two columns. Its
    texts are format strings of the family's settings. Rows under `each` are repeated for each
    value of a setting, which they have as `each`, and 100 times it as `percent`; a setting of None
    gives none.

    Args:
        family: The family; one that figures.json does not name reports nothing.
        settings: Its settings.
        **words: More words of its texts.
    """
    return list(_figures(_FIGURES.get(family, []), {**dict(settings), **words}))


def _figures(rows: list[dict[str, Any]], words: Mapping[str, Any]) -> Iterator[Figure]:
    for row in rows:
        if "each" in row:
            values = words[row["each"]]
            for value in values if isinstance(values, tuple) else (values,):
                if value is not None:
                    more = {"each": value, "percent": value * 100}
                    yield from _figures(row["figures"], {**words, **more})
            continue
        name, about, label = (
            row.get(key, "").format(**words) for key in ("name", "about", "label")
        )
        better, unit = row["better"], row.get("unit", "")
        if "over" not in row:
            yield Figure(name, better, unit, about, label)
            continue
        above, below = (column.format(**words) for column in row["over"])
        ratio = Ratio(name, better, unit, about, label, above, below, root=row.get("root", False))
        yield ratio
        if "mean_over_pairs" in row:
            yield ratio.mean_over_pairs(row["mean_over_pairs"].format(**words))
