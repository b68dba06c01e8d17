"""`baselines/template.py`, the file to copy: it runs as its text says, and answers well."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from pliant.baselines import Frame, Pair
from pliant.baselines.controls import RandomInMask
from pliant.baselines.template import Template
from pliant.cli.main import run
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import read_footer
from tests.baselines.cards import Motion, Similarity

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
