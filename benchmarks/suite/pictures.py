"""The pictures of a benchmark's report: frames, histograms of errors, the best matches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from PIL import Image

from pliant.benchmarks.suite.config import TRACKS, BenchmarkConfig
from pliant.benchmarks.suite.table import Row
from pliant.benchmarks.suite.work import Workspace
from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.report.best_matches import best_matches
from pliant.evaluator.report.cells import cause_bars
from pliant.evaluator.report.contact_sheet import contact_sheet
from pliant.evaluator.report.report import error_histogram
from pliant.evaluator.scores import read_scores
from pliant.spec.arrays import Rgb
from pliant.spec.dataset import Dataset
from pliant.spec.io.photo import encoded
from pliant.spec.queries import QueryPair

_FRAMES_SHOWN: Final = 6


def set_pictures(
    config: BenchmarkConfig, work: Workspace, rows: Sequence[Row]
) -> list[dict[str, Any]]:
    """Return the pictures of every test with pairs: of its first variant, in its first track.

    Returns:
        Of each test what the report's template shows: `name`, `facts` (how much it asks),
        `frames_png`, `histogram` (errors of the methods), `matches` (caption and SVG of the best
        keypoint matches of each method that has some), `bars` (causes of the errors).
    """
    found = []
    for key, test in config.tests.items():
        variant, track = next(iter(test.variants)), test.tracks[0]
        mine = [
            row
            for row in rows
            if row.place == (key, variant, track)
            and not row.entry.is_blank
            and "standard" in row.scores
        ]
        if mine:
            name = f"{test.title} ({TRACKS[track]})"
            found.append(_of_test(work, test.tier, name, mine))
    return found


def _of_test(work: Workspace, tier: str, name: str, rows: Sequence[Row]) -> dict[str, Any]:
    dataset = Dataset.open(work.set_path(rows[0].set))
    pairs = [pair for pair in dataset.pairs("test") if pair.source.sequence.tier == tier]
    sequences = [each for each in dataset.sequences if each.tier == tier]
    frames = sum(each.frames for each in sequences)
    # Of the controls, `random` alone: what an answer on the object costs.
    shown = [row for row in rows if row.method not in CONTROLS or row.method == "random"] or rows
    paths = [work.scores_path(row.set, row.entry.stored, "standard") for row in shown]
    reports = [read_scores(path) for path in paths]
    labels = [row.label for row in shown]
    curves = {
        label: report.document["curves"][tier]["error_px"]
        for label, report in zip(labels, reports, strict=True)
    }
    matched = [row for row in rows if "matches" in row.scores]
    return {
        "name": name,
        "facts": f"{len(sequences)} sequences, {frames} images, {len(pairs)} pairs, "
        f"{sum(map(len, pairs))} queries. Queries: sha256 {dataset.queries_sha256('test')}.",
        "frames_png": _png(contact_sheet(dataset, sequences, count=_FRAMES_SHOWN)),
        "histogram": error_histogram(curves, title=f"Errors on {name}"),
        "matches": [_matches(work, dataset, row, pairs[0]) for row in matched],
        "bars": cause_bars(reports, labels, tier),
    }


def _matches(work: Workspace, dataset: Dataset, row: Row, pair: QueryPair) -> tuple[str, str]:
    submission = work.answers_path(row.set, row.entry.stored, "matches")
    words, svg = best_matches(dataset, pair, submission)
    return f"{row.label}: {words}", svg


def _png(image: Rgb) -> bytes:
    """Return a PNG whose white parts are transparent, so that it fits a dark page too."""
    alpha = np.where((image == 255).all(axis=2), 0, 255).astype(np.uint8)
    return encoded(Image.fromarray(np.dstack([image, alpha])), "PNG", optimize=True)
