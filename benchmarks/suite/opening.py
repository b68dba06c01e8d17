"""What a report opens with: a verdict, one pair, and the errors of all methods as bars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pliant.benchmarks.suite.config import TRACKS, BenchmarkConfig
from pliant.benchmarks.suite.table import CLASSICAL, Row
from pliant.benchmarks.suite.work import Workspace
from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.scores import read_scores
from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
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
