"""The overview page of a benchmark: its tables, frames, error histograms and best matches."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from PIL import Image

from pliant.benchmarks.suite.config import BenchmarkConfig
from pliant.benchmarks.suite.opening import opening
from pliant.benchmarks.suite.table import CLASSICAL, Row, blocks
from pliant.benchmarks.suite.work import Workspace
from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.report.best_matches import best_matches
from pliant.evaluator.report.cells import cause_bars
from pliant.evaluator.report.charts import Chart
from pliant.evaluator.report.contact_sheet import contact_sheet
from pliant.evaluator.report.pages import render_page
from pliant.evaluator.report.report import error_histogram
from pliant.evaluator.report.verdict import board_verdict
from pliant.evaluator.scores import REPORT_HTML, read_scores
from pliant.spec.dataset import Dataset
from pliant.spec.io.writing import replacing
from pliant.spec.queries import QueryPair

_FRAMES_SHOWN: Final = 6
_TABLES: Final = (
    ("standard", "rmse_px", "RMSE in px, every query answered (protocol standard)"),
    ("standard", "median_px", "Median error in px"),
    ("standard", "pck_16px", "Share of answers within 16 px"),
    (
        "matches",
        "rmse_px",
        "RMSE in px of the methods' own keypoint matches, which answer only where a keypoint was "
        "found (protocol matches; how the paper scored them)",
    ),
)


@dataclass(frozen=True)
class _Cell:
    value: str
    best: bool
    control: bool


@dataclass(frozen=True)
class _Block:
    name: str
    facts: str
    frames_png: bytes
    histogram: Chart
    matches: Sequence[tuple[str, str]]
    bars: Mapping[str, Any]


def write_overview(config: BenchmarkConfig, out: Path, rows: Sequence[Row]) -> Path:
    """Write `OUT/report/index.html`, one self-contained page with links to the reports.

    Args:
        config: The benchmark.
        out: Its folder.
        rows: Its table; every row is scored by protocol `standard`.

    Returns:
        The page.
    """
    work, page = Workspace(out), out / "report" / "index.html"
    grouped = [
        (name if len(config.tests[key].variants) == 1 else f"{name}, {variant}", members)
        for key, variant, members in blocks(list(rows))
        for name in [config.tests[key].tier]
    ]
    datasets = {
        name: Dataset.open(work.set_path(name)) for name in dict.fromkeys(row.set for row in rows)
    }
    notes = {
        row.label: f"{method.get('implementation', '')} {method.get('version', '')}".strip()
        for row in rows
        if row.method not in CONTROLS
        for method in [_document(work, row)["submission"]["method"]]
    }
    text = render_page(
        "overview.html.j2",
        package="pliant.benchmarks.suite",
        title=next(iter(datasets.values())).info["title"].partition(":")[0],
        opening=opening(work, rows),
        verdict=[text for name, members in grouped for text in _verdict(name, members)],
        tables=[
            {"caption": caption, **table}
            for protocol, metric, caption in _TABLES
            if (table := _table(work, page, grouped, protocol, metric))
        ],
        notes={name: note for name, note in notes.items() if note},
        blocks=[
            _block(
                work, datasets[members[0].set], config.tests[members[0].test].tier, name, members
            )
            for name, members in grouped
        ],
        facts=_facts(config, datasets),
    )
    page.parent.mkdir(parents=True, exist_ok=True)
    with replacing(page) as partial:
        partial.write_text(text, encoding="utf-8")
    return page


def _verdict(tier: str, rows: Sequence[Row]) -> Iterator[str]:
    """Yield sentences on local features, then on networks, against the controls of a tier."""
    for noun, chosen in (
        ("classical method", [row for row in rows if row.method in CLASSICAL]),
        ("network", [row for row in rows if row.learned]),
    ):
        controls = [row for row in rows if row.method in CONTROLS]
        values = {
            row.label if row.method in CLASSICAL else row.method: row.value("standard", "rmse_px")
            for row in (*chosen, *controls)
        }
        if text := board_verdict(values, "rmse_px", "standard", where=f"on {tier}", noun=noun):
            yield text


def rmse_by_tier(config: BenchmarkConfig, rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Return tier -> method -> RMSE in px by protocol `standard`."""
    found: dict[str, dict[str, float]] = {}
    for row in rows:
        value = row.value("standard", "rmse_px")
        if value is not None:
            found.setdefault(config.tests[row.test].tier, {})[row.method] = value
    return found


