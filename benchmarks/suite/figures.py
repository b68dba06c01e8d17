"""The figures of a benchmark: errors with their intervals, and jumps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pliant.benchmarks.suite.config import BenchmarkConfig
from pliant.benchmarks.suite.table import Row, arms, blocks
from pliant.evaluator.report.canvas import Bar, bars_png


def draw_figures(config: BenchmarkConfig, rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the errors of each test, and its jump rates where it has several variants.

    Args:
        config: The benchmark.
        rows: Its table.
        folder: Where to write PNGs.

    Returns:
        Their paths.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for key, test in config.tests.items():
        members = [row for row in rows if row.test == key]
        if not members:
            continue
        protocol = "paper" if "paper" in test.protocols else test.protocols[0]
        made = config.sets[members[0].set]
        size = f"{made.width}x{made.height}"
        path = folder / f"rmse-{key}.png"
        _bars(members, protocol, "rmse_px", f"{test.title}: RMSE, px at {size}", path)
        paths.append(path)
        if "standard" in test.protocols and len(test.variants) > 1:
            path = folder / f"jumps-{key}.png"
            title = f"{test.title}: share of neighbours whose answers jump apart"
            _bars(members, "standard", "jump_rate", title, path)
            paths.append(path)
    return paths


def _bars(members: Sequence[Row], protocol: str, metric: str, title: str, path: Path) -> None:
    """Draw a bar per method and variant, with its interval and the paper's figure."""
    bars = [
        Bar(
            row.label,
            row.variant,
            value,
            row.interval(protocol, metric),
            row.paper_rmse_px if metric == "rmse_px" else None,
        )
        for _, _, rows in blocks(arms(members))
        for row in rows
        if (value := row.value(protocol, metric)) is not None
    ]
    path.write_bytes(bars_png(bars, title=title, reference="the paper, on its own images"))
