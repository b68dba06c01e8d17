"""The table of a benchmark: what each method scored and cost, next to the paper's figures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from pliant.benchmarks.suite.config import BenchmarkConfig, Test
from pliant.benchmarks.suite.work import Cost, Workspace
from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.scores import read_scores

CLASSICAL = ("sift", "surf", "orb")
_LABELS: Final = {
    "lk-chain": "LK chain",
    "dis-chain": "DIS chain",
    "rlof-chain": "RLOF chain",
    "cloth-tps": "Outline, thin plate",
    "cloth-homography": "Outline, homography",
}
_NO_SCORES: Final[dict[str, Any]] = {"values": {}, "intervals": {}}


@dataclass(frozen=True)
class Row:
    """One method on one variant of one tier.

    Attributes:
        test: Key of the block.
        variant: `clean`, `noisy` …
        set: The set that was asked.
        method: A method's name, or a training's.
        label: What the table calls it.
        learned: Whether it was trained, here or before it was shipped.
        paper_rmse_px: The paper's figure, or None.
        scores: Protocol -> {"values": metric -> value, "intervals": metric -> [low, high]}.
        train: What training here took, what it started from included; None where there is none.
        predict_cpu_s: CPU seconds of answering.
        pairs: Pairs answered.
        arm: What its runs with other random seeds have in common with it; otherwise `method`.
        seeds: How many of them it is the mean of.
    """

    test: str
    variant: str
    set: str
    method: str
    label: str
    learned: bool
    paper_rmse_px: float | None
    scores: dict[str, Any]
    train: Cost | None
    predict_cpu_s: float
    pairs: int
    arm: str
    seeds: int = 1

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
    rows = []
    for key, test in config.tests.items():
        for variant, set_name in test.variants.items():
            for method in test.answering:
                note = work.finished(f"answer/{set_name}--{test.stored(method)}")
                if note is None:
                    continue
                rows.append(_row(config, work, key, test, variant, set_name, method, note))
    return rows


def _row(
    config: BenchmarkConfig,
    work: Workspace,
    key: str,
    test: Test,
    variant: str,
    set_name: str,
    method: str,
    note: dict[str, Any],
) -> Row:
    scores = {}
    for protocol in test.protocols:
        folder = work.scores_path(set_name, test.stored(method), protocol)
        if not folder.exists():  # protocol `matches` of a method without keypoints
            continue
        found = read_scores(folder).document
        scores[protocol] = {"values": found["overall"], "intervals": found["intervals"]["overall"]}
        if len(found["tiers"]) > 1:
            intervals = found["intervals"]["tiers"].get(test.tier, {})
            scores[protocol] = {"values": found["tiers"][test.tier], "intervals": intervals}
    trained = method in config.runs
    arm = (config.runs[method].arm if trained else "") or method
    return Row(
        key,
        variant,
        set_name,
        method,
        _label(config, test, method),
        (trained and config.runs[method].learned) or method in test.shipped,
        test.paper_rmse_px.get(arm) if variant == next(iter(test.variants)) else None,
        scores,
        training_cost(config, work, method) if trained else None,
        float(note["facts"]["predict_cpu_s"]),
        int(note["facts"]["pairs"]),
        arm,
    )


def _label(config: BenchmarkConfig, test: Test, method: str) -> str:
    if method in config.runs:
        return config.runs[method].label
    if method in test.shipped:
        return f"{method}, as shipped"
    name = method.replace("-", " ").capitalize()
    return _LABELS.get(method, method.upper() if method in CLASSICAL else name)


def training_cost(config: BenchmarkConfig, work: Workspace, run: str) -> Cost:
    """Return what a run's weights cost, those it started from included."""
    cost = work.cost(f"run/{run}")
    earlier = config.runs[run].after
    return cost + training_cost(config, work, earlier) if earlier else cost


def blocks(rows: list[Row]) -> Iterator[tuple[str, str, list[Row]]]:
    """Yield test, variant and rows of each block, in order."""
    seen: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        seen.setdefault((row.test, row.variant), []).append(row)
    for (test, variant), members in seen.items():
        yield test, variant, members


def arms(rows: Sequence[Row]) -> list[Row]:
    """Return one row for each arm of a block: figures are means over its random seeds.

    Where there are several seeds, the interval of a figure is its lowest and its highest value.
    """
    grouped: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        grouped.setdefault((row.test, row.variant, row.arm), []).append(row)
    return [_mean(members) if len(members) > 1 else members[0] for members in grouped.values()]


def _mean(rows: Sequence[Row]) -> Row:
    scores: dict[str, Any] = {}
    for protocol, first in rows[0].scores.items():
        values, intervals = {}, {}
        for metric in first["values"]:
            found = [row.value(protocol, metric) for row in rows]
            known = [value for value in found if value is not None]
            values[metric] = sum(known) / len(known) if len(known) == len(rows) else None
            if len(known) == len(rows):
                intervals[metric] = (min(known), max(known))
        scores[protocol] = {"values": values, "intervals": intervals}
    costs = [row.train for row in rows if row.train is not None]
    return replace(
        rows[0],
        label=f"{rows[0].label} ({len(rows)} seeds)",
        scores=scores,
        train=Cost(
            sum(cost.wall_s for cost in costs) / len(costs),
            sum(cost.cpu_s for cost in costs) / len(costs),
        ),
        predict_cpu_s=sum(row.predict_cpu_s for row in rows) / len(rows),
        seeds=len(rows),
    )


def best_untrained(rows: Sequence[Row], protocol: str, metric: str = "rmse_px") -> Row | None:
    """Return the method without training that has the lowest error, None where none was asked.

    Controls, which do not look at the images, are not methods.
    """
    found = [row for row in rows if not row.learned and row.method not in CONTROLS]
    known = [(value, row) for row in found if (value := row.value(protocol, metric)) is not None]
    return min(known, key=lambda each: each[0])[1] if known else None


def table_document(config: BenchmarkConfig, work: Workspace, rows: list[Row]) -> dict[str, Any]:
    """Return the table as JSON values: every row, and what each stage cost."""
    told = ("wall_s", "cpu_s", "machine", "cores", "finished")
    stages = {stage: {name: note[name] for name in told} for stage, note in work.notes().items()}
    return {
        "name": config.name,
        "version": config.version,
        "rows": [
            {
                "test": row.test,
                "variant": row.variant,
                "set": row.set,
                "method": row.method,
                "label": row.label,
                "paper_rmse_px": row.paper_rmse_px,
                "scores": row.scores,
                "train_wall_s": None if row.train is None else row.train.wall_s,
                "train_cpu_s": None if row.train is None else row.train.cpu_s,
                "predict_cpu_s": row.predict_cpu_s,
                "pairs": row.pairs,
            }
            for row in rows
        ],
        "stages": stages,
    }