def format_px(value: float) -> str:
    """Return pixels with three significant digits, and a bare 0 for exactly 0."""
    if value == 0:
        return "0"
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def _document(work: Workspace, row: Row, protocol: str = "standard") -> dict[str, Any]:
    return read_scores(work.scores_path(row.set, row.method, protocol)).document


def _table(
    work: Workspace,
    page: Path,
    grouped: Sequence[tuple[str, Sequence[Row]]],
    protocol: str,
    metric: str,
) -> dict[str, Any]:
    """Return a table of methods by tiers, empty if no method has the metric."""
    scored = [
        (name, {row.method: row for row in rows if row.value(protocol, metric) is not None})
        for name, rows in grouped
    ]
    found = {method: row for _, rows in reversed(scored) for method, row in rows.items()}
    columns = {method: found[method] for method in sorted(found, key=_column_order)}
    if not columns:
        return {}
    return {
        "columns": [
            {
                "name": method if method in CONTROLS else row.label,
                "href": os.path.relpath(
                    work.scores_path(row.set, method, protocol) / REPORT_HTML, page.parent
                ),
                "control": method in CONTROLS,
            }
            for method, row in columns.items()
        ],
        "rows": [
            (name, _cells({m: rows[m].value(protocol, metric) for m in rows}, columns, metric))
            for name, rows in scored
        ],
    }


def _cells(
    values: Mapping[str, float | None], methods: Mapping[str, Row], metric: str
) -> list[_Cell]:
    """Return a row; the best value among the methods is marked, controls do not compete."""
    share = metric.startswith("pck")
    competing = [v for m, v in values.items() if v is not None and m not in CONTROLS]
    best = (max if share else min)(competing, default=None)
    cells = []
    for method in methods:
        value, control = values.get(method), method in CONTROLS
        text = "–" if value is None else f"{value:.3f}" if share else format_px(value)
        cells.append(_Cell(text, value is not None and not control and value == best, control))
    return cells


def _column_order(method: str) -> int:
    """Return 0 for networks, 1 for other methods, 2 for controls."""
    return 2 if method in CONTROLS else 1 if method in CLASSICAL else 0


def _block(work: Workspace, dataset: Dataset, tier: str, name: str, rows: Sequence[Row]) -> _Block:
    pairs = [pair for pair in dataset.pairs("test") if pair.source.sequence.tier == tier]
    sequences = [each for each in dataset.sequences if each.tier == tier]
    frames = sum(each.frames for each in sequences)
    curves = {
        row.label: _document(work, row)["curves"][tier]["error_px"]
        for row in rows
        if row.method not in CONTROLS or row.method == "random"
    }
    return _Block(
        name=name,
        facts=f"{len(sequences)} sequences, {frames} images, {len(pairs)} pairs, "
        f"{sum(map(len, pairs))} queries.",
        frames_png=_png(contact_sheet(dataset, sequences, count=_FRAMES_SHOWN)),
        histogram=error_histogram(curves, title=f"Errors on {name}"),
        matches=[_matches(work, dataset, row, pairs[0]) for row in rows if "matches" in row.scores],
        bars=_bars(work, tier, rows),
    )


def _bars(work: Workspace, tier: str, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the causes of the errors of the methods of a tier, and of the random control."""
    chosen = [row for row in rows if row.method not in CONTROLS or row.method == "random"]
    reports = [read_scores(work.scores_path(row.set, row.method, "standard")) for row in chosen]
    return cause_bars(reports, [row.label for row in chosen], tier)


def _matches(work: Workspace, dataset: Dataset, row: Row, pair: QueryPair) -> tuple[str, str]:
    submission = work.answers_path(row.set, row.method, "matches")
    best = best_matches(dataset, pair, submission)
    if not best.drawn:
        return f"{row.label}: no match on this pair", best.svg
    caption = (
        f"{row.label}: {best.right} of its {best.drawn} best matches within "
        f"{best.radius_px:.0f} px (green)"
    )
    return caption, best.svg


def _png(image: Any) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _facts(config: BenchmarkConfig, datasets: Mapping[str, Dataset]) -> dict[str, str]:
    facts = {"benchmark": f"{config.name} {config.version}"}
    for name, dataset in datasets.items():
        made = config.sets[name]
        tools = dataset.info["provenance"].get("tools", {})
        facts |= {
            f"dataset {name}": f"{dataset.id} {dataset.version}, seed {made.seed}, "
            f"{made.width}x{made.height}, style {made.style}",
            f"queries of {name}": f"sha256 {dataset.queries_sha256('test')}",
            "made with": ", ".join(f"{tool} {version}" for tool, version in sorted(tools.items())),
        }
    return facts | {"reproduce": "the same seed gives the same tables, geometry and scores"}
