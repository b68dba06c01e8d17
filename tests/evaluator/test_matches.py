"""Keypoint matches, scored through the surface images."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pliant.cli.main import run
from pliant.evaluator import Scores, evaluate, inspect, read_scores, write_report
from pliant.evaluator.comparison import differences, method_names, ranks
from pliant.evaluator.report.leaderboard import render_leaderboard
from pliant.spec.errors import CallError, SpecError
from tests.evaluator.figures import figure


def matches_table(pair: Any, uv_a: np.ndarray, uv_b: np.ndarray) -> pa.Table:
    names = ("u_a", "v_a", "u", "v")
    values = np.concatenate([uv_a, uv_b], axis=1).astype(np.float32).T
    columns = dict(zip(names, values, strict=True))
    score = np.ones(len(uv_a), np.float32)
    return pa.table({"pair_id": np.asarray(pair, np.int32), **columns, "score": score})


def true_matches(scene: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pair, source and target positions of the visible queries."""
    seen = scene.visible
    uv_a = np.stack([scene.queries[n].to_numpy() for n in ("u_a", "v_a")], axis=1)
    return scene.pair[seen], uv_a[seen], scene.true_px[seen]


def submitted(scene: Any, folder: Path, table: pa.Table) -> Path:
    path: Path = scene.submit(folder / "m.parquet", table, kind="matches")
    return path


def scored(scene: Any, folder: Path, table: pa.Table, **options: Any) -> Scores:
    return evaluate(submitted(scene, folder, table), scene.root, **options)


def test_true_matches_are_right_to_a_pixel(scene: Any, tmp_path: Path) -> None:
    table = matches_table(*true_matches(scene))
    assert not inspect(submitted(scene, tmp_path, table), scene.root)
    scores = scored(scene, tmp_path, table)
    assert scores.document["protocol"] == "matches"
    assert figure(scores, "rmse_px") < 1.1
    assert scores.overall["match_coverage"] == 1
    # A strip's edge may run through a pixel whose centre misses it.
    assert figure(scores, "on_object_rate") > 0.9
    assert figure(scores, "partner_visible_rate") > 0.95


def test_rates_count_what_does_not_enter_the_error(scene: Any, tmp_path: Path) -> None:
    pair, uv_a, uv_b = true_matches(scene)
    first = pair == 0
    off = np.array([[1.0, 1.0]])  # a corner of the image, never on the object
    table = matches_table(
        [*pair[first], 0, 0],
        np.concatenate([uv_a[first], off, off]),
        np.concatenate([uv_b[first], off, off]),
    )
    scores = scored(scene, tmp_path, table)
    count = first.sum() - 1  # the two matches off the object start in one pixel and count once
    assert scores.overall["on_object_rate"] == pytest.approx((count + 1) / (count + 2), abs=0.02)
    assert scores.overall["match_coverage"] == pytest.approx(1 / 6)
    assert scores.overall["matches_per_pair"] == pytest.approx((count + 2) / 6)
    assert scores.document["coverage"] == pytest.approx(1 / 6)
    assert scores.tiers["rope"]["rmse_px"] is None


def test_repeating_matches_changes_no_figure(scene: Any, tmp_path: Path) -> None:
    """Neither exact copies nor copies moved within the source pixel, in any order of rows."""
    pair, uv_a, uv_b = true_matches(scene)
    good = np.arange(len(pair)) % 2 == 0
    uv_b = np.where(good[:, None], uv_b, uv_b + 30)
    once = matches_table(pair, uv_a, uv_b)
    pixel = np.floor(uv_a[good]) + 0.5
    copies = matches_table(np.repeat(pair[good], 20), *(np.repeat(x, 20, axis=0) for x in (
        pixel + 0.01, uv_b[good])))  # fmt: skip
    copies = copies.set_column(5, "score", pa.array(np.full(len(copies), 0.5, np.float32)))
    more = pa.concat_tables([copies, once, once])
    shuffled = more.take(np.random.default_rng(0).permutation(len(more)))
    first, second = (scored(scene, tmp_path, each).document for each in (once, shuffled))
    assert first["overall"] == second["overall"]
    assert first["counts"] == second["counts"]


def test_each_pixel_keeps_its_best_match(scene: Any, tmp_path: Path) -> None:
    pair, uv_a, uv_b = (x[:1] for x in true_matches(scene))
    table = matches_table(
        np.repeat(pair, 2), np.repeat(uv_a, 2, axis=0), np.concatenate([uv_b + 40, uv_b])
    )
    for score, right in (([0.2, 0.9], True), ([0.9, 0.2], False)):
        of_both = table.set_column(5, "score", pa.array(np.array(score, np.float32)))
        assert (figure(scored(scene, tmp_path, of_both), "rmse_px") < 2) is right


