"""Answers in memory get the scores of the file that has them, and the same refusals."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pliant.evaluator import Scores, evaluate_answers
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError, SubmissionError
from pliant.spec.opening import SAMPLE
from tests.evaluator.figures import figure


def figures(scores: Scores) -> dict[str, Any]:
    return {key: value for key, value in scores.document.items() if key != "submission"}


def test_arrays_columns_and_tables_score_like_the_file(scene: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    uv = (scene.true_px + rng.normal(0, 5, (scene.rows, 2))).astype(np.float32)
    expected = scene.score(tmp_path, scene.table(uv))
    columns = {"u": uv[:, 0], "v": uv[:, 1]}
    shuffled = scene.table(uv).take(pa.array(rng.permutation(scene.rows)))
    for answers in (uv, columns, pa.table(columns), shuffled):
        found = evaluate_answers(scene.root, scene.split, answers, method="mine")
        assert figures(found) == figures(expected)
        assert found.per_pair.equals(expected.per_pair)
        assert found.method == "mine"
    assert figure(found, "rmse_px") > 4


def test_a_data_frame_has_columns_by_name(scene: Any) -> None:
    """Two columns of a data frame are not positions (u, v): their order does not count."""
    pandas = pytest.importorskip("pandas")
    u, v = scene.true_px.astype(np.float32).T
    frame = pandas.DataFrame({"v": v, "u": u})
    keyed = scene.table(scene.true_px).to_pandas().sample(frac=1, random_state=0)
    for answers in (frame, keyed, keyed.set_index(["pair_id", "query_id"])):
        scores = evaluate_answers(scene.root, scene.split, answers)
        assert figure(scores, "rmse_px") == pytest.approx(0, abs=1e-4)


def test_tensors_of_a_network_are_read(scene: Any) -> None:
    torch = pytest.importorskip("torch")
    uv = torch.tensor(scene.true_px, dtype=torch.float32, requires_grad=True)
    for answers in (uv, {"u": uv[:, 0], "v": uv[:, 1]}):
        scores = evaluate_answers(scene.root, scene.split, answers)
        assert figure(scores, "rmse_px") == pytest.approx(0, abs=1e-4)


def test_distributions_and_missing_answers_work_in_memory(scene: Any, tmp_path: Path) -> None:
    modes = [[{"u": u, "v": v, "sigma": 2.0, "weight": 1.0}] for u, v in scene.true_px.tolist()]
    table = scene.table(modes=modes)
    part = table.slice(5)
    expected = scene.score(tmp_path, part, allow_missing=True)
    found = evaluate_answers(scene.root, scene.split, part, allow_missing=True)
    assert figures(found) == figures(expected)
    assert found.overall["nll"] is not None
    with pytest.raises(SubmissionError, match="5 problems"):
        evaluate_answers(scene.root, scene.split, part)


def test_wrong_answers_are_refused_with_a_reason(scene: Any) -> None:
    uv = scene.true_px.astype(np.float32)
    unanswered: Any = np.ma.masked_array(uv, np.arange(uv.size).reshape(uv.shape) < 2)
    with pytest.raises(CallError, match="must not be masked; found 2 masked values"):
        evaluate_answers(scene.root, scene.split, unanswered)
    masked = np.ma.masked_less(uv[:, 0], uv[:, 0].min() + 1e-3)
    with pytest.raises(CallError, match=r"must not be masked; found 1 masked value\."):
        evaluate_answers(scene.root, scene.split, {"u": masked, "v": uv[:, 1]})
    with pytest.raises(CallError, match="no queries; found 'holdout'; required: one of test"):
        evaluate_answers(scene.root, "holdout", uv)
    with pytest.raises(CallError, match="not columns of one length"):
        evaluate_answers(scene.root, scene.split, {"u": uv[:, 0], "v": uv[:3, 1]})
    with pytest.raises(SubmissionError) as caught:
        evaluate_answers(scene.root, scene.split, uv.astype(np.int64))
    assert {issue.code for issue in caught.value.issues} == {"COLUMN_TYPE"}
    uv[3] = np.nan
    with pytest.raises(SubmissionError, match=r"VALUE_NOT_FINITE.*row 3 \(pair 0, query 3\)"):
        evaluate_answers(scene.root, scene.split, uv)


def test_scores_show_themselves(scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    off = scene.true_px + np.array([3.0, 4.0])
    scores = evaluate_answers(scene.root, scene.split, off, method="<off>")
    table = scores.to_arrow()
    rows = {(row["group"], row["metric"]): row for row in table.to_pylist()}
    assert rows["overall", "rmse_px"]["value"] == pytest.approx(5)
    assert rows["rope", "rmse_px"]["low"] == pytest.approx(5)
    assert rows["cloth", "median_px"]["low"] is None
    assert "rmse_px 5" in repr(scores)
    assert len(repr(scores)) < 300
    page = scores._repr_html_()
    assert "<td>rmse_px</td><td>5</td>" in page
    assert "&lt;off&gt;" in page
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(CallError, match="to_pandas needs pandas"):
        scores.to_pandas()


def test_a_truth_of_another_split_is_refused(tmp_path: Path) -> None:
    """The set's own truth of the split does not take its place."""
    given = tmp_path / "truth" / "val.parquet"
    given.parent.mkdir()
    given.write_bytes((SAMPLE / "truth" / "val.parquet").read_bytes())
    queries = Dataset.open(SAMPLE).queries("test")
    unmoved = {"u": queries["u_a"], "v": queries["v_a"]}
    for truth in (given, given.parent):
        with pytest.raises(SpecError, match="found other splits; required: split 'test'"):
            evaluate_answers(SAMPLE, "test", unmoved, truth=truth)
