"""The programs and snippets that the documentation shows."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pliant.baselines import Frame, Pair
from pliant.baselines.controls import RandomInMask
from pliant.baselines.predict import predict
from pliant.baselines.submission_file import write_template
from pliant.baselines.template import Template
from pliant.cli.main import run
from pliant.evaluator import check
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import read_footer, read_table
from tests.baselines.cards import Motion, Similarity

DOCS = Path(__file__).resolve().parents[2] / "docs"
EXAMPLE = DOCS / "examples" / "submit_without_pliant.py"


def code_with(text: str) -> str:
    """The block of code of the page about methods that contains a text."""
    page = (DOCS / "add-a-method.md").read_text()
    blocks: list[str] = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    return next(block for block in blocks if text in block)


def test_submission_without_pliant_is_the_same_submission(cards: Dataset, tmp_path: Path) -> None:
    theirs, ours = tmp_path / "theirs.parquet", tmp_path / "ours.parquet"
    subprocess.run([sys.executable, EXAMPLE, cards.root, "test", theirs], check=True)
    from pliant.baselines.controls import Identity

    predict(cards, "test", Identity(), ours)
    assert read_table(theirs, "answers").equals(read_table(ours, "answers"))
    footers = [read_footer(path) for path in (theirs, ours)]
    assert footers[0].pop("method") == {"name": "where-it-was"}
    footers[1].pop("method")
    assert footers[0] == footers[1]
    assert pq.read_schema(theirs).field("u").type == "float"


def test_example_needs_nothing_of_ours() -> None:
    text = EXAMPLE.read_text()
    assert not re.search(r"^\s*(import|from) pliant", text, re.MULTILINE)
    assert len(text.splitlines()) <= 32


def test_documented_matcher_answers_a_split(
    cards: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page's own code, run as it stands, with its dataset replaced by ours."""
    monkeypatch.chdir(tmp_path)
    Path("DATA").symlink_to(cards.root)
    code = code_with("class BrightestNeighbour")
    exec(compile(code, "add-a-method.md", "exec"), {"__name__": "page"})
    assert read_footer("mine.parquet")["method"] == {
        "name": "brightest-neighbour",
        "radius_px": 5,
        "mask": "given",
    }
    assert len(read_table("mine.parquet", "answers")) == 60


def test_documented_template_is_filled_as_the_page_fills_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    data = Path(__file__).resolve().parents[1] / "data" / "tiny-submission" / "dataset"
    Path("DATA").symlink_to(data)
    write_template(Dataset.open("DATA"), "test", "mine.parquet", name="mine")
    exec(compile(code_with("set_column"), "add-a-method.md", "exec"), {"__name__": "page"})
    assert check("mine.parquet", "DATA") == []


TEMPLATE = Path(__file__).resolve().parents[2] / "baselines" / "template.py"


def test_a_copy_of_it_is_a_method(
    cards: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(TEMPLATE, f"mine_{tmp_path.name}.py")
    call = f"predict mine_{tmp_path.name}.py:Template --data {cards.root} --out mine.parquet"
    assert run([*call.split(), "--set", "radius_px=3"]) == 0
    method = read_footer(Path("mine.parquet"))["method"]
    assert (method["name"], method["radius_px"]) == ("template", 3)


def test_it_beats_chance() -> None:
    moved = Motion(Similarity(), Similarity(centre=(127, 96)))
    median_px = {}
    for method in (Template(), RandomInMask()):
        found = method.answer(moved.pair).uv_px
        median_px[method.name] = np.median(moved.error(found))
    assert median_px["template"] < 2 < 20 < median_px["random"]


def test_without_a_mask_and_with_an_empty_one(cards: Dataset) -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (30, 40, 3)).astype(np.uint8)
    queries = np.array([[3.2, 4.7], [39.9, 29.9]], np.float32)
    found = Template().answer(Pair(Frame(rgb), Frame(rgb), queries)).uv_px
    np.testing.assert_array_equal(found, np.floor(queries) + 0.5)
    empty = Frame(rgb, np.zeros((30, 40), bool))
    np.testing.assert_array_equal(
        Template().answer(Pair(empty, empty, queries)).uv_px, [[20, 15]] * 2
    )
    assert Template().answer(Pair(Frame(rgb), Frame(rgb), queries[:0])).uv_px.shape == (0, 2)
