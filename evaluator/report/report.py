"""Writes a report: scores.json, per_pair.parquet and one self-contained HTML page."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Final

import jinja2
import jsonschema

from pliant.evaluator.protocols.protocol import read_protocol
from pliant.evaluator.report import plots
from pliant.evaluator.report.drawings import pair_svg
from pliant.evaluator.report.wording import (
    about,
    facts,
    interval_text,
    label,
    match_coverage_text,
    written,
    written_unit,
)
from pliant.evaluator.scores import (
    PER_PAIR_TABLE,
    REPORT_HTML,
    SCORES_JSON,
    Scores,
    scores_schema,
)
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.text import shown

_ARROWS: Final = {"lower": "\u00a0↓", "higher": "\u00a0↑", "neither": ""}

_FEW_SEQUENCES: Final = 30
"""With fewer sequences, intervals of figures with many outliers are too narrow."""


def write_report(
    scores: Scores, out_dir: Path | str, *, data: Dataset | Path | str | None = None
) -> None:
    """Write scores.json, per_pair.parquet and report.html.

    Args:
        scores: From `evaluate`.
        out_dir: The report's folder: new, empty, or an earlier report, which is replaced.
        data: The dataset, for the pictures; without it (or its images) panels stay plain.

    Raises:
        CallError: The folder holds something else, or cannot be written.
    """
    folder = Path(out_dir)
    check_out_dir(folder)
    jsonschema.validate(scores.document, scores_schema())
    dataset = Dataset.open(data) if isinstance(data, Path | str) else data
    page = render_report(scores, dataset)
    # Written beside its place and moved there file by file: nothing is ever half-written.
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".pliant-", dir=folder) as temporary:
        staging = Path(temporary)
        scores.write(staging)
        (staging / REPORT_HTML).write_text(page, encoding="utf-8")
        for name in (PER_PAIR_TABLE, REPORT_HTML, SCORES_JSON):
            shutil.move(staging / name, folder / name)


def check_out_dir(folder: Path) -> None:
    """Refuse a folder that holds something other than a report.

    Raises:
        CallError: It is a file, or holds other files.
    """
    if folder.exists() and not folder.is_dir():
        raise CallError("the report needs a folder", path=folder, found="a file")
    known = {SCORES_JSON, PER_PAIR_TABLE, REPORT_HTML}
    others = (
        sorted(p.name for p in folder.iterdir() if p.name not in known) if folder.exists() else []
    )
    if others:
        raise CallError(
            "the folder holds something other than a report",
            path=folder,
            found=", ".join(others[:5]),
            fix="Give a new folder.",
        )


def template_environment() -> jinja2.Environment:
    """Return the environment of the page templates; everything is escaped unless marked safe."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("pliant.evaluator.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=shown,
        trim_blocks=True,
    )


def page_style() -> str:
    """Return the style sheet that every page carries inside."""
    folder = resources.files("pliant.evaluator.report")
    return (folder / "templates" / "style.css").read_text("utf-8")


def render_report(scores: Scores, dataset: Dataset | None = None) -> str:
    """Return the report as one HTML page that needs nothing from outside."""
    document = scores.document
    groups = {"overall": document["overall"], **document["tiers"]}
    if len(groups) == 2:  # one tier alone says the same twice
        groups.pop("overall")
    protocol = read_protocol(document["protocol"])
    size = tuple(document["dataset"]["image_size"])
    return (
        template_environment()
        .get_template("report.html.j2")
        .render(
            d=document,
            style=page_style(),
            method=scores.method,
            kind=document["submission"]["kind"],
            summary=_summary(document),
            headline=[_metric(name, document) for name in document["headline"]],
            headline_rows=[
                {
                    "name": name,
                    "overall": name == "overall",
                    "cells": [_cell(document, name, m, values) for m in document["headline"]],
                }
                for name, values in groups.items()
            ],
            no_interval=any(count < 2 for count in document["counts"]["sequences"].values()),
            narrow_interval=any(
                count < _FEW_SEQUENCES for count in document["counts"]["sequences"].values()
            ),
            notes=sorted(document["notes"].items()),
            plots=report_plots(document),
            pictures=[
                {
                    "svg": pair_svg(example, dataset, (size[0], size[1])),
                    "tier": example.tier,
                    "rank": example.rank,
                    "pair": example.pair,
                    "rmse": f"{example.rmse_px:.1f}",
                    "frames": f"{example.sequence_a} frame {example.frame_a} to "
                    f"{example.sequence_b} frame {example.frame_b}",
                }
                for example in scores.examples
            ],
            slices=[_slice(name, rows) for name, rows in document["slices"].items()],
            groups=list(groups),
            metrics=[
                {
                    **_metric(name, document),
                    "cells": [
                        _cell(document, group, name, values) for group, values in groups.items()
                    ],
                }
                for name in document["overall"]
            ],
            facts=facts(document),
            protocol_text=json.dumps(protocol.document, indent=1),
        )
    )


