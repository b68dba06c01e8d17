"""What a benchmark leaves: the table as JSON, the page, the figures."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

from pliant.benchmarks.suite.checksums import Differences
from pliant.benchmarks.suite.config import BenchmarkConfig
from pliant.benchmarks.suite.figures import draw_figures
from pliant.benchmarks.suite.page import results_page
from pliant.benchmarks.suite.table import finished_rows, table_document
from pliant.benchmarks.suite.work import Workspace
from pliant.spec.io.jsonfiles import write_json


def write_results(
    config: BenchmarkConfig,
    out: Path,
    differing: Differences,
    command: str,
    page: Path | None = None,
) -> dict[str, Any]:
    """Write `table.json`, `results.md` and `figures/` of all that is scored.

    Args:
        config: The benchmark.
        out: Its folder.
        differing: How its test queries differ from the frozen ones.
        command: What was called, for the page.
        page: A second place for the page, such as `DIR/PAGE.md`; its figures go to
            `DIR/pictures/PAGE/`.

    Returns:
        The table, as in `table.json`.
    """
    work = Workspace(out)
    rows = finished_rows(config, work)
    document = table_document(config, work, rows)
    write_json(out / "table.json", document)
    figures = draw_figures(config, rows, out / "figures")
    places = [(out / "results.md", figures)]
    if page is not None:
        pictures = page.parent / "pictures" / page.stem
        pictures.mkdir(parents=True, exist_ok=True)
        places.append((page, [Path(shutil.copy(each, pictures)) for each in figures]))
    for target, pictured in places:
        names = [Path(os.path.relpath(each, target.parent)).as_posix() for each in pictured]
        text = results_page(config, work, rows, differing, names, command)
        target.write_text(text, encoding="utf-8")
    return document
