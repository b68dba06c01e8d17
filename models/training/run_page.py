"""The page of a training run: its facts, and sections of text, tables, charts and pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pliant.evaluator.report.charts import Chart
from pliant.evaluator.report.pages import render_page
from pliant.evaluator.scores import REPORT_HTML
from pliant.spec.io.writing import replacing


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        title: Heading.
        text: What the reader sees there.
        lead: A sentence before the text that stands out.
        table: Rows of cells, the first row is the heading.
        charts: Charts.
        picture: PNG bytes, or None.
    """

    title: str
    text: str = ""
    lead: str = ""
    table: Sequence[Sequence[str]] = ()
    charts: Sequence[Chart] = ()
    picture: bytes | None = None


def write_run_page(run: Path, facts: Mapping[str, Any], sections: Sequence[Section]) -> Path:
    """Write `RUN/report.html`, one self-contained page.

    Args:
        run: The run's folder.
        facts: Label -> value; mappings are flattened.
        sections: The rest of the page.

    Returns:
        The page.
    """
    page = render_page(
        "run.html.j2", package="pliant.models", name=run.name, facts=_flat(facts), sections=sections
    )
    path = run / REPORT_HTML
    with replacing(path) as partial:
        partial.write_text(page, encoding="utf-8")
    return path


def _flat(facts: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in facts.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name} ")
        elif isinstance(value, float):
            yield prefix + name, f"{value:.4g}"
        else:
            yield prefix + name, "not given" if value in (None, "") else str(value)
