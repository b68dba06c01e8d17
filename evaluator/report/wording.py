"""How figures are written for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pliant.evaluator.protocols.protocol import read_protocol
from pliant.evaluator.statistics.ratios import Ratio, ratios_of

_OTHERS: Final = {
    "median_px": ("median error", "px", "lower"),
    "ece": ("expected calibration error of P(error within the radius)", "", "lower"),
    "ause": ("area under the sparsification error", "", "lower"),
}


def ratios_by_name(protocol: str) -> dict[str, Ratio]:
    """Return the ratios of a protocol by name."""
    return {ratio.name: ratio for ratio in ratios_of(read_protocol(protocol).metrics)}


def about(metric: str, protocol: str) -> tuple[str, str, str]:
    """Return what a metric is, its unit and its better direction."""
    ratio = ratios_by_name(protocol).get(metric)
    if ratio is not None:
        return ratio.about, ratio.unit, ratio.better
    if metric in _OTHERS:
        return _OTHERS[metric]
    if metric.startswith("stretch_p"):
        words = f"{metric[9:]} % quantile of the stretch between neighbours, target over source"
        return words, "", "lower"
    if metric.startswith("p") and metric.endswith("_px"):
        return f"{metric[1:-3]} % quantile of the error", "px", "lower"
    return metric, "", "neither"


def label(metric: str) -> str:
    """Return a metric's name for a table's head."""
    names = {
        "rmse_px": "RMSE",
        "rmse_px_mean_over_pairs": "RMSE, mean over pairs",
        "symmetric_rmse_px": "RMSE, symmetry-aware",
        "mean_px": "Mean error",
        "median_px": "Median error",
        "aj": "AJ",
        "oa": "OA",
        "delta_avg": "δ avg",
        "nll": "NLL",
        "ece": "ECE",
        "ause": "AUSE",
    }
    if metric in names:
        return names[metric]
    text = metric.removesuffix("_mean_over_pairs")
    over = ", mean over pairs" if text != metric else ""
    if text.startswith("pck_"):
        threshold = text[4:].replace("px", " px").replace("box", " box")
        return f"PCK {threshold}{over}"
    if text.startswith("rmse_px_after_"):
        return f"RMSE after {text.removeprefix('rmse_px_after_')} frames"
    text = text.removesuffix("_px").removesuffix("_m").replace("_", " ")
    return text[:1].upper() + text[1:] + over


def facts(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the provenance of scores as (name, text) for people."""
    dataset, submission = document["dataset"], document["submission"]
    counts = document["counts"]
    rows = [
        ("Protocol", f"{document['protocol']} {document['protocol_version']}"),
        ("Protocol sha256", document["protocol_sha256"]),
        ("Dataset", f"{dataset['id']} {dataset['version']}, split {document['split']}"),
        ("Queries sha256", dataset["queries_sha256"]),
        ("Truth sha256", dataset["truth_sha256"] or "not used"),
        ("Submission", f"{submission['file']} ({submission['rows']:,} rows)"),
        ("Submission sha256", submission["sha256"]),
        ("Counted", f"{counts['counted']:,} in {counts['pairs']:,} pairs"),
    ]
    rows += [
        (f"Method: {key}", str(value))
        for key, value in submission["method"].items()
        if key != "name"
    ]
    tools = ", ".join(f"{name} {version}" for name, version in document["tools"].items())
    return [*rows, ("Computed with", tools)]