def test_coverage_stands_next_to_every_error(
    scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pair, uv_a, uv_b = true_matches(scene)
    some = pair < 2
    table = matches_table(pair[some], uv_a[some], uv_b[some])
    path = submitted(scene, tmp_path, table)
    out = tmp_path / "report"
    assert run(["evaluate", str(path), "--data", str(scene.root), "--out", str(out)]) == 0
    lines = capsys.readouterr().out.splitlines()
    covered = [line for line in lines if "of 33.3 % of the pairs" in line]
    assert covered == [line for line in lines if "RMSE" in line]  # not of rates of all matches
    assert "of 33.3 % of the pairs" in (out / "report.html").read_text()
    assert "of 33.3 % of the pairs" in render_leaderboard([read_scores(out)])


def test_no_matches_at_all_are_a_coverage_of_zero(scene: Any, tmp_path: Path) -> None:
    nothing = np.empty((0, 2))
    scores = scored(scene, tmp_path, matches_table([], nothing, nothing))
    assert scores.document["coverage"] == 0
    assert scores.overall["rmse_px"] is None
    assert scores.overall["match_coverage"] == 0


@pytest.fixture
def three(scene: Any, tmp_path: Path) -> list[Scores]:
    """Reports of three methods, of which the first has no match that counts."""
    pair, uv_a, uv_b = true_matches(scene)
    off = np.array([[1.0, 1.0]])  # never on the object
    rows = {"none": ([0], off, off), "far": (pair, uv_a, uv_b + 9), "near": (pair, uv_a, uv_b)}
    reports = []
    for name, columns in rows.items():
        path = scene.submit(
            tmp_path / f"{name}.parquet", matches_table(*columns), kind="matches",
            method={"name": name},
        )  # fmt: skip
        reports.append(evaluate(path, scene.root))
        write_report(reports[-1], tmp_path / name)
    return reports


def test_a_method_without_a_value_has_no_rank(three: list[Scores]) -> None:
    found = ranks(differences(three, ["rmse_px"]), ["none", "far", "near"])
    assert found["overall", "rmse_px"] == [None, 2, 1]
    for reports in (three, three[:2], three[:1]):
        page = render_leaderboard(reports)
        places = re.findall(r'data-key="(none|far|near)">.*?<td data-key="(\d*)">', page)
        assert dict(places)["none"] == ""
        assert len(places) == len(reports)


def test_compare_orders_methods_by_value_and_names_those_without_last(
    three: list[Scores], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["compare", *(str(tmp_path / each.method) for each in three)]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if "RMSE (px), rope" in line)
    order = line.partition("best first: ")[2].split(", ")
    assert [each.split()[0] for each in order] == ["near", "far", "none"]


def test_reports_of_one_file_have_ranks_of_their_own(three: list[Scores]) -> None:
    _, far, near = three
    reports = [far, far, near]
    names = method_names(reports)
    assert names[:2] == [names[0], f"{names[0]}, 2"]
    assert ranks(differences(reports, ["rmse_px"]), names)["overall", "rmse_px"] == [2, 2, 1]


def test_bad_rows_are_named(scene: Any, tmp_path: Path) -> None:
    uv = np.array([[1.0, 2.0], [np.nan, 2.0], [3.0, np.inf]])
    table = matches_table([0, 1, 99], uv, uv)
    problems = inspect(submitted(scene, tmp_path, table), scene.root)
    assert problems.counts == {"VALUE_NOT_FINITE": 4, "ROW_UNKNOWN": 1}
    assert any("row 2 (pair 99)" in issue.where for issue in problems.issues())


def test_the_kind_must_fit_the_protocol(scene: Any, tmp_path: Path) -> None:
    with pytest.raises(CallError, match="scores submissions of kind answers; found kind matches"):
        scored(scene, tmp_path, matches_table(*true_matches(scene)), protocol="paper")
    with pytest.raises(CallError, match="kind matches; found kind answers"):
        scene.score(tmp_path, protocol="matches")


def test_without_surface_images_matches_cannot_be_scored(scene_maker: Any, tmp_path: Path) -> None:
    bare = scene_maker(tmp_path / "data", images=False)
    with pytest.raises(SpecError, match="surface images, and one is missing"):
        scored(bare, tmp_path, matches_table(*true_matches(bare)))
