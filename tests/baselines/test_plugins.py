"""Methods from files, modules and other packages, and objects completed to matchers."""

from __future__ import annotations

import json
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.baselines import Answers, Frame, KeypointMatcher, Matches
from pliant.baselines.adapters import as_matcher
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, MissingExtraError, SubmissionError
from pliant.spec.frame import Pair
from pliant.spec.io.parquet import read_footer, read_table
from tests.baselines.conftest import METHODS_FILE
from tests.conftest import Called

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def methods_file(tmp_path: Path) -> Path:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    path = folder / f"methods_{tmp_path.name}.py"  # every test imports a module of its own
    path.write_text(METHODS_FILE)
    (folder / "neighbour_of_the_file.py").touch()
    return path


def moved(dataset: Dataset, method: Any) -> np.ndarray:
    answers = pliant.predict(dataset, method).answers.uv_px
    asked = np.concatenate([pair.queries for pair in dataset.pairs("test")])
    return np.unique(np.round(answers - asked, 3), axis=0)


def test_class_of_a_file_with_options(
    methods_file: Path, cards: Dataset, tmp_path: Path, called: Called
) -> None:
    out = tmp_path / "shift.parquet"
    code, said, complaint = called(
        *("predict", f"{methods_file}:Shift", "--data", cards.root, "--out", out),
        *("--set", "du=3", "--set", "dv=-1.5"),
    )
    assert (code, complaint) == (0, "")
    assert "60 answers for 3 pairs of cards/test by Shift" in said
    asked = np.concatenate([pair.queries for pair in cards.pairs("test")])
    np.testing.assert_allclose(read_table(out, "answers")["u"], asked[:, 0] + 3)
    assert read_footer(out)["method"] == {
        "name": "Shift", "implementation": f"{methods_file.stem}.Shift", "mask": "given",
        "options": {"du": 3, "dv": -1.5},
    }  # fmt: skip


def test_a_method_that_prints_does_not_print_into_the_document(
    tmp_path: Path, cards: Dataset, called: Called
) -> None:
    method = tmp_path / f"talking_{tmp_path.name}.py"
    method.write_text("def same(source, target, uv):\n    print('looking')\n    return uv\n")
    predict = ("predict", f"{method}:same", "--data", cards.root, "--out", tmp_path / "a.parquet")
    _, said, complaint = called(*predict, "--json")
    assert json.loads(said)["rows"] == 60
    assert complaint.count("looking") == 3
    assert called(*predict)[1].startswith("looking\n")


@pytest.mark.parametrize(
    ("name", "options", "by"),
    [
        ("Shift", {"du": 2, "dv": 1}, [2, 1]),
        ("function", {}, [1, 1]),
        ("function", {"by": 3}, [3, 3]),
        ("factory", {"amount": 5}, [5, 5]),
        ("ready", {}, [2, 2]),
        ("OnlyMatches", {}, [4, 4]),
    ],
)
def test_every_kind_of_object(
    name: str, options: dict[str, float], by: list[float], methods_file: Path, cards: Dataset
) -> None:
    method = pliant.open_method(f"{methods_file}:{name}", **options)
    np.testing.assert_array_equal(moved(cards, method), [by])
    described: dict[str, Any] = dict(method.describe())
    if "implementation" in described:  # it has no `describe` of its own
        assert described.get("options", {}) == options


def test_module_in_the_working_folder(
    methods_file: Path, cards: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = methods_file.parent / f"package_{methods_file.stem}"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "inner.py").write_text(METHODS_FILE)
    monkeypatch.chdir(methods_file.parent)
    monkeypatch.setattr(sys, "path", [*sys.path])
    np.testing.assert_array_equal(moved(cards, f"{package.name}.inner:ready"), [[2, 2]])


def test_only_matches_are_also_written_as_matches(
    methods_file: Path, cards: Dataset, tmp_path: Path, called: Called
) -> None:
    out = tmp_path / "matches.parquet"
    method = f"{methods_file}:OnlyMatches"
    arguments = ("predict", method, "--data", cards.root, "--out", out, "--kind", "matches")
    assert called(*arguments)[0] == 0
    table = read_table(out, "matches")
    assert len(table) == 9
    assert read_footer(out)["method"]["interpolation"] == "affine, 8 nearest matches"


