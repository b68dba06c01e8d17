"""Compares reports: paired differences with intervals, verdicts and ranks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

import numpy as np
import pyarrow as pa

from pliant.evaluator.metrics.base import OVERALL
from pliant.evaluator.protocols.protocol import ratios_of
from pliant.evaluator.scores import Scores
from pliant.evaluator.statistics.crossing import Crossing
from pliant.evaluator.statistics.ratios import Ratio
from pliant.evaluator.statistics.sign_flips import (
    PairedDifference,
    fewest_sequences,
    paired_difference,
)
from pliant.spec.arrays import FloatArray
from pliant.spec.errors import CallError

Verdict = Literal["better", "worse", "no clear difference", "too few sequences"]

_SAME: Final = (
    (("protocol",), "protocol"),
    (("protocol_sha256",), "protocol file"),
    (("dataset", "id"), "dataset"),
    (("dataset", "version"), "dataset version"),
    (("split",), "split"),
    (("hide_truth",), "error cap"),
    (("dataset", "queries_sha256"), "queries"),
    (("dataset", "truth_sha256"), "truth"),
)


@dataclass(frozen=True)
class Difference:
    """One method against another by one metric.

    Attributes:
        group: `overall` or a tier.
        metric: Name of the metric.
        method: The method judged.
        against: The method it is compared with.
        value: Its score minus the other's.
        low: Lower end of the interval of the difference, NaN where there is none.
        high: Upper end.
        sequences: Number of sequences that define the metric.
        sequences_needed: Number of sequences that would separate methods so far apart, see
            `PairedDifference`; None where the methods do not differ.
        verdict: `better` or `worse` exactly where the interval excludes zero.
    """

    group: str
    metric: str
    method: str
    against: str
    value: float
    low: float
    high: float
    sequences: int
    sequences_needed: int | None
    verdict: Verdict

    def as_dict(self) -> dict[str, Any]:
        """Return the difference as a JSON object; no interval is null."""
        return {
            key: None if isinstance(value, float) and not np.isfinite(value) else value
            for key, value in asdict(self).items()
        }


def check_comparable(reports: Sequence[Scores]) -> None:
    """Refuse reports of different protocols, datasets, splits or queries.

    Raises:
        CallError: Two reports differ in one of these; it says in which.
    """
    if not reports:
        raise CallError("there is no report to compare", required="at least one report folder")
    first = reports[0].document
    for other in reports[1:]:
        for keys, words in _SAME:
            a, b = _get(first, keys), _get(other.document, keys)
            if a != b:
                raise CallError(
                    f"reports of different {words}s cannot be compared"
                    if not words.endswith(("queries", "truth"))
                    else f"reports scored with other {words} cannot be compared",
                    found=f"{reports[0].method}: {a}; {other.method}: {b}",
                    fix="Evaluate both submissions by one protocol on one dataset.",
                )


def method_names(reports: Sequence[Scores]) -> list[str]:
    """Return the methods' names, distinguished by their files, and numbers, where equal."""
    names = [report.method for report in reports]
    result: list[str] = []
    for report, name in zip(reports, names, strict=True):
        if names.count(name) > 1:
            submission = report.document["submission"]
            name = f"{name} ({submission['file']}, {submission['sha256'][:8]})"
        copies = (f"{name}, {number}" for number in itertools.count(2))
        result.append(name if name not in result else next(n for n in copies if n not in result))
    return result


def differences(
    reports: Sequence[Scores], metrics: Sequence[str] | None = None
) -> list[Difference]:
    """Return the difference of every report from every earlier one.

    Both methods are compared pair by pair, so what makes a sequence hard for both cancels out.

    Args:
        reports: Comparable reports.
        metrics: Names of averaged metrics; None takes those of the headline, or all where the
            headline has none.

    Raises:
        CallError: The reports are not comparable, or a metric is not an averaged one.
    """
    check_comparable(reports)
    document = reports[0].document
    known = ratios_of(document)
    wanted = (
        [m for m in document["headline"] if m in known] or list(known)
        if metrics is None
        else [*dict.fromkeys(metrics)]
    )
    for name in wanted:
        if name not in known:
            raise CallError(
                "only averaged metrics can be compared with intervals",
                found=name,
                required=", ".join(known),
            )
    ratios = [known[name] for name in wanted]
    names = method_names(reports)
    columns = [_columns(report.per_pair) for report in reports]
    crossing, tiers = _crossing(reports[0].per_pair)
    level = float(document["intervals"]["level"])
    result: list[Difference] = []
    for ratio in ratios:
        terms = [ratio.terms(table) for table in columns]
        sums = [(crossing.sum(above), crossing.sum(below)) for above, below in terms]
        for position, group in enumerate([OVERALL, *tiers]):
            mine = crossing.of_group(position)
            parts = [(above * mine, below * mine) for above, below in sums]
            for b in range(1, len(parts)):
                for a in range(b):
                    paired = paired_difference(ratio, parts[a], parts[b], crossing, level)
                    if np.isfinite(paired.value):
                        verdict = _verdict(ratio, paired, level)
                        result.append(
                            Difference(
                                group, ratio.name, names[b], names[a], **vars(paired),
                                verdict=verdict,
                            )
                        )  # fmt: skip
    return result


def _verdict(ratio: Ratio, paired: PairedDifference, level: float) -> Verdict:
    if paired.sequences < fewest_sequences(level):
        return "too few sequences"
    if ratio.better == "neither" or paired.low <= 0 <= paired.high:
        return "no clear difference"
    return "better" if (paired.high < 0) == (ratio.better == "lower") else "worse"


def ranks(
    found: Sequence[Difference], names: Sequence[str]
) -> dict[tuple[str, str], list[int | None]]:
    """Return ranks that the verdicts support.

    A method's rank is one more than the number of methods clearly better than it, so methods
    that are not clearly different may share one. A method that has no value has no rank.

    Args:
        found: From `differences`.
        names: The methods in the order of the result.

    Returns:
        (group, metric) -> the rank of each method, or None.
    """
    result: dict[tuple[str, str], list[int | None]] = {}
    for item in found:
        standing = result.setdefault((item.group, item.metric), [None] * len(names))
        for name, behind in ((item.method, "worse"), (item.against, "better")):
            index = names.index(name)
            standing[index] = (standing[index] or 1) + (item.verdict == behind)
    return result


def _get(document: Any, keys: tuple[str, ...]) -> Any:
    for key in keys:
        document = document.get(key)
    return document


def _columns(table: pa.Table) -> dict[str, FloatArray]:
    columns = {
        name: table[name].to_numpy()
        for name in table.column_names
        if pa.types.is_float64(table.schema.field(name).type)
    }
    return {**columns, "one": np.ones(table.num_rows)}


def _crossing(table: pa.Table) -> tuple[Crossing, list[str]]:
    """Return the sequences of the pairs, and the names of the tiers in file order."""
    a, b, tier = (table[name].to_pylist() for name in ("sequence_a", "sequence_b", "tier"))
    sequences = {name: code for code, name in enumerate(dict.fromkeys([*a, *b]))}
    tiers = {name: code for code, name in enumerate(dict.fromkeys(tier))}
    codes = [
        np.array([known[name] for name in names])
        for known, names in ((sequences, a), (sequences, b), (tiers, tier))
    ]
    return Crossing.of(codes[0], codes[1], codes[2], len(tiers)), list(tiers)
