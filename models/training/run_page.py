"""The page of a training run: its facts, and sections of text, tables and charts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pliant.evaluator.report.charts import Chart, Labels, line_chart
from pliant.evaluator.report.pages import render_page
from pliant.evaluator.scores import REPORT_HTML
from pliant.spec.io.writing import write_file


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        title: Heading.
        text: What the reader sees there.
        lead: A sentence before the text that stands out.
        table: Rows of cells, the first row is the heading.
        charts: Charts.
    """

    title: str
    text: str = ""
    lead: str = ""
    table: Sequence[Sequence[str]] = ()
    charts: Sequence[Chart] = ()


def write_run_page(run: Path, facts: Mapping[str, Any], sections: Sequence[Section]) -> None:
    """Write `RUN/report.html`, one self-contained page.

    Args:
        run: The run's folder.
        facts: Label -> value; mappings are flattened.
        sections: The rest of the page.
    """
    page = render_page(
        "run.html.j2", package="pliant.models", name=run.name, facts=_flat(facts), sections=sections
    )
    write_file(run / REPORT_HTML, page)


def history_chart(
    history: Sequence[Mapping[str, float]], keys: Mapping[str, str], title: str, unit: str = ""
) -> Chart:
    """Draw logged values over the training steps.

    Args:
        history: The logged values of a run.
        keys: Label -> key in `history`; a key that a row lacks is skipped in it.
        title: Heading.
        unit: Label of the vertical axis.
    """
    series = {}
    for label, key in keys.items():
        rows = [(row["step"], row[key]) for row in history if key in row]
        series[label] = ([step for step, _ in rows], [value for _, value in rows])
    validated = any(key.startswith("val/") for key in keys.values())
    return line_chart(series, Labels(title, "step", unit), from_zero=validated)


def _flat(facts: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in facts.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name} ")
        elif isinstance(value, float):
            yield prefix + name, f"{value:.4g}"
        else:
            yield prefix + name, "not given" if value in (None, "") else str(value)
