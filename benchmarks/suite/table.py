"""The table of a benchmark: what each method scored and cost, next to the paper's figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from pliant.baselines.conditions import Masks
from pliant.benchmarks.suite.config import (
    PAPER_LOSSES,
    TRACKS,
    BenchmarkConfig,
    Entry,
    PlannedAnswers,
    Test,
)
from pliant.benchmarks.suite.work import Cost, Workspace
from pliant.evaluator.scores import read_scores

CLASSICAL = ("sift", "surf", "orb")
_LABELS: Final = {
    "lk-chain": "LK chain",
    "dis-chain": "DIS chain",
    "surf": "SURF (mahotas)",
    "cloth-tps": "Outline, thin plate",
}
_STORED: Final = (
    "test", "variant", "set", "method", "label", "paper_rmse_px", "scores", "predict_cpu_s",
    "pairs",
)  # fmt: skip
"""What `table.json` has of a row as it is."""
_NO_SCORES: Final[dict[str, Any]] = {"values": {}, "intervals": {}}


@dataclass(frozen=True)
class Row:
    """One method in one track, on one variant of one tier.

    Attributes:
        test: Key of the test.
        variant: `clean`, `noisy` …
        set: The set that was asked.
        entry: The method and its track.
        label: What the table calls it.
        learned: Whether it was trained, here or before it was shipped.
        paper_rmse_px: The paper's figure, or None.
        scores: Protocol -> {"values": metric -> value, "intervals": metric -> [low, high]}.
        train: What training here took; None where there is none.
        predict_cpu_s: CPU seconds of answering.
        pairs: Pairs answered.
        arm: What its runs with other random seeds have in common with it; otherwise the method.
        seeds: How many of them it is the mean of.
    """

    test: str
    variant: str
    set: str
    entry: Entry
    label: str
    learned: bool
    paper_rmse_px: float | None
    scores: dict[str, Any]
    train: Cost | None
    predict_cpu_s: float
    pairs: int
    arm: str
    seeds: int = 1

    @property
    def method(self) -> str:
        """The method's name, or the training's."""
        return self.entry.method

    @property
    def place(self) -> tuple[str, str, Masks]:
        """Test, variant and track: the block of the table that it is in."""
        return self.test, self.variant, self.entry.track

    def value(self, protocol: str, metric: str) -> float | None:
        """Return a score, None where the method has none."""
        found: float | None = self.scores.get(protocol, _NO_SCORES)["values"].get(metric)
        return found

    def interval(self, protocol: str, metric: str) -> tuple[float, float] | None:
        """Return the 95 % interval of a score, None where it has none."""
        found = self.scores.get(protocol, _NO_SCORES)["intervals"].get(metric)
        return None if found is None else (float(found[0]), float(found[1]))


def finished_rows(config: BenchmarkConfig, work: Workspace) -> list[Row]:
    """Return the rows of everything that has been answered and scored, in the config's order."""
    return [
        _row(config, work, each, note["facts"])
        for each in config.answers
        if (note := work.finished(each.stage)) is not None
    ]


def _row(
    config: BenchmarkConfig, work: Workspace, asked: PlannedAnswers, facts: dict[str, Any]
) -> Row:
    key, test, variant, set_name, entry = asked
    scores = {}
    for protocol in test.protocols:
        folder = work.scores_path(set_name, entry.stored, protocol)
        if not folder.exists():  # protocol `matches` of a method without keypoints
            continue
        found = read_scores(folder).document
        scores[protocol] = {"values": found["overall"], "intervals": found["intervals"]["overall"]}
        if len(found["tiers"]) > 1:
            intervals = found["intervals"]["tiers"].get(test.tier, {})
            scores[protocol] = {"values": found["tiers"][test.tier], "intervals": intervals}
    method = entry.method
    trained = method in config.runs
    arm = (config.runs[method].arm if trained else "") or method
    first = variant == next(iter(test.variants)) and not entry.is_blank
    return Row(
        key,
        variant,
        set_name,
        entry,
        _label(config, test, entry),
        (trained and config.runs[method].learned) or method in test.shipped,
        test.paper_rmse_px.get(paper_name(arm)) if first else None,
        scores,
        work.cost(f"run/{method}") if trained else None,
        float(facts["predict_cpu_s"]),
        int(facts["pairs"]),
        arm,
    )


