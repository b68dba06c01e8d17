"""The page of `pliant compare`: verdicts in words, differences, causes and error curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pliant.evaluator.comparison import Difference, method_names
from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.metrics.base import OVERALL
from pliant.evaluator.report.cells import cause_bars, heading, score_cell
from pliant.evaluator.report.leaderboard import error_curves
from pliant.evaluator.report.pages import render_page
from pliant.evaluator.report.verdict import board_verdict, joined
from pliant.evaluator.scores import Scores
from pliant.evaluator.statistics.sign_flips import fewest_sequences


def render_comparison(reports: Sequence[Scores], found: Sequence[Difference]) -> str:
    """Return the comparison as one HTML page that loads nothing from elsewhere.

    Args:
        reports: Comparable reports, two at least.
        found: Their `differences`.
    """
    document, names = reports[0].document, method_names(reports)
    protocol = document["protocol"]
    metrics = list(dict.fromkeys(item.metric for item in found))
    tiers = list(document["tiers"])
    groups = [OVERALL, *tiers] if len(tiers) > 1 else [OVERALL]
    titles = {
        (group, metric): heading(metric, protocol).in_text
        + ("" if len(groups) == 1 else f", {group}")
        for group in groups
        for metric in metrics
    }
    return render_page(
        "comparison.html.j2",
        d=document,
        names=names,
        groups=groups,
        verdict=_verdict(reports, names, found, metrics[0] if metrics else ""),
        scores=[
            {
                "group": group,
                "title": title,
                "cells": [score_cell(each.document, group, metric) for each in reports],
            }
            for (group, metric), title in titles.items()
            if metric in document["overall"]
        ],
        rows=[
            _row(item, titles[item.group, item.metric], protocol)
            for item in found
            if item.group in groups
        ],
        fewest=fewest_sequences(float(document["intervals"]["level"])),
        charts=error_curves(reports, names),
        **cause_bars(reports, names),
    )


def _row(item: Difference, title: str, protocol: str) -> dict[str, Any]:
    shown = heading(item.metric, protocol)
    bounds = ""
    if np.isfinite(item.low):
        bounds = f"[{shown.written(item.low)}, {shown.written(item.high)}]"
    return {
        "group": item.group,
        "title": title,
        "method": item.method,
        "against": item.against,
        "value": repr(item.value),
        "written": f"{'+' if item.value > 0 else ''}{shown.written(item.value)}",
        "interval": bounds,
        "verdict": item.verdict,
        "sequences": item.sequences,
        "needed": "" if item.sequences_needed is None else f"about {item.sequences_needed:,}",
    }


def _verdict(
    reports: Sequence[Scores], names: Sequence[str], found: Sequence[Difference], metric: str
) -> list[str]:
    """Return sentences on the first metric: who is clearly better, and against the controls."""
    protocol = reports[0].document["protocol"]
    mine = [item for item in found if item.group == OVERALL and item.metric == metric]
    label = heading(metric, protocol).label
    better = {
        (item.method, item.against) if item.verdict == "better" else (item.against, item.method)
        for item in mine
        if item.verdict in ("better", "worse")
    }
    sentences = []
    for name in names:
        beaten = [other for other in names if (name, other) in better]
        if beaten and name not in CONTROLS:
            sentences.append(f"{name} is clearly better than {joined(beaten)} by {label}.")
    if not better:
        few = any(item.verdict == "too few sequences" for item in mine)
        why = "too few sequences for a verdict" if few else "no clear difference"
        sentences.append(f"{label}: {why} between {joined(names)}.")
    values = {name: each.overall.get(metric) for name, each in zip(names, reports, strict=True)}
    control = board_verdict(values, metric, protocol)
    return sentences + ([control] if control else [])