def test_workers_answer_with_a_class_of_a_file(methods_file: Path, cards: Dataset) -> None:
    method = pliant.open_method(f"{methods_file}:Shift", du=1)
    one = pliant.predict(cards, method).answers.uv_px
    two = pliant.predict(cards, method, workers=2).answers.uv_px
    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("", {}, "the class is missing.*Name it after a colon: .*:Matcher"),
        (":", {}, "the class is missing.*Name it after a colon: [^:]*:Matcher"),
        (":Shfit", {}, "'Shfit' was not found in the module.*Did you mean Shift"),
        (":Matcher", {}, "'Matcher' was not found .*; required: one of Shift, .*function"),
        (":Shift", {"dx": 1}, "unexpected keyword argument 'dx'; found dx=1; .*options du, dv"),
        (":factory", {}, "missing a required argument: 'amount'; found no options"),
        (":ready", {"du": 1}, "takes no options; found du"),
        (":two_images", {}, r"two images needs an adapter; .*from_flow\(two_images\) for"),
        (":number", {}, "this is not a method; found an object of class int"),
    ],
)
def test_wrong_references_are_one_sentence(
    name: str, options: dict[str, Any], message: str, methods_file: Path
) -> None:
    with pytest.raises(CallError, match=message):
        pliant.open_method(f"{methods_file}{name}", **options)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import no_such_library", "ModuleNotFoundError: No module named 'no_such_library'"),
        ("1 +", "SyntaxError"),
        ("x = 1\ny = {}['key']", "KeyError: 'key' .*line 2"),
    ],
)
def test_a_file_that_cannot_be_imported(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / f"broken_{tmp_path.name}.py"
    path.write_text(text)
    with pytest.raises(CallError, match=f"the module cannot be imported; found {message}"):
        pliant.open_method(f"{path}:Matcher")


def test_a_file_called_as_another_module(tmp_path: Path) -> None:
    (tmp_path / "json.py").touch()
    with pytest.raises(CallError, match=r"another module is called 'json'.*Rename the file"):
        pliant.open_method(f"{tmp_path}/json.py:Matcher")
    with pytest.raises(CallError, match="file not found"):
        pliant.open_method(f"{tmp_path}/missing.py:Matcher")


class Slots:
    __slots__ = ()

    def answer(self, pair: Pair) -> Answers:
        return Answers(pair.uv_a_px)


class BadMatches:
    def match(self, source: Frame, target: Frame) -> Any:
        return np.zeros((4, 2)), np.zeros((3, 2))


class ThreeArguments(Slots):
    def answer(self, source: Frame, target: Frame, uv_a_px: Any) -> Answers:  # type: ignore[override]
        raise NotImplementedError


class BadAnswer(Slots):
    def answer(self, pair: Pair) -> Any:
        return "near the middle"


def test_objects_that_are_no_matchers(cards: Dataset) -> None:
    for method, message in (
        (Slots(), "no 'name', and none can be set"),
        (ThreeArguments(), r"`answer` takes other arguments.*answer\(self, pair\)"),
        (Slots, "this is a class.*Pass an instance: Slots()"),
    ):
        with pytest.raises(CallError, match=message):
            as_matcher(method)
    with pytest.raises(CallError, match="a function of two images needs an adapter"):
        pliant.predict(cards, lambda source, target: source)  # type: ignore[arg-type, misc]
    with pytest.raises(SubmissionError, match=r"returned no matches; found \[\(4, 2\), \(3, 2\)\]"):
        pliant.predict(cards, BadMatches())  # type: ignore[arg-type]
    with pytest.raises(SubmissionError, match=r"'BadAnswer'.*found str; required: `Answers`"):
        pliant.predict(cards, BadAnswer())  # type: ignore[arg-type]
    with pytest.raises(
        SubmissionError, match=r"wrong shape.*found \(1, 20, 2\); required: \(20, 2\)"
    ):
        pliant.predict(cards, Positions(lambda uv_px: uv_px[None]))
    with pytest.raises(SubmissionError, match="something else than answers; found ndarray"):
        pliant.predict(cards, Positions(lambda uv_px: uv_px + 1j))


class Positions(Slots):
    """Answers with positions alone."""

    def __init__(self, made: Any) -> None:
        self._made = made

    name = "positions"

    def describe(self) -> dict[str, str]:
        return {}

    def answer(self, pair: Pair) -> Any:
        return self._made(pair.uv_a_px)


def test_an_answer_may_be_positions_alone(cards: Dataset) -> None:
    for made in (lambda uv_px: uv_px + 1, lambda uv_px: (uv_px + 1.0).astype(float).tolist()):
        np.testing.assert_array_equal(moved(cards, Positions(made)), [[1, 1]])


@pytest.mark.parametrize("name", ["", "  ", "\u200b", "sift\u200b", "\u3164", "a\x00b", "a\nb", 7])
def test_a_name_that_cannot_be_read_is_refused(name: Any, cards: Dataset) -> None:
    method = Positions(lambda uv_px: uv_px)
    method.name = name
    with pytest.raises(CallError, match="the method's name cannot be shown"):
        pliant.predict(cards, method)


def test_no_method_is_called_nothing() -> None:
    for name in ("", " "):
        with pytest.raises(CallError, match=f"there is no method '{name}'"):
            pliant.open_method(name)


def test_completed_object_keeps_what_it_has_and_can_be_sent() -> None:
    class Named:
        name = "mine"

        def describe(self) -> dict[str, int]:
            return {"radius": 3}

        def match(self, source: Frame, target: Frame) -> Matches:
            raise NotImplementedError

    matcher = as_matcher(Named())
    assert isinstance(matcher, KeypointMatcher)
    assert matcher.name == "mine"
    assert matcher.describe() == {"radius": 3, "interpolation": "affine, 8 nearest matches"}
    completed = pickle.loads(pickle.dumps(as_matcher(BadMatches(), "sent")))
    assert completed.name == "sent"


def test_options_are_recorded_for_a_method_that_does_not_describe_itself() -> None:
    class Bare:
        def answer(self, pair: Pair) -> Any:
            raise NotImplementedError

    described = as_matcher(Bare(), "bare", {"radius": 5, "places": Path("a")}).describe()
    assert described["options"] == {"radius": 5, "places": "PosixPath('a')"}
    assert "options" not in as_matcher(Bare()).describe()


def test_missing_extra_is_listed(called: Called, monkeypatch: pytest.MonkeyPatch) -> None:
    def make() -> None:
        """Return the method of another library."""
        raise MissingExtraError("the method", "classical")

    monkeypatch.setitem(pliant.baselines.METHODS, "needy", make)
    origins = {
        row["name"]: row["origin"] for row in json.loads(called("methods", "--json")[1])["methods"]
    }
    assert origins["don-rope"] == "shipped model"
    shown = " ".join(called("methods")[1].split())
    assert "needy Method of another library. Missing here; install it with: pip install" in shown
