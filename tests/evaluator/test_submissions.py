"""What the check says, what it accepts, and that check and evaluate never disagree."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pliant.cli.main import run
from pliant.evaluator import check, evaluate, inspect, read_scores
from pliant.evaluator.submission.problems import PLACES, Problems
from pliant.spec.errors import SubmissionError
from pliant.spec.validation.findings import LISTED_PER_CODE
from tests.evaluator.figures import figure


def test_an_issue_names_row_query_found_and_required(scene: Any, tmp_path: Path) -> None:
    path = scene.submit(tmp_path / "s.parquet", scene.edited("v", 25, np.nan))
    (issue,) = check(path, scene.root)
    assert issue.code == "VALUE_NOT_FINITE"
    assert issue.path == str(path)
    assert issue.where == "row 25 (pair 1, query 5)"
    assert issue.message == "v is nan; required: a finite position within ±1e6 px"


def test_a_duplicate_names_the_row_before(scene: Any, tmp_path: Path) -> None:
    table = pa.concat_tables([scene.table(), scene.table().slice(7, 1)])
    (issue,) = check(scene.submit(tmp_path / "s.parquet", table), scene.root)
    assert issue.where == f"row {scene.rows} (pair 0, query 7)"
    assert "answered before, in row 7" in issue.message


def test_unknown_and_missing_keys_are_named(scene: Any, tmp_path: Path) -> None:
    path = scene.submit(tmp_path / "s.parquet", scene.edited("query_id", 3, 20))
    unknown, missing = check(path, scene.root)
    assert unknown.where == "row 3 (pair 0, query 20)"
    assert "query ids below 20" in unknown.message
    assert missing.code == "ROW_MISSING"
    assert missing.where == "pair 0, query 3"


def test_every_reason_is_given_at_once(scene: Any, tmp_path: Path) -> None:
    table = scene.table(sigma=np.full(scene.rows, -1, np.float32)).drop_columns(["v"])
    table = table.append_column("visible", pa.array(["yes"] * scene.rows))
    path = scene.submit(tmp_path / "s.parquet", table, split="val")
    assert set(inspect(path, scene.root).counts) == {
        "SPLIT_MISMATCH", "COLUMN_MISSING", "COLUMN_TYPE",
    }  # fmt: skip
    table = scene.table(sigma=np.full(scene.rows, -1, np.float32)).slice(1)
    rows = pa.concat_tables([table, table.slice(0, 2)])
    assert inspect(scene.submit(path, rows), scene.root).counts == {
        "VALUE_OUT_OF_RANGE": scene.rows + 1, "ROW_DUPLICATE": 2, "ROW_MISSING": 1,
    }  # fmt: skip


def test_long_lists_are_capped_and_told_in_full(scene: Any, tmp_path: Path) -> None:
    path = scene.submit(tmp_path / "s.parquet", scene.table(np.full((scene.rows, 2), np.inf)))
    issues = check(path, scene.root)
    assert len(issues) == 21
    assert issues[-1].message == f"{2 * scene.rows} in all; the first 20 are listed"
    with pytest.raises(SubmissionError, match=f"found {2 * scene.rows} problems") as caught:
        evaluate(path, scene.root)
    assert len(caught.value.issues) == 2  # one of each cause


@pytest.mark.usefixtures("child_process")
def test_the_commands_print_one_line_per_cause(
    scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = scene.edited("v", 3, 1e9)
    table = table.set_column(2, "u", pa.array(np.full(scene.rows, np.nan, np.float32)))
    path = scene.submit(tmp_path / "s.parquet", table)
    for command, stream in (("check", "out"), ("evaluate", "err")):
        assert run([command, str(path), "--data", str(scene.root)]) == 1
        printed = capsys.readouterr()
        assert "Traceback" not in printed.out + printed.err
        lines = getattr(printed, stream).splitlines()
        first, second = [line for line in lines if line.startswith("ERROR ")]
        assert "[row 0 (pair 0, query 0); row 1 (pair 0, query 1); row 2 (pair 0, query 2); …]" in (
            first
        )
        assert f"u is nan; required: a finite position within ±1e6 px ({scene.rows} times)" in first
        assert "[row 3 (pair 0, query 3)]: v is 1000000000.0; required: " in second


def test_nan_and_infinities_are_counted_apart(scene: Any, tmp_path: Path) -> None:
    u = np.ones(scene.rows, np.float32)
    u[:5] = np.nan, np.inf, np.inf, -np.inf, np.nan
    table = scene.table().set_column(2, "u", pa.array(u))
    with pytest.raises(SubmissionError) as caught:
        evaluate(scene.submit(tmp_path / "s.parquet", table), scene.root)
    required = "required: a finite position within ±1e6 px"
    assert [issue.message for issue in caught.value.issues] == [
        f"u is nan; {required} (2 times)",
        f"u is inf; {required} (2 times)",
        f"u is -inf; {required}",
    ]
    assert caught.value.issues[1].where == "row 1 (pair 0, query 1); row 2 (pair 0, query 2)"


def test_notes_on_optional_columns_are_one_line(
    scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = scene.submit(tmp_path / "s.parquet")
    assert run(["evaluate", str(path), "--data", str(scene.root)]) == 0
    notes = [line for line in capsys.readouterr().err.splitlines() if line.startswith("Note")]
    columns = [line for line in notes if "the submission has" in line]
    assert columns == [
        "Note: the submission has no column `visible`, neither `sigma` nor `modes`: every point "
        "was taken as predicted visible; no figures of a distribution"
    ]
    assert len(notes) == len(set(notes)) <= 3


def test_problems_never_describe_more_than_they_list() -> None:
    described = []

    def describe(row: int) -> tuple[str, str]:
        described.append(row)
        return "", str(row)

    problems = Problems("f")
    problems.add_rows("ROW_MISSING", np.ones(10**7, bool), describe)
    assert len(described) <= LISTED_PER_CODE + PLACES
    assert problems.total == 10**7


def test_many_problems_of_the_whole_file_have_no_place() -> None:
    problems = Problems("s.parquet")
    problems.add_many("ROW_UNKNOWN", 999, [("", "found 1,000 rows; required: 1")])
    assert str(problems.causes[0]).endswith("s.parquet: found 1,000 rows; required: 1 (999 times)")


def test_check_needs_no_truth(scene_maker: Any, tmp_path: Path) -> None:
    public = scene_maker(tmp_path / "data", images=False)
    path = public.submit(tmp_path / "s.parquet")
    (public.root / "truth" / "test.parquet").unlink()
    assert check(path, public.root) == []
    assert run(["evaluate", str(path), "--data", str(public.root)]) == 1


def test_the_commands_exit_and_print_as_promised(
    scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = scene.submit(tmp_path / "good.parquet", method={"name": "truth"})
    bad = scene.submit(tmp_path / "bad.parquet", scene.edited("u", 0, np.inf))
    data = ["--data", str(scene.root)]
    assert run(["check", str(good), *data, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["valid"] is True
    assert run(["check", str(bad), *data, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["counts"] == {"VALUE_NOT_FINITE": 1}
    report = tmp_path / "report"
    assert run(["evaluate", str(good), *data, "--json", "--out", str(report)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == read_scores(report).document
    assert run(["evaluate", str(good), *data]) == 0
    assert "RMSE (px)" in capsys.readouterr().out
    assert run(["evaluate", str(bad), *data, "--out", str(tmp_path / "none")]) == 1
    assert "VALUE_NOT_FINITE" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
    assert run(["evaluate", str(good), *data, "--protocol", "worst"]) == 2
    assert run(["check", str(good), "--data", str(tmp_path)]) == 1
    half = scene.submit(tmp_path / "half.parquet", scene.table().slice(60))
    assert run(["evaluate", str(half), *data, "--allow-missing", "--protocol", "paper"]) == 0
    assert "Coverage: 50.00 %" in capsys.readouterr().out


# Any numbers at all: the verdict of the check is the verdict of the evaluation.
REALS = st.floats(width=32, allow_nan=True, allow_infinity=True)
INTEGERS = st.integers(-(2**31), 2**31 - 1)


@settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    edits=st.lists(
        st.tuples(st.sampled_from(["u", "v", "visible", "sigma"]), st.integers(0, 119), REALS),
        max_size=4,
    ),
    keys=st.lists(
        st.tuples(
            st.sampled_from(["pair_id", "query_id"]),
            st.integers(0, 119),
            INTEGERS | st.integers(-1, 25),
        ),
        max_size=3,
    ),
    drop=st.integers(0, 3),
    allow_missing=st.booleans(),
)
def test_what_check_passes_evaluate_scores(
    scene: Any, tmp_path: Path, edits: Any, keys: Any, drop: int, allow_missing: bool
) -> None:
    half, one = (np.full(scene.rows, value, np.float32) for value in (0.5, 1))
    table = scene.table(visible=half, sigma=one)
    columns = {name: table[name].to_numpy().copy() for name in table.column_names}
    for column, row, value in [*edits, *keys]:
        columns[column][row] = value
    path = scene.submit(tmp_path / "s.parquet", pa.table(columns).slice(drop))
    issues = check(path, scene.root, allow_missing=allow_missing)
    if issues:
        with pytest.raises(SubmissionError) as caught:
            evaluate(path, scene.root, allow_missing=allow_missing)
        assert {each.code for each in caught.value.issues} == {each.code for each in issues}
        return
    scores = evaluate(path, scene.root, allow_missing=allow_missing)
    finite = [v for v in scores.overall.values() if v is not None]
    assert np.isfinite(finite).all()
    assert 0 <= figure(scores, "pck_8px") <= 1
