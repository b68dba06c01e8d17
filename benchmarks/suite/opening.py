"""What a report opens with: a verdict, one pair, and the errors of all methods as bars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pyarrow.compute as pc

from pliant.benchmarks.suite.config import TRACKS, BenchmarkConfig
from pliant.benchmarks.suite.table import CLASSICAL, Row
from pliant.benchmarks.suite.work import Workspace
from pliant.evaluator.controls import CONTROLS
from pliant.evaluator.examples import Example
from pliant.evaluator.metrics.causes import NO_CAUSE
from pliant.evaluator.report.drawings import FramePictures, pair_svg
from pliant.evaluator.scores import read_scores
from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import read_table

_QUERIES: Final = 16


@dataclass(frozen=True)
class Opening:
    """The first screen.

    Attributes:
        verdict: The result, in one sentence.
        definitions: SVG images that the pictures use.
        pictures: (caption, SVG) of the network and of the local feature.
        row: The network's row of the table.
        data: Folder of the dataset, relative to the benchmark's.
        bars: (method, RMSE in px, whether it is a control), the smallest first.
    """

    verdict: str
    definitions: str
    pictures: list[tuple[str, str]]
    row: Row
    data: str
    bars: list[tuple[str, float, bool]]


def opening(config: BenchmarkConfig, work: Workspace, rows: Sequence[Row]) -> Opening | None:
    """Return the pair on which a network most clearly beats the best local feature.

    Args:
        config: The benchmark.
        work: The benchmark's folder.
        rows: Its table.

    Returns:
        None where no network, or no local feature, answered, or no network is better on a pair.
    """
    best: tuple[float, int, Row, Row, FloatArray, FloatArray] | None = None
    for learned in (row for row in rows if row.learned and not row.entry.is_blank):
        rivals = [
            row for row in rows
            if (row.test, row.variant, row.entry.track)
            == (learned.test, learned.variant, learned.entry.track)
            and row.method in CLASSICAL
        ]  # fmt: skip
        known = [row for row in rivals if row.value("standard", "rmse_px") is not None]
        if not known:
            continue
        rival = min(known, key=lambda row: row.value("standard", "rmse_px") or 0.0)
        mine, theirs = (_pair_rmse_px(work, row) for row in (learned, rival))
        gain = np.where(mine > 0, theirs / np.maximum(mine, 4.0), 0.0)
        pair = int(np.nanargmax(gain))
        if gain[pair] > 1 and (best is None or gain[pair] > best[0]):
            best = float(gain[pair]), pair, learned, rival, mine, theirs
    if best is None:
        return None
    _, pair, learned, rival, mine, theirs = best
    dataset = Dataset.open(work.set_path(learned.set))
    frames = FramePictures(dataset, dataset.size)
    pictures = [
        (
            f"{row.label}: RMSE {errors[pair]:.1f} px",
            pair_svg(_example(work, dataset, row, pair), frames),
        )
        for row, errors in ((learned, mine), (rival, theirs))
    ]
    shown = [
        (row.label, value, row.method in CONTROLS)
        for row in rows
        if (row.test, row.variant, row.entry.track)
        == (learned.test, learned.variant, learned.entry.track)
        and not row.entry.is_blank
        and (value := row.value("standard", "rmse_px")) is not None
    ]
    bars = sorted(shown, key=lambda bar: bar[1])
    found = {label: value for label, value, _ in bars}
    place = f"{config.tests[learned.test].title}, {TRACKS[learned.entry.track]}"
    verdict = (
        f"{place}: {learned.method} misses by {found[learned.label]:.0f} px (RMSE), "
        f"the best local feature, {rival.label}, by {found[rival.label]:.0f} px"
    )
    oracle = {row.label for row in rows if row.method == "oracle"}
    control = next((bar for bar in bars if bar[2] and bar[0] not in oracle), None)
    verdict += f", the best control, {control[0]}, by {control[1]:.0f} px." if control else "."
    data = work.set_path(learned.set).relative_to(work.root).as_posix()
    return Opening(verdict, frames.definitions(), pictures, learned, data, bars)


def _pair_rmse_px(work: Workspace, row: Row) -> FloatArray:
    """Return the RMSE of each pair, float64 (P,), NaN where no point is visible."""
    scores = read_scores(work.scores_path(row.set, row.entry.stored, "standard"))
    table, tiers = scores.per_pair, scores.tiers
    squared, counted = (table[name].to_numpy() for name in ("sum_squared_px2", "counted"))
    mine = np.array(table["tier"].to_pylist()) == row.test if row.test in tiers else True
    rmse: FloatArray = np.sqrt(squared / np.where((counted > 0) & mine, counted, np.nan))
    return rmse


def _example(work: Workspace, dataset: Dataset, row: Row, pair: int) -> Example:
    """Return some visible queries of a pair, evenly along their order, with a method's answers."""
    asked, true, given = (
        table.filter(pc.equal(table["pair_id"], pair)).sort_by("query_id")
        for table in (
            dataset.queries("test"),
            dataset.truth("test"),
            read_table(work.answers_path(row.set, row.entry.stored, "answers"), "answers"),
        )
    )
    visible = np.flatnonzero(np.array(true["visibility_b"].to_pylist()) == "visible")
    pick = visible[np.unique(np.linspace(0, len(visible) - 1, _QUERIES).round().astype(int))]
    query, truth, answer = (
        np.stack([table[name].to_numpy()[pick] for name in names], axis=1).astype(np.float64)
        for table, names in ((asked, ("u_a", "v_a")), (true, ("u_b", "v_b")), (given, ("u", "v")))
    )
    first = asked.slice(0, 1).to_pylist()[0]
    return Example(
        rank=1, of=1, tier=first["tier"], pair=pair, sequence_a=first["sequence_a"],
        frame_a=first["frame_a"], sequence_b=first["sequence_b"], frame_b=first["frame_b"],
        rmse_px=0.0, cause="", uv_a_px=query, true_px=truth, answer_px=answer,
        causes=np.full(len(pick), NO_CAUSE, np.uint8),
    )  # fmt: skip
