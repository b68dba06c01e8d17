"""Summary sentences about scores, for reports, leaderboards and comparisons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.metrics.base import OVERALL
from pliant.evaluator.metrics.causes import CAUSES
from pliant.evaluator.report.cells import Heading, format_rounded

_WORTH_NAMING: Final = 0.05
"""Causes of less of the squared error than this are not named."""


def report_verdict(document: Mapping[str, Any]) -> list[str]:
    """Return sentences about one method: how far off, against controls, and why.

    Args:
        document: The content of scores.json.
    """
    values, method = document["overall"], document["submission"]["method"]["name"]
    sentences = []
    if values.get("rmse_px") is not None:
        written = format_rounded if "rounded" in document else "{:.1f}".format
        text = f"The RMSE is {written(values['rmse_px'])} px"
        if values.get("median_px") is not None:
            text += f", and half of the answers are within {written(values['median_px'])} px"
        sentences.append(text + ".")
    if method in CONTROLS:
        about = CONTROLS[method]
        sentences.append(f"This is a control, {about}: methods are compared with it, not ranked.")
    elif "controls" in document["notes"]:
        note = document["notes"]["controls"].replace("`", "")
        sentences.append(f"{note[:1].upper()}{note[1:]}.")
    elif document["submission"]["kind"] == "answers" and not document.get("hide_truth"):
        sentences.append(
            "No control is better: answering with the query's own pixel, with the middle of the "
            "object, or with a random place on it."
        )
    if "causes" in document:
        sentences += cause_sentences(document["causes"][OVERALL])
    return sentences


def cause_sentences(found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return a sentence with the causes of most of the squared error, none without an error.

    Args:
        found: Cause -> its figures, as in scores.json.
    """
    shares = {
        cause.label: share
        for cause in CAUSES
        if (share := found[cause.name]["squared_error_share"] or 0) >= _WORTH_NAMING
    }
    named = sorted(shares.items(), key=lambda item: -item[1])
    parts = [f"{label.lower()} {share * 100:.0f} %" for label, share in named]
    return [f"Causes of the squared error: {', '.join(parts)}."] if parts else []


def board_verdict(
    values: Mapping[str, float | None],
    controls: Mapping[str, float | None],
    shown: Heading,
) -> str:
    """Return a sentence about several methods against the best control; empty without one.

    Args:
        values: Name of a method -> its value over the split, or None.
        controls: The same of the controls, by the names of `CONTROLS`; others are left out.
        shown: The heading of the metric.
    """
    if shown.better == "neither":
        return ""
    methods = {name: value for name, value in values.items() if value is not None}
    bars = {
        name: value
        for name in CONTROLS
        if name != "oracle" and (value := controls.get(name)) is not None
    }
    if not bars or not methods:
        return ""
    control = min(bars, key=lambda name: shown.rank_key(bars[name]))
    bar = f"{CONTROLS[control]} ({shown.label} {_with_unit(shown, bars[control])})"
    best = min(methods, key=lambda name: shown.rank_key(methods[name]))
    beaten = shown.rank_key(bars[control])
    better = [name for name in methods if shown.rank_key(methods[name]) < beaten]
    if not better:
        return (
            f"No method beats {bar}; the nearest is {best} with {_with_unit(shown, methods[best])}."
        )
    if len(better) == len(methods) > 1:
        every = "Both methods" if len(methods) == 2 else f"All {len(methods)} methods"
        start = f"{every} beat {bar}"
        return f"{start}; the best is {best} with {_with_unit(shown, methods[best])}."
    named = joined([f"{name} ({_with_unit(shown, methods[name])})" for name in better])
    beat = "beats" if len(better) == 1 else "beat"
    text = f"{named} {beat} {bar}"
    others = [name for name in methods if name not in better]
    do_not = "does not" if len(others) == 1 else "do not"
    return text + (f"; {joined(others)} {do_not}." if others else ".")


def joined(words: Sequence[str]) -> str:
    """Return words as a list in a sentence."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _with_unit(shown: Heading, value: float) -> str:
    return f"{shown.written(value)} {shown.unit}".strip()