def paper_name(arm: str) -> str:
    """Return what the paper calls an arm: `contrastive` for `rope-contrastive`."""
    return next((name for name in PAPER_LOSSES if arm.endswith(f"-{name}")), arm)


def _label(config: BenchmarkConfig, test: Test, entry: Entry) -> str:
    method = entry.method
    blank = ", blank picture" if entry.is_blank else ""
    if method in config.runs:
        return config.runs[method].label + blank
    if method in test.shipped:
        options = ", ".join(f"{name}={value}" for name, value in test.answer.items())
        return f"{method}, {options or 'as shipped'}{blank}"
    name = method.replace("-", " ").capitalize()
    return _LABELS.get(method, method.upper() if method in CLASSICAL else name)


def blocks(config: BenchmarkConfig, rows: Sequence[Row]) -> list[list[Row]]:
    """Return the blocks of the table: track by track, in each the tests in the config's order.

    A block has the rows of one place; arms with several seeds are there as their means.
    """
    seen: dict[tuple[str, str, Masks], list[Row]] = {}
    for row in arms(rows):
        seen.setdefault(row.place, []).append(row)
    return [
        members
        for track in TRACKS
        for key, test in config.tests.items()
        for variant in test.variants
        if (members := seen.get((key, variant, track)))
    ]


def arms(rows: Sequence[Row]) -> list[Row]:
    """Return one row for each arm of a block: figures are means over its random seeds.

    Where there are several seeds, the interval of a figure is its lowest and its highest value.
    """
    grouped: dict[tuple[str, str, Entry], list[Row]] = {}
    for row in rows:
        place = row.test, row.variant, replace(row.entry, method=row.arm)
        grouped.setdefault(place, []).append(row)
    return [_mean(members) if len(members) > 1 else members[0] for members in grouped.values()]


def _mean(rows: Sequence[Row]) -> Row:
    scores: dict[str, Any] = {}
    for protocol, first in rows[0].scores.items():
        scores[protocol] = {"values": dict.fromkeys(first["values"]), "intervals": {}}
        for metric in first["values"]:
            found = [row.value(protocol, metric) for row in rows]
            known = [value for value in found if value is not None]
            if len(known) == len(rows):
                scores[protocol]["values"][metric] = sum(known) / len(known)
                scores[protocol]["intervals"][metric] = (min(known), max(known))
    trained = sum((row.train for row in rows if row.train is not None), Cost())
    return replace(
        rows[0],
        label=f"{rows[0].label} ({len(rows)} seeds)",
        scores=scores,
        train=Cost(trained.wall_s / len(rows), trained.cpu_s / len(rows)),
        predict_cpu_s=sum(row.predict_cpu_s for row in rows) / len(rows),
        seeds=len(rows),
    )


def best(rows: Sequence[Row], protocol: str, metric: str, *, learned: bool) -> Row | None:
    """Return the row with the lowest error, learned or not, None where there is none.

    Controls count among what is not learned: what they reach needs no looking at pictures. Blank
    controls and the oracle count nowhere.
    """
    known = [
        (value, row)
        for row in rows
        if row.learned == learned
        and not row.entry.is_blank
        and row.method != "oracle"
        and (value := row.value(protocol, metric)) is not None
    ]
    return min(known, key=lambda each: each[0])[1] if known else None


def table_document(config: BenchmarkConfig, work: Workspace, rows: list[Row]) -> dict[str, Any]:
    """Return the table as JSON values: every row, and what each stage cost."""
    noted = ("wall_s", "cpu_s", "machine", "cores", "finished")
    stages = {stage: {name: note[name] for name in noted} for stage, note in work.notes().items()}
    documents = [
        {name: getattr(row, name) for name in _STORED}
        | {"track": row.entry.track, "blank": row.entry.is_blank}
        | {f"train_{name}": getattr(row.train, name, None) for name in ("wall_s", "cpu_s")}
        for row in rows
    ]
    return {"name": config.name, "version": config.version, "rows": documents, "stages": stages}
