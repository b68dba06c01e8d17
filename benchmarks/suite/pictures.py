"""The pictures of a benchmark's report: the pair it opens with, frames, errors, best matches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from PIL import Image

from pliant.benchmarks.suite.config import TRACKS, BenchmarkConfig
from pliant.benchmarks.suite.table import CLASSICAL, Row
from pliant.benchmarks.suite.work import Workspace
from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.report.best_matches import best_matches
from pliant.evaluator.report.cells import cause_bars
from pliant.evaluator.report.contact_sheet import contact_sheet
from pliant.evaluator.report.report import error_histogram
from pliant.evaluator.scores import read_scores
from pliant.spec.arrays import FloatArray, Rgb
from pliant.spec.dataset import Dataset
from pliant.spec.io.photo import encoded
from pliant.spec.queries import QueryPair
from pliant.viewer.explorer.pair_page import pair_section


def opening(config: BenchmarkConfig, work: Workspace, rows: Sequence[Row]) -> dict[str, Any] | None:
    """Return the pair on which a network most clearly beats the best local feature.

    Args:
        config: The benchmark.
        work: The benchmark's folder.
        rows: Its table.

    Returns:
        What the report's template shows: `verdict` (the result in one sentence), `pair` (the
        explorer of the pair), `caption` (errors on the pair), `row` (the network's), `data` (folder
        of the dataset in the benchmark's), `bars` (method, RMSE in px, whether it is a control; the
        smallest first). None where no network, or no local feature, answered, or no network is
        better on a pair.
    """
    best: tuple[float, int, Row, Row, FloatArray, FloatArray] | None = None
    for learned in (row for row in rows if row.learned and not row.entry.is_blank):
        rivals = [
            (value, row)
            for row in rows
            if row.place == learned.place
            and row.method in CLASSICAL
            and (value := row.value("standard", "rmse_px")) is not None
        ]
        if not rivals:
            continue
        _, rival = min(rivals, key=lambda each: each[0])
        mine, theirs = (_pair_rmse_px(work, row) for row in (learned, rival))
        gain = np.where(mine > 0, theirs / np.maximum(mine, 4.0), 0.0)
        pair = int(np.nanargmax(gain))
        if gain[pair] > 1 and (best is None or gain[pair] > best[0]):
            best = float(gain[pair]), pair, learned, rival, mine, theirs
    if best is None:
        return None
    _, pair, learned, rival, mine, theirs = best
    dataset = Dataset.open(work.set_path(learned.set))
    submissions = {
        row.label: work.answers_path(row.set, row.entry.stored, "answers")
        for row in (learned, rival)
    }
    explorer = pair_section(dataset, dataset.pairs("test")[pair], submissions)
    caption = (
        f"RMSE on this pair: {learned.label} {mine[pair]:.1f} px, "
        f"{rival.label} {theirs[pair]:.1f} px"
    )
    shown = [
        (row.label, value, row.method in CONTROLS)
        for row in rows
        if row.place == learned.place
        and not row.entry.is_blank
        and (value := row.value("standard", "rmse_px")) is not None
    ]
    bars = sorted(shown, key=lambda bar: bar[1])
    found = {label: value for label, value, _ in bars}
    place = f"{config.tests[learned.test].title}, {TRACKS[learned.entry.track]}"
    verdict = (
        f"{place}: {learned.method} is off by {found[learned.label]:.0f} px (RMSE); "
        f"the best local feature, {rival.label}, by {found[rival.label]:.0f} px"
    )
    oracle = {row.label for row in rows if row.method == "oracle"}
    control = next((bar for bar in bars if bar[2] and bar[0] not in oracle), None)
    verdict += f"; the best control, {control[0]}, by {control[1]:.0f} px." if control else "."
    data = work.set_path(learned.set).relative_to(work.root).as_posix()
    return {
        "verdict": verdict, "pair": explorer, "caption": caption, "row": learned, "data": data,
        "bars": bars,
    }  # fmt: skip


def _pair_rmse_px(work: Workspace, row: Row) -> FloatArray:
    """Return the RMSE of each pair, float64 (P,), NaN where no point is visible."""
    scores = read_scores(work.scores_path(row.set, row.entry.stored, "standard"))
    table, tiers = scores.per_pair, scores.tiers
    squared, counted = (table[name].to_numpy() for name in ("sum_squared_px2", "counted"))
    mine = np.array(table["tier"].to_pylist()) == row.test if row.test in tiers else True
    rmse: FloatArray = np.sqrt(squared / np.where((counted > 0) & mine, counted, np.nan))
    return rmse


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
