"""The static site: whole, relative, and silent about hidden answers when told to be."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pliant.cli.main import run
from pliant.evaluator import write_report
from pliant.evaluator.scores import read_scores
from tests.conftest import Refused


@pytest.fixture(scope="module")
def reports(scene: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two methods' reports, with pictures, in folders of hostile names."""
    folder = tmp_path_factory.mktemp("reports")
    rng = np.random.default_rng(0)
    for name, error_px in (("mine & co", 3.0), ("mine? co", 9.0)):
        table = scene.table(scene.true_px + rng.normal(0, error_px, (scene.rows, 2)))
        scores = scene.score(folder, table, name=f"<{error_px:g} px>")
        write_report(scores, folder / name, data=scene.root)
    return folder


def served(reports: Path, site: Path, *options: str) -> Path:
    assert run(["leaderboard", str(reports), "--out", str(site), *options]) == 0
    return site


def test_every_link_is_relative_and_leads_somewhere(reports: Path, tmp_path: Path) -> None:
    site = served(reports, tmp_path / "site")
    pages = sorted(site.rglob("*.html"))
    assert [page.relative_to(site).as_posix() for page in pages] == [
        "index.html",
        "reports/mine-co/report.html",
        "reports/mine-co-2/report.html",
    ]
    followed = set()
    for page in pages:
        links = re.findall(r'\b(?:href|src|action)="([^"]*)"', page.read_text())
        for link in links:
            if link.startswith(("data:", "#")):
                continue
            assert re.match(r"[a-z]+:|/", link) is None, link
            assert (page.parent / link).is_file(), (page, link)
            followed.add((page.parent / link).resolve())
    assert followed == {page.resolve() for page in pages}


def test_board_links_each_method_to_its_own_report(reports: Path, tmp_path: Path) -> None:
    site = served(reports, tmp_path / "site")
    board = (site / "index.html").read_text()
    found = re.findall(r'<a href="(reports/[^"]+)/report.html">([^<]+)</a>', board)
    assert [name for _, name in found] == ["&lt;3 px&gt;", "&lt;9 px&gt;"]  # the better first
    for place, name in found:
        assert read_scores(site / place).method == name.replace("&lt;", "<").replace("&gt;", ">")
        assert f"<h1>{name}</h1>" in (site / place / "report.html").read_text()


def test_readme_makes_a_static_space(reports: Path, tmp_path: Path) -> None:
    site = served(reports, tmp_path / "site", "--title", "Ropes: who is [first]?")
    _, front, text = (site / "README.md").read_text().split("---\n", 2)
    facts = yaml.safe_load(front)
    assert facts["sdk"] == "static"
    assert (site / facts["app_file"]).is_file()
    assert facts["title"] == "Ropes: who is [first]?"
    assert r"# Ropes: who is \[first\]?" in text


def test_scores_that_tell_answers_are_refused_where_the_truth_is_hidden(
    reports: Path, tmp_path: Path, refused: Refused, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(2, "leaderboard", reports, "--out", tmp_path / "no", "--hide-truth")
    assert "pliant evaluate --hide-truth" in said
    site = served(reports, tmp_path / "open")
    assert "Warning" not in capsys.readouterr().err
    report = (site / "reports/mine-co/report.html").read_text()
    assert 'class="pair"' in report
    assert "Small figures: 95 % intervals" in report
    assert len(list(site.rglob("per_pair.parquet"))) == 2


def numbers(path: Path) -> set[str]:
    """Every number with a decimal point in the text and the attributes of a file."""
    text = re.sub(r"<(style|script|pre)\b.*?</\1>", "", path.read_text(), flags=re.DOTALL)
    text = re.sub(r'"tools": \{.*?\}|<dt>Computed with</dt>.*?</dd>', "", text, flags=re.DOTALL)
    return set(re.findall(r"(?<![\w.])\d+\.\d+(?:e-?\d+)?", text))


def test_hidden_truth_stays_hidden(
    scene: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No picture, no table of pairs, headlines alone, and no number of more than four digits."""
    capped = tmp_path / "capped"
    for name, error_px in (("m", 93.1234), ("identity", 95.4321), ("centroid", 1.234567)):
        table = scene.table(scene.true_px + error_px)
        scores = scene.score(tmp_path, table, name=name, hide_truth=True)
        write_report(scores, capped / name, data=scene.root)
    site = served(capped, tmp_path / "site", "--hide-truth", "--title", "Who is first?")
    assert "Warning" not in capsys.readouterr().err
    for out in ("whole", "whole.html"):
        assert run(["leaderboard", str(capped), "--out", str(tmp_path / out)]) == 0
        assert "Warning: the reports were scored with --hide-truth" in capsys.readouterr().err
    board = (site / "index.html").read_text()
    for page in site.rglob("*.html"):  # they have no intervals to explain
        assert "Small figures" not in page.read_text()
    assert "<h1>Who is first?</h1>" in board
    assert "<title>Who is first?: " in board
    assert 'data-key="131.7">131.7' in board
    assert "(RMSE 1.746 px)" in board  # the banner's best control
    assert "<svg" not in board
    assert 'class="pair"' not in (site / "reports/m/report.html").read_text()
    shown = json.loads((site / "reports/m/scores.json").read_text())
    assert set(shown["overall"]) == set(shown["headline"])
    assert "counted" not in shown["counts"]
    files = [path for path in site.rglob("*") if path.is_file()]
    assert {path.suffix for path in files} == {".html", ".md", ".json"}
    for path in files:
        found = numbers(path)
        assert found, path
        long = {each for each in found if len(each.replace(".", "").strip("0")) > 4}
        long |= {each for each in found if len(each.lstrip("0.").replace(".", "")) > 4}
        assert not long, (path, long)


def test_site_is_replaced_and_nothing_else_is(
    reports: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = served(reports, tmp_path / "site")
    (site / "reports" / "old").mkdir()
    capsys.readouterr()
    served(reports, site, "--json")
    assert json.loads(capsys.readouterr().out)["reports"] == ["mine-co", "mine-co-2"]
    assert not (site / "reports" / "old").exists()
    (site / "mine.txt").touch()
    assert run(["leaderboard", str(reports), "--out", str(site)]) == 2
    assert "something other than a site; found mine.txt" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["site"]
