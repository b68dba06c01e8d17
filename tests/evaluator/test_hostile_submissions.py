"""More than two hundred files that somebody might submit, by mistake or on purpose.

Every case says which issue codes must be reported, all of them. Whatever the file, `inspect` and
`evaluate` give the same verdict and neither raises anything but its own errors. Bytes that are
changed at random: `tests/fuzz`.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from _pytest.mark import ParameterSet

from pliant.evaluator import evaluate, inspect
from pliant.spec.errors import SubmissionError
from pliant.spec.limits import Limits
from pliant.spec.validation.issue_codes import ISSUE_CODES
from tests.evaluator import hostile_files  # noqa: F401, which registers its cases
from tests.evaluator.hostile_tables import CASES, MODE, MODES_TYPE


def test_there_are_many_cases_and_all_codes_are_of_the_catalogue() -> None:
    assert len(CASES) >= 200
    codes = {code for expected, _ in CASES.values() for code in expected}
    assert codes <= set(ISSUE_CODES)
    submission_codes = {
        name for name, code in ISSUE_CODES.items() if code.subject in ("both", "submission")
    }
    assert submission_codes - codes <= {"PATH_UNSAFE"}, "a code without a case"


def verdict(path: Path, root: Path) -> set[str]:
    """Return the codes of a file; `evaluate` must refuse exactly what `inspect` refuses."""
    problems = inspect(path, root)
    for issue in problems.issues():
        assert issue.message, issue
    found: set[str] = set()
    try:
        evaluate(path, root, protocol="paper")
    except SubmissionError as error:
        found = {issue.code for issue in error.issues}
    assert found == set(problems.counts)
    return found


EACH = 3


def cases() -> Iterator[ParameterSet]:
    """Yield every case; `make test` has the first ones of each set of codes.

    Valid files are also scored by `test_other_encodings_score_like_the_plain_file`.
    """
    seen: Counter[frozenset[str]] = Counter()
    for name, (codes, _) in CASES.items():
        seen[frozenset(codes)] += 1
        late = seen[frozenset(codes)] > EACH
        yield pytest.param(name, marks=[pytest.mark.long] if late else [])


@pytest.mark.parametrize("name", list(cases()))
def test_a_hostile_file_gets_its_codes(name: str, scene: Any, tmp_path: Path) -> None:
    expected, build = CASES[name]
    build(scene, tmp_path / "submission.parquet")
    assert verdict(tmp_path / "submission.parquet", scene.root) == expected


def crash(*_: object, **__: object) -> None:
    os.abort()


@pytest.mark.long
@pytest.mark.usefixtures("child_process")
def test_a_crash_of_the_reader_and_a_bomb_are_issues(scene: Any, tmp_path: Path) -> None:
    """A file of a megabyte whose mixtures take gigabytes, within a limit of 300 MB."""
    path = tmp_path / "bomb.parquet"
    count = 1 << 24
    lists = pa.ListArray.from_arrays(
        pa.array(np.append([0], np.full(scene.rows, count)).astype(np.int32)),
        pa.array([MODE], MODES_TYPE.value_type).take(pa.array(np.zeros(count, np.int32))),
    )
    scene.submit(path, scene.table().append_column("modes", lists))
    assert path.stat().st_size < 2**22
    limits = Limits(memory_bytes=300 * 2**20)
    assert set(inspect(path, scene.root, limits=limits).counts) == {"FILE_TOO_LARGE"}
    with pytest.raises(SubmissionError, match="FILE_TOO_LARGE"):
        evaluate(path, scene.root, limits=limits)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pliant.evaluator.submission.loading._load", crash)
        crashed = inspect(path, scene.root, limits=Limits())
    assert set(crashed.counts) == {"FILE_UNREADABLE"}
    assert "crashed" in crashed.issues()[0].message


def test_other_encodings_score_like_the_plain_file(scene: Any, tmp_path: Path) -> None:
    plain = evaluate(scene.submit(tmp_path / "plain.parquet"), scene.root, protocol="paper")
    assert plain.overall["rmse_px"] == 0
    same = [name for name, (codes, _) in CASES.items() if not codes and "outside" not in name]
    assert len(same) > 40
    for name in same:
        path = tmp_path / f"{name.replace('/', ' ')}.parquet"
        CASES[name][1](scene, path)
        assert evaluate(path, scene.root, protocol="paper").overall == plain.overall, name
