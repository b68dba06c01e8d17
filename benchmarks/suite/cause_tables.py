"""What the errors of a benchmark's methods are made of: the shares of their causes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from pliant.benchmarks.suite.config import BenchmarkConfig
from pliant.benchmarks.suite.table import Row, arms, blocks
from pliant.benchmarks.suite.work import Workspace
from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.metrics.causes import CAUSES
from pliant.evaluator.scores import read_scores

_PROTOCOL: Final = "standard"


def cause_tables(
    config: BenchmarkConfig, work: Workspace, rows: Sequence[Row]
) -> list[dict[str, Any]]:
    """Return a table for the first variant of every block: `title`, `heads` and `rows`.

    A cell is the share of the method's squared error that a cause has, in percent; that of a
    training with several random seeds is the mean over those where the share is defined. Controls
    and methods that were scored without causes are left out.

    Args:
        config: The benchmark.
        work: Its folder.
        rows: The table.
    """
    counted = [cause for cause in CAUSES if cause.name not in ("hidden", "missing")]
    tables = []
    for key, variant, members in blocks(list(rows)):
        test = config.tests[key]
        if variant != next(iter(test.variants)) or _PROTOCOL not in test.protocols:
            continue
        lines = []
        for arm in arms(members):
            found = [
                read_scores(work.scores_path(row.set, test.stored(row.method), _PROTOCOL))
                for row in members
                if row.arm == arm.arm and row.method not in CONTROLS
            ]
            causes = [scores.document["causes"] for scores in found if "causes" in scores.document]
            if causes:
                shares = (
                    _mean_share([each["tiers"][test.tier][cause.name] for each in causes])
                    for cause in counted
                )
                lines.append([arm.label, *shares])
        if lines:
            heads = ["Method", *(cause.label for cause in counted)]
            tables.append({"title": f"{test.title}: {variant}", "heads": heads, "rows": lines})
    return tables


def _mean_share(seeds: Sequence[dict[str, Any]]) -> str:
    """Return a cause's mean share of the squared error in percent, empty where it has none."""
    shares = [seed["squared_error_share"] for seed in seeds]
    known = [share for share in shares if share is not None]
    return f"{100 * sum(known) / len(known):.1f}" if known else ""
