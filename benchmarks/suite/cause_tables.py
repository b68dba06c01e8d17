"""What the errors of a benchmark's methods are made of: the shares of their causes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from pliant.benchmarks.suite.config import BenchmarkConfig
from pliant.benchmarks.suite.table import Row, blocks
from pliant.benchmarks.suite.work import Workspace
from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.metrics.causes import CAUSES
from pliant.evaluator.scores import read_scores

_PROTOCOL: Final = "standard"


def cause_tables(
    config: BenchmarkConfig, work: Workspace, rows: Sequence[Row]
) -> list[dict[str, Any]]:
    """Return a table for the first variant of every block: `title`, `heads` and `rows`.

    A cell is the share of the method's squared error that a cause has, in percent. Controls and
    methods that were scored without causes are left out.

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
        for row in members:
            folder = work.scores_path(row.set, test.stored(row.method), _PROTOCOL)
            causes = read_scores(folder).document.get("causes")
            if row.method in CONTROLS or causes is None:
                continue
            shares = [causes["overall"][cause.name]["squared_error_share"] for cause in counted]
            lines.append([row.label, *("" if s is None else f"{100 * s:.1f}" for s in shares)])
        if lines:
            heads = ["Method", *(cause.label for cause in counted)]
            tables.append({"title": f"{test.title}: {variant}", "heads": heads, "rows": lines})
    return tables
