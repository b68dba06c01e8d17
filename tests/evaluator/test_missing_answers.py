"""Leaving out answers with --allow-missing never improves a metric."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pliant.evaluator import evaluate, read_protocol
from pliant.evaluator.report.cells import heading
from pliant.spec.tables import ANSWERS_OPTIONAL


@pytest.fixture(scope="module")
def episodes(scene_maker: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Episodes with images, so that every family of metrics has a value."""
    root = tmp_path_factory.mktemp("episodes") / "data"
    return scene_maker(root, frames=3, temporal=True, queries=60, sources=2)


def answers(scene: Any, kind: str) -> tuple[pa.Table, np.ndarray]:
    """Return answers inside the image, a quarter of them far off, and their errors."""
    rng = np.random.default_rng(5)
    uv = scene.true_px + rng.normal(0, 3, (scene.rows, 2))
    far = rng.random(scene.rows) < 0.25
    uv[far] = rng.uniform(0, (160, 120), (far.sum(), 2))
    uv = np.clip(uv, 0, (160, 120))
    table = scene.table(uv, visible=rng.uniform(0, 1, scene.rows).astype(np.float32))
    spread = np.exp(rng.normal(1, 1, scene.rows)) + 0.6
    if kind == "sigma":
        table = table.append_column("sigma", pa.array(spread.astype(np.float32)))
    else:
        modes = [
            [
                {"u": u, "v": v, "sigma": s, "weight": 0.8},
                {"u": 80, "v": 60, "sigma": 30, "weight": 0.2},
            ]
            for (u, v), s in zip(uv, spread, strict=True)
        ]
        column = pa.array(modes, ANSWERS_OPTIONAL.field("modes").type)
        table = table.append_column("modes", column)
    return table, np.hypot(*(uv - scene.true_px).T)


@pytest.mark.parametrize("kind", ["sigma", "modes"])
@pytest.mark.parametrize("share", [0.01, 0.5])
def test_leaving_out_the_hardest_rows_improves_nothing(
    kind: str, share: float, episodes: Any, tmp_path: Path
) -> None:
    table, error_px = answers(episodes, kind)
    keep = np.sort(np.argsort(error_px)[: round(episodes.rows * (1 - share))])
    whole, part = (
        evaluate(
            episodes.submit(tmp_path / f"{len(rows)}.parquet", rows), episodes.root,
            allow_missing=True,
        )
        for rows in (table, table.take(pa.array(keep)))
    )  # fmt: skip
    assert part.document["coverage"] == pytest.approx(1 - share, abs=0.005)
    judged = set()
    for group in ("overall", "cloth", "rope"):
        before = whole.overall if group == "overall" else whole.tiers[group]
        after = part.overall if group == "overall" else part.tiers[group]
        for metric, value in before.items():
            better = heading(metric, {"protocol": "standard"}).better
            if better == "neither" or value is None:
                continue
            judged.add(metric)
            found = after[metric]
            assert found is not None, (group, metric)
            gain = value - found if better == "lower" else found - value
            assert gain <= 1e-9, (group, metric, value, found)
    assert set(read_protocol("standard").headline) <= judged
    assert {"jitter_px", "geodesic_mean_m", "flip_rate", "ece", "ause", "mode_recall"} <= judged


def test_nothing_answered_is_the_worst_value(episodes: Any, tmp_path: Path) -> None:
    table, _ = answers(episodes, "sigma")
    path = episodes.submit(tmp_path / "none.parquet", table.slice(0, 0))
    worst = evaluate(path, episodes.root, allow_missing=True).overall
    diagonal = 200.0
    expected = {
        "rmse_px": diagonal, "median_px": diagonal, "pck_32px": 0, "aj": 0, "oa": 0,
        "jump_rate": 1, "flip_rate": 1, "point_flip_rate": 1, "off_object_rate": 1,
        "jitter_px": 2 * diagonal, "nll": np.log(160 * 120 / 0.001), "ece": 1, "mode_recall": 0,
    }  # fmt: skip
    for metric, value in expected.items():
        assert worst[metric] == pytest.approx(value), metric
