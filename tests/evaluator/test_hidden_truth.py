"""An attack that reads a hidden answer off two scores, before and after the protection."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.cli.main import run
from pliant.evaluator import evaluate
from pliant.evaluator.scores import public_scores, read_scores

CENTRE = np.array([80.0, 60.0])


def recovered_u_px(scene: Any, folder: Path, row: int, score: Callable[[Path], float]) -> float:
    """Solve two RMSEs for the true u of one visible query.

    All answers are the centre; in the second submission one is at u = 1e6.
    """
    uv = np.tile(CENTRE, (scene.rows, 1))
    plain = score(scene.submit(folder / "a.parquet", scene.table(uv)))
    uv[row, 0] = 1e6
    moved = score(scene.submit(folder / "b.parquet", scene.table(uv)))
    change = (moved**2 - plain**2) * scene.visible.sum()  # (1e6 - t)^2 - (80 - t)^2
    return float((1e12 - CENTRE[0] ** 2 - change) / (2 * (1e6 - CENTRE[0])))


def test_two_scores_no_longer_tell_an_answer(scene: Any, tmp_path: Path) -> None:
    row = int(np.flatnonzero(scene.visible)[7])
    true_u = scene.true_px[row, 0]

    def open_score(path: Path) -> float:
        return float(evaluate(path, scene.root, protocol="paper").overall["rmse_px"] or 0)

    def hidden_score(path: Path) -> float:
        scores = public_scores(evaluate(path, scene.root, protocol="paper", hide_truth=True))
        return float(scores.overall["rmse_px"] or 0)

    assert recovered_u_px(scene, tmp_path, row, open_score) == pytest.approx(true_u, abs=0.001)
    assert abs(recovered_u_px(scene, tmp_path, row, hidden_score) - true_u) > 1000


def far_off(scene: Any, path: Path) -> Path:
    uv = scene.true_px + np.array([3.0, 4.0])
    uv[::5] = (1e6, -1e6)
    sigma = np.full(scene.rows, 2.0, np.float32)
    return scene.submit(path, scene.table(uv, sigma=sigma))


def test_no_error_passes_the_diagonal(scene: Any, tmp_path: Path) -> None:
    path = far_off(scene, tmp_path / "s.parquet")
    capped = evaluate(path, scene.root, hide_truth=True).overall
    far = np.arange(scene.rows) % 5 == 0
    squares = np.where(far, 200.0**2, 25.0)[scene.visible]
    assert capped["rmse_px"] == pytest.approx(np.sqrt(squares.mean()), rel=1e-6)
    assert capped["p95_px"] == pytest.approx(200)
    near = scene.table(scene.true_px + 3)
    plain, hidden = (
        scene.score(tmp_path, near, protocol="paper", hide_truth=hide).overall
        for hide in (False, True)
    )
    assert plain == pytest.approx(hidden, rel=1e-6)


def test_participants_see_rounded_headline_metrics_only(scene: Any, tmp_path: Path) -> None:
    whole = evaluate(far_off(scene, tmp_path / "s.parquet"), scene.root, hide_truth=True)
    public = public_scores(whole)
    document = public.document
    headline = document["headline"]
    assert set(document["overall"]) == set(headline)
    assert all(set(values) == {headline[0]} for values in document["tiers"].values())
    for name, value in document["overall"].items():
        if value is not None:
            assert value == pytest.approx(whole.overall[name], rel=5e-4)
            assert len(f"{value:.15g}".replace(".", "").replace("-", "").strip("0")) <= 4
    assert (document["curves"], document["slices"], public.per_pair.num_rows) == ({}, {}, 0)
    assert not any(document["intervals"]["tiers"].values())
    assert document["intervals"]["overall"] == {}


def test_evaluate_prints_what_participants_may_see(
    scene: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = far_off(scene, tmp_path / "s.parquet")
    public = public_scores(evaluate(path, scene.root, hide_truth=True))
    call = ["evaluate", str(path), "--data", str(scene.root), "--hide-truth"]
    assert run([*call, "--json"]) == 0
    assert json.loads(capfd.readouterr().out) == json.loads(json.dumps(public.document))
    assert run([*call, "--out", str(tmp_path / "report")]) == 0
    printed = re.findall(r"\d+\.\d{3,}", capfd.readouterr().out)
    assert not [each for each in printed if len(each.lstrip("0.").replace(".", "")) > 4]
    assert read_scores(tmp_path / "report").per_pair.num_rows  # the host's, for ranks
