"""The controls do what their names say."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.baselines import METHODS, Frame, Matcher, SplitMatcher
from pliant.baselines.controls import Identity, MaskCentroid, Oracle, RandomInMask
from pliant.baselines.pixels import lies_on
from pliant.baselines.predict import predict
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from pliant.spec.frame import Pair
from pliant.spec.io.parquet import read_table
from pliant.spec.storage import layout
from tests.known import known

QUERIES = np.array([[1.25, 2.5], [3.0, 0.125], [4.75, 3.5]], dtype=np.float32)


def view(*pixels: tuple[int, int], key: str = "") -> Frame:
    mask = np.zeros((40, 50), dtype=np.bool_)
    for row, column in pixels:
        mask[row, column] = True
    return Frame(np.zeros((40, 50, 3), dtype=np.uint8), mask, key=key)


@pytest.mark.parametrize(
    ("control", "pixels", "expected"),
    [
        (Identity(), [], QUERIES.tolist()),
        (MaskCentroid(), [(0, 0), (0, 4), (3, 2)], [[2.5, 1.5]] * 3),  # not one of them
        (RandomInMask(), [], [[25, 20]] * 3),  # without an object the image's centre
    ],
)
def test_what_a_control_answers(control: Matcher, pixels: list[Any], expected: Any) -> None:
    assert control.answer(Pair(view(), view(*pixels), QUERIES)).uv_px.tolist() == expected


def test_random_stays_on_the_object_and_spreads_over_it() -> None:
    target = view(*((row, 7) for row in range(40)))
    queries = np.random.default_rng(0).uniform(0, 40, (4000, 2)).astype(np.float32)
    answers = RandomInMask().answer(Pair(view(), target, queries)).uv_px
    assert lies_on(answers, known(target.mask)).all()
    counts = np.bincount(answers[:, 1].astype(int), minlength=40)
    assert counts.min() > 60  # 100 a pixel on average, deviation 10
    assert abs((answers % 1).mean() - 0.5) < 0.02  # anywhere inside the pixel


def test_random_depends_on_seed_frames_and_query_alone() -> None:
    target = view(*((row, column) for row in range(40) for column in range(50)), key="b")
    source = view(key="a")
    answers = RandomInMask().answer(Pair(source, target, QUERIES)).uv_px
    reordered = RandomInMask().answer(Pair(source, target, QUERIES[::-1])).uv_px
    np.testing.assert_array_equal(reordered, answers[::-1])
    for matcher, first in ((RandomInMask(1), source), (RandomInMask(), view(key="c"))):
        other = matcher.answer(Pair(first, target, QUERIES)).uv_px
        assert (other != answers).all()


def test_oracle_writes_the_truth(cards: Dataset, tmp_path: Path) -> None:
    oracle = METHODS["oracle"]()
    assert isinstance(oracle, SplitMatcher)
    out = tmp_path / "oracle.parquet"
    done = predict(cards, "test", oracle, out)
    table, truth = pq.read_table(out), cards.truth("test")
    for answer, true in (("u", "u_b"), ("v", "v_b")):
        np.testing.assert_array_equal(table.column(answer), truth.column(true))  # to the bit
    assert table.column("visible").to_pylist() == ([1.0] * 19 + [0.0]) * 3
    assert (done.pairs, done.rows) == (3, 60)


def test_oracle_needs_the_truth_of_these_queries(own_cards: Path, tmp_path: Path) -> None:
    path, out = own_cards / layout.truth_name("test"), tmp_path / "oracle.parquet"
    table = pq.read_table(path)
    pq.write_table(table.take(pa.array(range(59, -1, -1))), path)
    with pytest.raises(SpecError, match="row by row"):
        predict(Dataset.open(own_cards), "test", Oracle(), out)
    path.unlink()
    with pytest.raises(CallError, match="does not contain"):
        predict(Dataset.open(own_cards), "test", Oracle(), out)


@pytest.mark.parametrize("name", sorted(set(METHODS) - {"oracle"}))
def test_every_method_answers_no_queries_and_travels_to_another_process(
    name: str, cards: Dataset
) -> None:
    matcher = METHODS[name]()
    sent = pickle.loads(pickle.dumps(matcher))
    assert sent.describe() == matcher.describe()
    view = cards.sequences[0][0]
    assert sent.answer(Pair(view, view, np.zeros((0, 2), np.float32))).uv_px.shape == (0, 2)


@pytest.mark.usefixtures("quick_tracing")
@pytest.mark.parametrize("name", sorted(METHODS))
def test_every_method_answers_every_query(name: str, cards: Dataset, tmp_path: Path) -> None:
    out = tmp_path / "out.parquet"
    done = predict(cards, "test", METHODS[name](), out)
    table = read_table(out, "answers")
    assert len(table) == done.rows == 60
    assert np.isfinite(table.column("u").to_numpy()).all()
    assert np.isfinite(table.column("v").to_numpy()).all()
    assert done.method["name"] == name