def _summary(document: Mapping[str, Any]) -> str:
    counts = document["counts"]
    what = "queries" if document["submission"]["kind"] == "answers" else "matches"
    return (
        f"{counts['counted']:,} visible {what} in {counts['pairs']:,} image pairs of "
        f"{counts['sequences']['overall']:,} sequences."
    )


def _metric(name: str, document: Mapping[str, Any]) -> dict[str, str]:
    words, unit, better = about(name, document["protocol"])
    return {
        "label": label(name),
        "about": words,
        "unit": written_unit(unit),
        "arrow": _ARROWS[better],
    }


def _cell(
    document: Mapping[str, Any], group: str, metric: str, values: Mapping[str, float | None]
) -> dict[str, str]:
    intervals = document["intervals"]
    found = intervals["overall"] if group == "overall" else intervals["tiers"].get(group, {})
    _, unit, _ = about(metric, document["protocol"])
    return {
        "value": written(values.get(metric), unit),
        "interval": interval_text(found.get(metric), unit),
        "coverage": match_coverage_text(document, group, metric),
    }


def _slice(name: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    metrics = [key for key in rows[0] if key not in ("slice", "queries")]
    return {
        "name": name,
        "heads": ["Queries", *(_head(key) for key in metrics)],
        "rows": [
            {
                "name": row["slice"],
                "cells": [
                    f"{row['queries']:,}",
                    *(written(row[key], "px" if key.endswith("_px") else "") for key in metrics),
                ],
            }
            for row in rows
        ],
    }


def _head(metric: str) -> str:
    return label(metric) + (", px" if metric.endswith("_px") else "")


def error_histogram(curves: Mapping[str, Mapping[str, Any]], *, title: str) -> str:
    """Draw L2 histograms over each other, with the share beyond the axis in the legend.

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
    return plots.histogram_svg(series, longest["edges_px"], title=title)


def report_plots(document: Mapping[str, Any]) -> list[str]:
    """Return the plots of a report as SVG, one series a tier.

    Args:
        document: What scores.json holds.
    """
    curves = document["curves"]
    tiers = [tier for tier in document["tiers"] if tier in curves] or list(curves)

    def of(name: str) -> dict[str, Any]:
        return {tier: curves[tier][name] for tier in tiers if name in curves[tier]}

    result: list[str] = []
    cdf = of("cdf")
    if cdf:
        result.append(plots.cdf_svg({t: (c["error_px"], c["share_below"]) for t, c in cdf.items()}))
    boxes = of("pair_rmse_box_px")
    if boxes:
        result.append(plots.box_svg(boxes, title="RMSE of the image pairs"))
    errors = of("error_px")
    if errors:
        result.append(error_histogram(errors, title="L2 error of each query"))
    errors = of("normalised_error")
    if errors:
        result.append(
            plots.histogram_svg(
                {tier: curve["share"] for tier, curve in errors.items()},
                next(iter(errors.values()))["edges"],
                title="Normalised pair distance",
                xlabel="error / image diagonal",
            )
        )
    pairs = of("normalised_pair_rmse")
    if pairs:
        result.append(
            plots.histogram_svg(
                {tier: curve["share"] for tier, curve in pairs.items()},
                next(iter(pairs.values()))["edges"],
                title="Normalised RMSE of each pair",
                xlabel="RMSE / image diagonal",
                ylabel="share of pairs",
            )
        )
    times = of("rmse_over_time")
    if times:
        result.append(plots.time_svg({t: (c["frames"], c["rmse_px"]) for t, c in times.items()}))
    reliability = of("reliability")
    if reliability:
        radius = next(iter(reliability.values()))["radius_px"]
        result.append(plots.reliability_svg(reliability, radius_px=radius))
    sparse = of("sparsification")
    if sparse:
        result.append(plots.sparsification_svg(sparse))
    return result
