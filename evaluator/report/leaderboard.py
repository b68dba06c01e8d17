"""One sortable page from many reports of one protocol, dataset and split."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pliant.evaluator.comparison import (
    Difference,
    check_comparable,
    differences,
    method_names,
    ranks,
)
from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.metrics.base import OVERALL
from pliant.evaluator.protocols.protocol import ratios_of
from pliant.evaluator.report.cells import Heading, cause_bars, heading, score_cell
from pliant.evaluator.report.charts import Chart, cdf_chart, interval_chart
from pliant.evaluator.report.pages import render_page
from pliant.evaluator.report.verdict import board_verdict
from pliant.evaluator.scores import SCORES_JSON, Scores, public_scores, read_scores
from pliant.evaluator.statistics.sign_flips import fewest_sequences
from pliant.spec.errors import CallError

_LONGEST: Final = 60
_WEB: Final = re.compile(r"https?://[^\s<>\"']+")
FACTS: Final = {
    "seconds_per_pair": "Answering, s per pair",
    "training_hours": "Training, h",
    "date": "Date",
    "author": "Author",
    "link": "Link",
    "code": "Code",
}
"""Field of a footer's `method`, which is free besides `name` -> heading."""


def find_reports(places: Sequence[Path]) -> list[Path]:
    """Return the report folders among some folders and directly below them, sorted.

    Args:
        places: Report folders, or folders of report folders.

    Raises:
        CallError: A place is not a folder, or contains no report.
    """
    found: list[Path] = []
    for place in places:
        if not place.is_dir():
            raise CallError("not a folder", path=place, required="a report or a folder of reports")
        if (place / SCORES_JSON).is_file():
            found.append(place)
            continue
        inside = sorted(path.parent for path in place.glob(f"*/{SCORES_JSON}"))
        if not inside:
            raise CallError("the folder contains no report", path=place, required=SCORES_JSON)
        found += inside
    return list(dict.fromkeys(found))


def read_reports(places: Sequence[Path]) -> list[Scores]:
    """Read the reports at some places; errors as `find_reports` and `read_scores`."""
    return [read_scores(path) for path in find_reports(places)]


def render_leaderboard(
    reports: Sequence[Scores],
    links: Sequence[str] | None = None,
    *,
    title: str | None = None,
    hide_truth: bool = False,
) -> str:
    """Return the leaderboard as one HTML page that loads nothing from elsewhere.

    Args:
        reports: Comparable reports.
        links: Link of each method's name, or None.
        title: Heading of the page; None takes the dataset's title.
        hide_truth: Show only the `public_scores` and the ranks; no differences.

    Raises:
        CallError: They mix protocols, datasets or splits, or `hide_truth` is asked for reports
            that were scored without it.
    """
    check_comparable(reports)
    document = reports[0].document
    names = method_names(reports)
    main = document["headline"][0]
    averaged = main in ratios_of(document)
    standing, among = _standing(reports, names, main)
    if hide_truth:
        reports = [public_scores(report) for report in reports]
    ranked = heading(main, reports[0].document)
    values = [each.overall.get(main) for each in reports]
    verdict = board_verdict(
        {names[i]: values[i] for i in standing},
        {each.method: value for each, value in zip(reports, values, strict=True)},
        ranked,
    )
    columns = [(OVERALL, metric) for metric in document["headline"]]
    tiers = list(document["tiers"])
    if len(tiers) > 1:
        columns += [(tier, main) for tier in tiers]
    order = sorted(range(len(reports)), key=lambda i: ranked.rank_key(reports[i].overall.get(main)))
    fact_names, facts = fact_table([each.document["submission"]["method"] for each in reports])
    charts: list[Chart] = []
    if not hide_truth:
        charts = _differences(among, [names[i] for i in order if i in standing], ranked)
        charts += error_curves(reports, names)
    shown = sorted(order, key=lambda i: i not in standing)
    rows = {
        i: {
            "rank": standing.get(i),
            "name": names[i],
            "href": links[i] if links else "",
            "coverage": reports[i].document["coverage"],
            "cells": [
                (group, score_cell(reports[i].document, group, metric)) for group, metric in columns
            ],
            "facts": facts[i],
        }
        for i in order
    }
    return render_page(
        "leaderboard.html.j2",
        d=reports[0].document,
        title=title or document["dataset"]["title"],
        columns=[(group, heading(metric, document)) for group, metric in columns],
        groups=[OVERALL, *tiers],
        fact_names=fact_names,
        rows=[row for i, row in rows.items() if i in standing],
        controls=[row for i, row in rows.items() if i not in standing],
        verdict=[verdict] if verdict else [],
        main=ranked.label,
        averaged=averaged,
        fewest_sequences=fewest_sequences(float(document["intervals"]["level"])),
        too_few=any(item.verdict == "too few sequences" for item in among),
        charts=charts,
        **cause_bars([reports[i] for i in shown], [names[i] for i in shown]),
    )


