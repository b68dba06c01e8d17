"""Writes a report: scores.json, per_pair.parquet and one self-contained HTML page."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

from pliant.evaluator.metrics.base import OVERALL
from pliant.evaluator.metrics.causes import CAUSES
from pliant.evaluator.protocols.protocol import read_protocol
from pliant.evaluator.report import charts
from pliant.evaluator.report.cells import heading, score_cell
from pliant.evaluator.report.charts import Chart, Labels
from pliant.evaluator.report.drawings import FramePictures, pair_svg
from pliant.evaluator.report.pages import render_page
from pliant.evaluator.report.verdict import report_verdict
from pliant.evaluator.scores import PER_PAIR_TABLE, REPORT_HTML, SCORES_JSON, Scores, check_document
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.staging import staged

REPORT_FILES: Final = (PER_PAIR_TABLE, REPORT_HTML, SCORES_JSON)

_FEW_SEQUENCES: Final = 30
"""With fewer sequences, intervals of metrics with many outliers are too narrow."""


def write_report(
    scores: Scores, out_dir: Path | str, *, data: Dataset | Path | str | None = None
) -> None:
    """Write scores.json, per_pair.parquet and report.html.

    Args:
        scores: From `evaluate`.
        out_dir: The report's folder: new, empty, or an earlier report, which is replaced.
        data: The dataset, for the pictures; without it (or its images) panels stay plain.

    Raises:
        CallError: The folder contains something else, or cannot be written.
    """
    folder = Path(out_dir)
    check_out_dir(folder)
    check_document(scores.document)
    dataset = Dataset.open(data) if isinstance(data, Path | str) else data
    page = render_report(scores, dataset)
    with staged(folder) as staging:
        scores.write(staging, page)


def check_out_dir(
    folder: Path, known: Collection[str] = REPORT_FILES, what: str = "report"
) -> None:
    """Refuse an output folder with files of another kind.

    Args:
        folder: The folder, which need not exist.
        known: Names that it may contain.
        what: What is written there.

    Raises:
        CallError: It is a file, or contains other files.
    """
    if folder.exists() and not folder.is_dir():
        raise CallError(f"the {what} needs a folder", path=folder, found="a file")
    names = sorted(p.name for p in folder.iterdir()) if folder.exists() else []
    others = [name for name in names if name not in known]
    if others:
        raise CallError(
            f"the folder contains something other than a {what}",
            path=folder,
            found=", ".join(others[:5]),
            fix="Give a new folder.",
        )


def render_report(scores: Scores, dataset: Dataset | None = None) -> str:
    """Return the report as one HTML page that loads nothing from elsewhere."""
    document = scores.document
    groups = [OVERALL, *document["tiers"]]
    counts = document["counts"]["sequences"].values()
    width, height = document["dataset"]["image_size"]
    frames = FramePictures(dataset, (width, height))
    own = document.get("own_protocol")
    rules = own["document"] if own else read_protocol(document["protocol"]).document
    pictures = [(example, pair_svg(example, frames)) for example in scores.examples]
    return render_page(
        "report.html.j2",
        d=document,
        method=scores.method,
        counted=_counted(document),
        # The figures of a single tier are those of the whole split.
        groups=groups[1:] if len(groups) == 2 else groups,
        heading=partial(heading, document=document),
        cell=partial(score_cell, document),
        no_interval=any(count < 3 for count in counts),
        narrow_interval=any(count < _FEW_SEQUENCES for count in counts),
        charts=report_charts(document),
        verdict=report_verdict(document),
        notes=_notes(document),
        causes=CAUSES,
        cause_labels={cause.name: cause.label for cause in CAUSES},
        cause_groups=_cause_groups(document),
        percent=_percent,
        shown_causes={example.cause for example in scores.examples},
        pictures=pictures,
        definitions=frames.definitions(),
        protocol_text=json.dumps(rules, indent=1),
    )


def _counted(document: Mapping[str, Any]) -> str:
    counts = document["counts"]
    if "counted" not in counts:  # of rounded scores: how many points are visible is hidden
        return f"{counts['queries']:,} queries"
    noun = "queries" if document["submission"]["kind"] == "answers" else "matches"
    return f"{counts['counted']:,} visible {noun}"


def _cause_groups(document: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return (group, its causes): the tiers, and before several of them the whole split."""
    found = document.get("causes")
    if found is None:
        return []
    tiers = list(found["tiers"].items())
    return tiers if len(tiers) == 1 else [(OVERALL, found[OVERALL]), *tiers]


def _notes(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return (what, note) for people; the verdict has that about the controls."""
    return [
        (heading(name, document).label, text.replace("`", ""))
        for name, text in sorted(document["notes"].items())
        if name != "controls"
    ]


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{share * 100:.1f} %"


def error_histogram(curves: Mapping[str, Mapping[str, Any]], *, title: str) -> Chart:
    """Draw L2 error histograms over each other, the share beyond the axis in the legend.

    Args:
        curves: Name (a tier, a method) -> the curve `error_px` of scores.json.
        title: Heading.
    """
    longest = max(curves.values(), key=lambda curve: len(curve["edges_px"]))
    series = {}
    for name, curve in curves.items():
        beyond = curve["share_beyond"]
        text = f"{name} ({beyond * 100:.0f} % beyond)" if beyond >= 0.005 else name
        share = list(curve["share"])
        series[text] = share + [0.0] * (len(longest["share"]) - len(share))
    labels = Labels(title, "error, px", "share of answers")
    return charts.histogram_chart(series, longest["edges_px"], labels)


def report_charts(document: Mapping[str, Any]) -> list[Chart]:
    """Return the charts of a report, one series per tier.

    Args:
        document: The content of scores.json.
    """
    curves = document["curves"]
    tiers = [tier for tier in document["tiers"] if tier in curves] or list(curves)

    def of(name: str) -> dict[str, Any]:
        return {tier: curves[tier][name] for tier in tiers if name in curves[tier]}

    result: list[Chart] = []
    if cdf := of("cdf"):
        series = {t: (c["error_px"], c["share_below"]) for t, c in cdf.items()}
        result.append(charts.cdf_chart(series))
    if boxes := of("pair_rmse_box_px"):
        result.append(charts.box_chart(boxes))
    if errors := of("error_px"):
        result.append(error_histogram(errors, title="L2 error of each query"))
    for name, title, quantity, counted in (
        ("normalised_error", "Normalised pair distance", "error", "answers"),
        ("normalised_pair_rmse", "Normalised RMSE of each pair", "RMSE", "pairs"),
    ):
        if shares := of(name):
            labels = Labels(title, f"{quantity} / image diagonal", f"share of {counted}")
            edges = next(iter(shares.values()))["edges"]
            shares_of = {tier: curve["share"] for tier, curve in shares.items()}
            result.append(charts.histogram_chart(shares_of, edges, labels))
    if times := of("rmse_over_time"):
        labels = Labels("RMSE since the query", "frames since the query", "RMSE, px")
        series = {t: (c["frames"], c["rmse_px"]) for t, c in times.items()}
        result.append(charts.line_chart(series, labels))
    if reliability := of("reliability"):
        radius = next(iter(reliability.values()))["radius_px"]
        result.append(charts.reliability_chart(reliability, radius_px=radius))
    if sparse := of("sparsification"):
        result.append(charts.sparsification_chart(sparse))
    return result
