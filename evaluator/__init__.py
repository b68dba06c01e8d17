"""Scores submissions by a named protocol; needs neither torch, Blender nor OpenCV."""

from __future__ import annotations

from pathlib import Path

from pliant.evaluator.evaluate import evaluate, evaluate_answers
from pliant.evaluator.protocols.protocol import PROTOCOL_NAMES, read_protocol
from pliant.evaluator.scores import Scores, read_scores
from pliant.evaluator.submission.loading import check, inspect
from pliant.spec.dataset import Dataset

__all__ = [
    "PROTOCOL_NAMES",
    "Scores",
    "check",
    "evaluate",
    "evaluate_answers",
    "inspect",
    "read_protocol",
    "read_scores",
    "write_report",
]


def write_report(
    scores: Scores, out_dir: Path | str, *, data: Dataset | Path | str | None = None
) -> None:
    """Write scores.json, per_pair.parquet and report.html; see `report.write_report`.

    Examples:
        >>> scores = pliant.evaluate("sample", pliant.predict("sample", "centroid"))
        >>> pliant.evaluator.write_report(scores, "report", data="sample")
        >>> sorted(path.name for path in Path("report").iterdir())
        ['per_pair.parquet', 'report.html', 'scores.json']
    """
    # Imported here: scoring alone needs no templates.
    from pliant.evaluator.report.report import write_report as write

    write(scores, out_dir, data=data)
