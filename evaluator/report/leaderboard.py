"""One sortable page from many reports of one protocol, dataset and split."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pliant.evaluator.hidden_truth import public_scores
from pliant.evaluator.report import plots
from pliant.evaluator.report.report import page_style, template_environment
from pliant.evaluator.report.wording import (
    about,
    interval_text,
    label,
    match_coverage_text,
    written,
    written_unit,
)
from pliant.evaluator.scorers.base import OVERALL
from pliant.evaluator.scores import SCORES_JSON, Scores, read_scores
from pliant.evaluator.statistics.comparison import (
    Difference,
    check_comparable,
    differences,
    method_names,
    ranks,
)
from pliant.evaluator.statistics.sign_flips import fewest_sequences
from pliant.spec.errors import CallError


def find_reports(places: Sequence[Path]) -> list[Path]:
    """Return the report folders among some folders and directly below them, sorted.

    Args:
        places: Report folders, or folders of report folders.

    Raises:
        CallError: A place is no folder, or holds no report.
    """
    found: list[Path] = []
    for place in places:
        if not place.is_dir():
            raise CallError(
                "this is no folder", path=place, required="a report or a folder of some"
            )
        if (place / SCORES_JSON).is_file():
            found.append(place)
            continue
        inside = sorted(path.parent for path in place.glob(f"*/{SCORES_JSON}"))
        if not inside:
            raise CallError("the folder holds no report", path=place, required=SCORES_JSON)
        found += inside
    return list(dict.fromkeys(found))


def read_reports(places: Sequence[Path]) -> list[Scores]:
    """Read the reports at some places; errors as `find_reports` and `read_scores`."""
    return [read_scores(path) for path in find_reports(places)]


def render_leaderboard(
    reports: Sequence[Scores], links: Sequence[str] | None = None, *, hide_truth: bool = False
) -> str:
    """Return the leaderboard as one HTML page that needs nothing from outside.

    Args:
        reports: Comparable reports.
        links: Where each method's name leads to; None for nowhere.
        hide_truth: Show what `public_scores` leaves, and the ranks; no differences.

    Raises:
        CallError: They mix protocols, datasets or splits, or `hide_truth` is asked for reports
            that were scored without it.
    """
    check_comparable(reports)
    document = reports[0].document
    protocol = document["protocol"]
    names = method_names(reports)
    main = document["headline"][0]
    _, _, better = about(main, protocol)
    found = differences(reports, [main])
    standing = ranks(found, names).get((OVERALL, main), [1] * len(reports))
    if hide_truth:
        reports = [public_scores(report) for report in reports]
    columns = [(OVERALL, metric) for metric in document["headline"]]
    tiers = list(document["tiers"])
    if len(tiers) > 1:
        columns += [(tier, main) for tier in tiers]
    order = sorted(range(len(reports)), key=lambda i: _sort_key(reports[i], main, better))
    return (
        template_environment()
        .get_template("leaderboard.html.j2")
        .render(
            d=document,
            style=page_style(),
            heads=[_head(group, metric, protocol) for group, metric in columns],
            rows=[
                {
                    "rank": standing[i],
                    "name": names[i],
                    "href": links[i] if links else "",
                    "coverage": reports[i].document["coverage"],
                    "cells": [_cell(reports[i], group, metric) for group, metric in columns],
                }
                for i in order
            ],
            main=label(main),
            fewest_sequences=fewest_sequences(float(document["intervals"]["level"])),
            too_few=any(item.verdict == "too few sequences" for item in found),
            plots=[]
            if hide_truth
            else [
                *_differences(found, [names[i] for i in order], main, protocol),
                *_plots(reports, names),
            ],
        )
    )


def _sort_key(report: Scores, metric: str, better: str) -> float:
    value = report.overall.get(metric)
    if value is None:
        return float("inf")
    return -value if better == "higher" else value


def _head(group: str, metric: str, protocol: str) -> dict[str, str]:
    words, unit, better = about(metric, protocol)
    shown = written_unit(unit)
    name = label(metric) if group == OVERALL else f"{group}: {label(metric)}"
    arrow = {"lower": "\u00a0↓", "higher": "\u00a0↑"}.get(better, "")
    return {"label": f"{name}{', ' + shown if shown else ''}{arrow}", "about": words}


def _cell(report: Scores, group: str, metric: str) -> dict[str, Any]:
    document = report.document
    values = report.overall if group == OVERALL else report.tiers[group]
    intervals = document["intervals"]
    found = intervals["overall"] if group == OVERALL else intervals["tiers"].get(group, {})
    _, unit, _ = about(metric, document["protocol"])
    value = values.get(metric)
    return {
        "value": written(value, unit),
        "key": "" if value is None else repr(value),
        "interval": interval_text(found.get(metric), unit),
        "coverage": match_coverage_text(document, group, metric),
    }


def _differences(
    found: Sequence[Difference], names: Sequence[str], metric: str, protocol: str
) -> list[str]:
    """Return the differences of all methods from the first, with intervals, as a plot."""
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
    _, unit, _ = about(metric, protocol)
    ordered = {name: rows[name] for name in names if name in rows}
    return [
        plots.interval_svg(
            ordered,
            title=f"{label(metric)}: difference from {names[0]}",
            xlabel=f"{label(metric)}{', ' + unit if unit else ''}; blue: clear",
        )
    ]


def _plots(reports: Sequence[Scores], names: Sequence[str]) -> list[str]:
    """Return the CDF of every method, one plot a tier."""
    result = []
    for tier in reports[0].tiers:
        series = {
            name: (curve["error_px"], curve["share_below"])
            for name, report in zip(names, reports, strict=True)
            if (curve := report.document["curves"].get(tier, {}).get("cdf"))
        }
        if series:
            result.append(plots.cdf_svg(series, title=f"{tier}: share of answers within"))
    return result
