"""The figures of a benchmark: errors with their intervals, and jumps."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pliant.benchmarks.suite.config import BenchmarkConfig
from pliant.benchmarks.suite.table import Row, blocks

_COLOURS = {"clean": "#2f6f9f", "noisy": "#c8742b", "unseen": "#6c9a4f"}
_OTHER = "#7a7a7a"
_LABEL_CHARACTERS = 34


def draw_figures(config: BenchmarkConfig, rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw one figure of errors a block of the table that has pairs, and one of jumps.

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
        path = folder / f"rmse-{key}.png"
        _bars(members, protocol, "rmse_px", f"{test.title}: RMSE, px at 640x480", path)
        paths.append(path)
        if "standard" in test.protocols and len(test.variants) > 1:
            path = folder / f"jumps-{key}.png"
            title = f"{test.title}: share of neighbours whose answers jump apart"
            _bars(members, "standard", "jump_rate", title, path)
            paths.append(path)
    return paths


def _bars(members: Sequence[Row], protocol: str, metric: str, title: str, path: Path) -> None:
    """Draw a horizontal bar a method and variant, with its interval and the paper's figure."""
    grouped = {variant: rows for _, variant, rows in blocks(list(members))}
    names = list(dict.fromkeys(row.method for row in members))
    labels = {row.method: row.label for row in members}
    height = 0.8 / len(grouped)
    figure = Figure(figsize=(8.0, 1.1 + 0.45 * len(names)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for index, (variant, rows) in enumerate(grouped.items()):
        for row in rows:
            value, interval = row.value(protocol, metric), row.interval(protocol, metric)
            if value is None:
                continue
            y = names.index(row.method) + (index - (len(grouped) - 1) / 2) * height
            first = row is rows[0]
            axes.barh(
                y,
                value,
                height=height * 0.92,
                color=_COLOURS.get(variant, _OTHER),
                label=variant if first else None,
            )
            if interval is not None:
                axes.plot(interval, [y, y], color="#222222", linewidth=1.2)
    for row in members:
        if metric == "rmse_px" and row.paper_rmse_px is not None:
            y = names.index(row.method)
            axes.plot([row.paper_rmse_px] * 2, [y - 0.42, y + 0.42], color="#b3123f", linewidth=2)
    if metric == "rmse_px" and any(row.paper_rmse_px is not None for row in members):
        axes.plot([], [], color="#b3123f", linewidth=2, label="the paper, on its own images")
    wrapped = [textwrap.fill(labels[name], _LABEL_CHARACTERS) for name in names]
    axes.set_yticks(range(len(names)), wrapped, fontsize=9)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(left=0)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    axes.grid(axis="x", color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    handles, _ = axes.get_legend_handles_labels()
    if len(handles) > 1:
        figure.legend(fontsize=8, frameon=False, loc="outside lower center", ncols=4)
    figure.savefig(path, dpi=110)
