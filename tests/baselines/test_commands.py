"""`pliant predict` and `pliant match` as they are typed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from PIL import Image

from pliant.baselines import METHODS
from pliant.spec.io.parquet import read_footer, read_table
from tests.conftest import Called


def test_predict_says_what_it_wrote(cards_root: Path, tmp_path: Path, called: Called) -> None:
    out = tmp_path / "surf.parquet"
    code, said, _ = called("predict", "surf", "--data", cards_root, "--out", out)
    assert code == 0
    assert "60 answers for 3 pairs of cards/test by surf (mahotas " in said
    assert len(read_table(out, "answers")) == 60


def test_predict_reports_as_json(cards_root: Path, tmp_path: Path, called: Called) -> None:
    out = tmp_path / "orb.parquet"
    code, said, _ = called(
        *("predict", "orb", "--data", cards_root, "--out", out), *("--kind", "matches", "--json")
    )
    document = json.loads(said)
    assert code == 0
    assert document["rows"] == len(read_table(out, "matches"))
    assert document["method"] == read_footer(out)["method"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"METHOD": "siftt"}, "no method 'siftt'; required: one of sift, surf, orb, lk-chain"),
        ({"METHOD": "siftt"}, "Did you mean sift?"),
        ({"--split": "train"}, "no queries for split 'train'; required: test"),
        ({"--kind": "matches"}, "no keypoint matches of its own"),
    ],
)
def test_bad_predict_calls(
    change: dict[str, str],
    message: str,
    cards_root: Path,
    tmp_path: Path,
    called: Called,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    call = {"METHOD": "centroid", "--data": str(cards_root), "--out": "out.parquet", **change}
    method = call.pop("METHOD")
    options = [part for pair in call.items() for part in pair]
    found, said, complaint = called("predict", method, *options)
    assert (found, said) == (2, "")
    assert message in complaint
    assert list(tmp_path.iterdir()) == []


def test_match_draws_and_reports(cards_root: Path, tmp_path: Path, called: Called) -> None:
    frames = cards_root / "sequences/card/card-test-000000/rgb"
    out = tmp_path / "figure.png"
    arguments = ["--source", frames / "000000.png", "--target", frames / "000001.png"]
    code, said, _ = called("match", "sift", *arguments, "--at", "120,100", "--out", out, "--json")
    document = json.loads(said)
    assert code == 0
    assert document["match_px"] == pytest.approx([122.3, 97.6], abs=2)  # the card's middle
    assert document["figure"] == str(out)
    with Image.open(out) as figure:
        assert figure.width > 1000


@pytest.mark.parametrize(
    ("method", "at", "message"),
    [
        ("oracle", "120,100", "answers the queries of a dataset"),
        ("sift", "120", "two numbers"),
        ("sift", "a,b", "two numbers"),
        ("sift", "1_0,5", "two numbers"),
        ("sift", "400,100", "outside the source picture"),
    ],
)
def test_bad_match_calls(
    method: str, at: str, message: str, cards_root: Path, tmp_path: Path, called: Called
) -> None:
    picture = cards_root / "sequences/card/card-test-000000/rgb/000000.png"
    code, said, complaint = called(
        *("match", method, "--source", picture, "--target", picture),
        *("--at", at, "--out", tmp_path / "figure.png"),
    )
    assert (code, said) == (2, "")
    assert message in complaint
    assert list(tmp_path.iterdir()) == []


def test_every_method_is_listed(called: Called) -> None:
    _, said, _ = called("methods")
    assert re.search(r"don-cloth +Trained on tiers cloth-1, cloth-2 and cloth-3\.\n", said)
    assert {*METHODS} <= {line.split()[0] for line in said.splitlines()}
    _, said, _ = called("match", "--help")
    assert "pliant methods" in said
