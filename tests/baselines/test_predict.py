"""The prediction loop and the files it writes."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch

import pliant
from pliant.baselines import METHODS, Answers, answering
from pliant.baselines.predict import answer, predict
from pliant.baselines.submission_file import write_template
from pliant.spec.answers import Matches
from pliant.spec.arrays import Float32Array
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError, SubmissionError
from pliant.spec.frame import Frame, Pair
from pliant.spec.io.parquet import read_footer, read_table
from pliant.spec.storage import layout
from tests.known import known


class Fixed:
    """Answers with whatever a test wants."""

    name = "fixed"

    def __init__(self, **fields: Any) -> None:
        self._fields = fields

    def describe(self) -> Mapping[str, Any]:
        return {"settings": 3}

    def answer(self, pair: Pair) -> Answers:
        fields = {name: make(len(pair.uv_a_px)) for name, make in self._fields.items()}
        return Answers(**{"uv_px": pair.uv_a_px + 1, **fields})


class Raising(Fixed):
    """Fails at its second pair."""

    name = "raising"
    asked = 0

    def answer(self, pair: Pair) -> Answers:
        self.asked += 1
        if self.asked == 2:
            raise KeyError("missing")
        return super().answer(pair)


def test_the_file_and_what_ties_it_to_its_queries(cards: Dataset, tmp_path: Path) -> None:
    """An answer for every query, in order; the footer names the dataset and the queries."""
    out = tmp_path / "fixed.parquet"
    done = predict(cards, "test", Fixed(), out)
    answers, queries = read_table(out, "answers"), cards.queries("test")
    for key in ("pair_id", "query_id"):
        assert answers.column(key).equals(queries.column(key))
    np.testing.assert_array_equal(answers.column("u"), queries.column("u_a").to_numpy() + 1)
    np.testing.assert_array_equal(answers.column("v"), queries.column("v_a").to_numpy() + 1)
    assert (done.pairs, done.rows, done.kind) == (3, 60, "answers")
    assert read_footer(out) == {
        "spec_version": "1.0.0",
        "table": "answers",
        "dataset": {"id": "cards", "version": "1.0.0"},
        "split": "test",
        "queries_sha256": cards.queries_sha256("test"),
        "method": {"name": "fixed", "settings": 3, "mask": "given"},
    }


def test_optional_columns_round_trip(cards: Dataset, tmp_path: Path) -> None:
    out = tmp_path / "modes.parquet"

    def modes(count: int) -> list[Float32Array]:
        two = np.array([[1, 2, 3, 0.25], [4, 5, 6, 0.75]], dtype=np.float32)
        one = np.array([[1, 2, 3, 1]], dtype=np.float32)
        return [two if row % 2 else one for row in range(count)]

    predict(cards, "test", Fixed(visible=lambda n: np.full(n, 0.5, np.float32), modes=modes), out)
    table = pq.read_table(out)
    assert table.column("visible").to_pylist() == [0.5] * 60
    assert table.column("modes")[1].as_py() == [
        {"u": 1, "v": 2, "sigma": 3, "weight": 0.25},
        {"u": 4, "v": 5, "sigma": 6, "weight": 0.75},
    ]
    assert len(table.column("modes")[0]) == 1


def test_the_footer_has_the_familiarity(cards: Dataset, tmp_path: Path) -> None:
    """20 queries in each of 3 pairs; one of 20 is strange."""
    out = tmp_path / "known.parquet"

    def familiarity(count: int) -> Float32Array:
        return np.where(np.arange(count) == 0, 0.0, 0.5).astype(np.float32)

    predict(cards, "test", Fixed(familiarity=familiarity), out)
    facts = read_footer(out)["method"]["familiarity"]
    assert facts == {"median": 0.5, "share_below_0.02": 0.05}


@pytest.mark.parametrize("method", [pytest.param("sift", marks=pytest.mark.long), "random"])
def test_workers_change_no_byte(cards: Dataset, tmp_path: Path, method: str) -> None:
    files = [tmp_path / f"{workers}.parquet" for workers in (1, 2)]
    progress: list[tuple[int, int]] = []
    for workers, out in enumerate(files, start=1):
        matcher = METHODS[method]()
        predict(
            cards,
            "test",
            matcher,
            out,
            workers=workers,
            progress=lambda done, total: progress.append((done, total)),
        )
    assert files[0].read_bytes() == files[1].read_bytes()
    assert progress == [(1, 3), (2, 3), (3, 3), (3, 3)]


@pytest.mark.parametrize("workers", [1, 2])
def test_masks_can_be_withheld(cards: Dataset, tmp_path: Path, workers: int) -> None:
    out = tmp_path / "centroid.parquet"
    none = predict(cards, "test", METHODS["centroid"](), out, workers=workers, masks=False)
    assert none.method["mask"] == "none"
    assert set(read_table(out, "answers").column("u").to_pylist()) == {120.0}  # the image's middle


def test_frames_without_surface_are_searched_whole(own_cards: Path, tmp_path: Path) -> None:
    frame = own_cards / layout.sequence_name("card", "card-test-000000") / layout.depth_name(1)
    frame.unlink()
    out = tmp_path / "random.parquet"
    partly = predict(Dataset.open(own_cards), "test", METHODS["random"](), out)
    assert partly.method["mask"] == "partly given"
    shutil.rmtree(frame.parent)
    none = predict(Dataset.open(own_cards), "test", METHODS["centroid"](), out)
    assert none.method["mask"] == "none"
    answers = read_table(out, "answers")
    assert set(answers.column("u").to_pylist()) == {120.0}
    assert set(answers.column("v").to_pylist()) == {100.0}


def test_matches_are_written_pair_by_pair(cards: Dataset, tmp_path: Path) -> None:
    out = tmp_path / "orb.parquet"
    done = predict(cards, "test", METHODS["orb"](), out, "matches")
    table = read_table(out, "matches")
    pairs = table.column("pair_id").to_numpy()
    assert done.rows == len(table) > 30
    assert (np.diff(pairs) >= 0).all()
    assert set(pairs.tolist()) == {0, 1, 2}
    assert read_footer(out)["table"] == "matches"
    score = table.column("score").to_numpy()
    assert (score > 0.2 - 1e-6).all()  # 1 - ratio, ratio < 0.8
    assert (score <= 1).all()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"uv_px": lambda n: np.full((n, 2), np.nan)}, "pair 0, uv_px.*nan .40 of 40.*finite"),
        ({"uv_px": lambda n: np.full((n, 2), 1e300)}, "pair 0, uv_px.*inf .40 of 40.*within"),
        ({"uv_px": lambda n: None}, "pair 0: .*something else than answers; found NoneType"),
        ({"uv_px": lambda n: (np.ones((n, 2)), np.ones(n))}, "something else.*found tuple.*array"),
        ({"uv_px": lambda n: np.zeros((n - 1, 2), np.float32)}, "pair 0, uv_px.*wrong shape"),
        ({"uv_px": lambda n: [(3, 4)] * n}, "pair 0, uv_px.*half a pixel; found int64.*add 0.5"),
        ({"uv_px": lambda n: np.ones((n, 2), bool)}, "pair 0, uv_px.*half a pixel; found bool"),
        ({"uv_px": lambda n: torch.ones(n, 2).half()}, "half a pixel; found float16.*float32"),
        ({"visible": lambda n: np.zeros((n, 1), np.float32)}, "pair 0, visible.*wrong shape"),
        ({"visible": lambda n: np.full(n, 3)}, "pair 0, visible.*3.0 .*probability, 0 to 1"),
        ({"sigma_px": np.zeros}, "pair 0, sigma_px.*0.0 .*greater than 0"),
        ({"familiarity": lambda n: np.ones(2)}, r"pair 0, familiarity.*shape; found \(2,\)"),
        ({"modes": lambda n: []}, "pair 0, modes.*wrong shape"),
        ({"modes": lambda n: 5}, r"pair 0, modes.*shape; found int; required: 20 arrays \(M, 4\)"),
        ({"modes": lambda n: [[(1, 2, 3)]] * n}, r"modes.*shape; found \(1, 3\).*\(M, 4\)"),
        ({"modes": lambda n: [np.zeros((0, 4))] * n}, "modes.*M from 1 to 64"),
        ({"modes": lambda n: [[(1, 2, -3, 1)]] * n}, "pair 0, modes, sigma.*-3.0 .*greater"),
        ({"modes": lambda n: [[(np.nan, 2, 3, 1)]] * n}, "pair 0, modes, u.*nan .*finite"),
        ({"modes": lambda n: [[(1, 2, 3, 0.5)]] * n}, "modes, weight.*0.5 .*sum to 1"),
        ({"modes": lambda n: [[(1, 2, 3, 1)]] * n, "sigma_px": np.ones}, "both sigma_px and modes"),
    ],
)
def test_answers_that_are_none_are_refused(
    cards: Dataset, tmp_path: Path, fields: dict[str, Any], message: str
) -> None:
    out = tmp_path / "bad.parquet"
    with pytest.raises(SubmissionError, match=message):
        predict(cards, "test", Fixed(**fields), out)
    assert list(tmp_path.iterdir()) == []


def test_answers_may_be_tensors_of_a_network(cards: Dataset, tmp_path: Path) -> None:
    """Torch refuses `numpy.asarray` of a tensor that requires a gradient."""

    def tensor(count: int) -> torch.Tensor:
        return torch.full((count, 2), 7.5, dtype=torch.float64, requires_grad=True)

    out = tmp_path / "tensors.parquet"
    predict(cards, "test", Fixed(uv_px=tensor, visible=lambda n: tensor(n)[:, 0] / 10), out)
    table = pq.read_table(out)
    assert table.column("u").to_pylist() == [7.5] * 60
    assert table.column("visible").to_pylist() == [0.75] * 60
    assert pliant.predict(cards, lambda source, target, uv: tensor(len(uv))).answers.uv_px.all()


def test_a_function_may_return_answers_with_visibility(cards: Dataset) -> None:
    def doubtful(source: Frame, target: Frame, uv: Any) -> Answers:
        return Answers(uv, visible=np.full(len(uv), 0.25))

    found = known(pliant.predict(cards, doubtful).answers.visible)
    assert set(found.tolist()) == {0.25}


class Matching(Fixed):
    """Returns as matches whatever a test wants."""

    def match(self, source: Frame, target: Frame) -> Any:
        return self._fields["matches"]


ONE = np.ones((1, 2), np.float32)


def test_matches_may_be_plain_lists(cards: Dataset, tmp_path: Path) -> None:
    out = tmp_path / "out.parquet"
    predict(cards, "test", Matching(matches=([(1.0, 2.0)], [(3.0, 4.0)])), out, "matches")
    assert [row["u"] for row in read_table(out, "matches").to_pylist()] == [3, 3, 3]


@pytest.mark.parametrize(
    ("matches", "message"),
    [
        (None, "pair 0: .*no matches; found NoneType"),
        (([(1.5, 2.5)], torch.tensor([(3, 4)])), "pair 0, uv_b_px.*half a pixel; found int64"),
        (([(1.0, 2)], [(3, np.nan)]), "pair 0, uv_b_px.*nan .*finite"),
        (([(1.0, 2)], [(3, 1e7)]), "pair 0, uv_b_px.*within"),
        (([(1.0, 2)], [(3.0, 4)], [np.inf]), "pair 0, score.*inf .*finite number"),
        (Matches(ONE, ONE, ONE[0]), r"found \[\(1, 2\)"),
    ],
)
def test_matches_that_are_none_are_refused(
    cards: Dataset, tmp_path: Path, matches: Any, message: str
) -> None:
    with pytest.raises(SubmissionError, match=message):
        predict(cards, "test", Matching(matches=matches), tmp_path / "out.parquet", "matches")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("facts", [None, {"x": np.float32(1)}, {"x": float("nan")}])
def test_a_description_that_cannot_be_stored_is_refused_before_the_work(
    cards: Dataset, facts: Any
) -> None:
    method = Raising()
    method.describe = lambda: facts  # type: ignore[method-assign]
    with pytest.raises(CallError, match="the footer cannot store what `describe` of 'raising'"):
        answer(cards, "test", method)
    assert method.asked == 0


@pytest.mark.parametrize("workers", [1, 2])
def test_an_exception_of_a_method_names_the_pair(cards: Dataset, workers: int) -> None:
    with pytest.raises(KeyError, match="missing") as caught:
        answer(cards, "test", Raising(), workers=workers)
    (note,) = caught.value.__notes__
    pair = cards.pairs("test")[1]
    assert note == (
        f"The method 'raising' was at pair 1, from {pair.source.key} to {pair.target.key}"
    )


class FailingOrSlow(Fixed):
    """Fails at one pair; takes a minute for every other."""

    name = "failing"

    def answer(self, pair: Pair) -> Answers:
        if (pair.source.key, pair.target.key) == self._fields["fails"]:
            raise KeyError("missing")
        time.sleep(60)
        return super().answer(pair)


def test_the_first_error_ends_all_workers(cards: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answering, "PAIRS_PER_TASK", 1)
    first = cards.pairs("test")[0]
    begun = time.monotonic()
    with pytest.raises(KeyError, match="missing"):
        answer(cards, "test", FailingOrSlow(fails=(first.source.key, first.target.key)), workers=2)
    assert time.monotonic() - begun < 50


class Ending(Fixed):
    """Ends its process, as a lack of memory would."""

    name = "ending"

    def answer(self, pair: Pair) -> Answers:
        os._exit(3)


def test_a_worker_that_ends_is_one_sentence(cards: Dataset) -> None:
    with pytest.raises(CallError, match=r"process of the method 'ending' ended .* fewer workers"):
        answer(cards, "test", Ending(), workers=2)


def test_only_a_submission_is_replaced(cards: Dataset, tmp_path: Path) -> None:
    out = tmp_path / "out.parquet"
    out.write_text("my notes")
    with pytest.raises(CallError, match="is not a submission"):
        predict(cards, "test", Fixed(), out)
    assert out.read_text() == "my notes"
    out.unlink()
    write_template(cards, "test", out)
    predict(cards, "test", Fixed(), out)
    assert read_footer(out)["method"]["name"] == "fixed"


def test_bad_calls_are_refused_before_any_work(cards: Dataset, tmp_path: Path) -> None:
    missing = tmp_path / "a folder"
    with pytest.raises(CallError, match=f"does not exist. Create it: mkdir -p '{missing}'$"):
        predict(cards, "test", Fixed(), missing / "out.parquet")
    with pytest.raises(CallError, match="workers"):
        predict(cards, "test", Fixed(), tmp_path / "out.parquet", workers=0)
    assert list(tmp_path.iterdir()) == []


class Sharing(Fixed):
    """Counts how often it is asked to share; a copy counts for itself."""

    shared = 0

    def share(self, folder: Path) -> None:
        self.shared += 1


def test_one_process_shares_nothing_and_needs_no_pickle(cards: Dataset, tmp_path: Path) -> None:
    matcher = Sharing(visible=lambda n: np.zeros(n, np.float32))
    predict(cards, "test", matcher, tmp_path / "out.parquet")
    assert matcher.shared == 0
    with pytest.raises(CallError, match="cannot be sent to worker processes"):
        predict(cards, "test", matcher, tmp_path / "out.parquet", workers=2)


def test_broken_image_stops_and_leaves_the_old_file(own_cards: Path, tmp_path: Path) -> None:
    dataset = Dataset.open(own_cards)
    out = tmp_path / "out.parquet"
    write_template(dataset, "test", out)
    before = out.read_bytes()
    image = own_cards / layout.sequence_name("card", "card-test-000000") / layout.rgb_name(2)
    image.write_bytes(image.read_bytes()[:200])
    with pytest.raises(SpecError, match=r"000002\.png"):
        predict(dataset, "test", Fixed(), out)
    assert out.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cards", "out.parquet"]


@pytest.mark.parametrize(
    ("column", "row", "value", "message"),
    [
        ("frame_b", 25, 0, r"row 25, frame_b: one pair has two values of frame_b"),
        ("sequence_a", 41, "other", r"row 41, sequence_a: one pair has two values"),
        ("pair_id", 30, 0, "pair_id is not ascending"),
    ],
)
def test_queries_that_contradict_themselves_are_refused(
    column: str, row: int, value: Any, message: str, own_cards: Path, tmp_path: Path
) -> None:
    path = own_cards / layout.queries_name("test")
    table = pq.read_table(path)
    values = table.column(column).to_pylist()
    values[row] = value
    index = table.schema.get_field_index(column)
    field = table.schema.field(column)
    pq.write_table(table.set_column(index, field, pa.array(values, field.type)), path)
    with pytest.raises(SpecError, match=message):
        predict(Dataset.open(own_cards), "test", Fixed(), tmp_path / "out.parquet")