def _standing(
    reports: Sequence[Scores], names: Sequence[str], main: str
) -> tuple[dict[int, int | None], list[Difference]]:
    """Return the ranks of the reports that compete, and the differences between them."""
    competing = [i for i in range(len(reports)) if reports[i].method not in CONTROLS]
    found = differences(reports, [main]) if main in ratios_of(reports[0].document) else []
    rivals = {names[i] for i in competing}
    among = [item for item in found if {item.method, item.against} <= rivals]
    places = ranks(among, [names[i] for i in competing])
    # No differences: fewer than two methods have a value, or the metric has no significance test.
    alone = [None if reports[i].overall.get(main) is None else 1 for i in competing]
    return dict(zip(competing, places.get((OVERALL, main), alone), strict=True)), among


def _differences(found: Sequence[Difference], names: Sequence[str], shown: Heading) -> list[Chart]:
    """Return the differences of all methods from the first, with intervals, as a chart."""
    if not names:
        return []
    rows = {}
    for item in found:
        if item.group != OVERALL or not np.isfinite(item.low):
            continue
        if item.against == names[0]:
            rows[item.method] = (item.low, item.value, item.high)
        elif item.method == names[0]:
            rows[item.against] = (-item.high, -item.value, -item.low)
    if not rows:
        return []
    ordered = {name: rows[name] for name in names if name in rows}
    title = f"{shown.label}: difference from {names[0]}"
    return [interval_chart(ordered, title=title, x=f"{shown.text}; blue: clear")]


def error_curves(reports: Sequence[Scores], names: Sequence[str]) -> list[Chart]:
    """Return the error CDFs of all methods, one chart per tier."""
    result = []
    for tier in reports[0].tiers:
        series = {
            name: (curve["error_px"], curve["share_below"])
            for name, report in zip(names, reports, strict=True)
            if (curve := report.document["curves"].get(tier, {}).get("cdf"))
        }
        if series:
            result.append(cdf_chart(series, title=f"{tier}: share of answers within"))
    return result


@dataclass(frozen=True)
class Fact:
    """One cell of what a submission's footer says about its method.

    Attributes:
        text: What it shows; empty where the footer has nothing fit.
        key: What it is sorted by.
        href: A web address it links to, or empty.
    """

    text: str
    key: str
    href: str = ""


def fact_table(methods: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[Fact]]]:
    """Return the headings that any method has a fact for, and a row of facts for each method.

    Args:
        methods: `method` of each footer.
    """
    found = {field: [_fact(field, method.get(field)) for method in methods] for field in FACTS}
    shown = [field for field, facts in found.items() if any(fact.text for fact in facts)]
    rows = [[found[field][index] for field in shown] for index in range(len(methods))]
    return [FACTS[field] for field in shown], rows


def _fact(field: str, value: Any) -> Fact:
    if field in ("seconds_per_pair", "training_hours"):
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not 0 <= value <= sys.float_info.max:  # JSON has integers beyond it
            return Fact("", "")
        return Fact(f"{value:.3g}", repr(float(value)))
    if not isinstance(value, str) or not value.strip():
        return Fact("", "")
    text = " ".join(value.split())
    if field in ("link", "code"):
        if not _WEB.fullmatch(text):  # never another scheme, such as javascript:
            return Fact("", "")
        return Fact(re.sub(r"^https?://(www\.)?", "", text)[:_LONGEST], text, text)
    return Fact(text[:_LONGEST], text)
