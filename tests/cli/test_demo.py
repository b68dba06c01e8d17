"""The whole chain with one command: it runs, it repeats itself to the byte, it refuses."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from pliant.benchmarks.suite import config_file
from pliant.cli.main import run
from pliant.service.challenge import is_challenge
from tests.benchmarks.jobs_here import jobs_here
from tests.folders import files_of

pytestmark = pytest.mark.slow

FEW = [
    *(f"sets.{name}.style=raster" for name in ("rope", "cloth")),
    "sets.cloth.cloth={points_a_side: 33, tracked_a_side: 17}",
    *(f"tests.{name}.methods=[sift, oracle]" for name in ("rope", "cloth-1", "cloth-3")),
    *(f"tests.{name}.shipped=[]" for name in ("rope", "cloth-1", "cloth-3")),
]
"""What makes the demo quick: neither Blender nor a network, and coarse cloths."""

COMPARED = {".json", ".parquet", ".exr", ".png"}


def demo(out: Path) -> None:
    small = ["--sequences", "1", "--frames", "2", "--size", "160x120", "--workers", "1"]
    assert run(["demo", "--out", str(out), *small]) == 0


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demo") / "a"
    with jobs_here():
        demo(folder)
    return folder


def test_one_picture_is_no_pair(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "demo"
    assert run(["demo", "--out", str(out), "--sequences", "1", "--frames", "1"]) == 2
    assert "a pair takes two pictures" in capsys.readouterr().err
    assert not out.exists()


def test_with_few_methods(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every stage of the demo, from the sets to the page and the challenge."""
    read = config_file.read_config
    monkeypatch.setattr(config_file, "read_config", lambda path, given: read(path, [*given, *FEW]))
    out = tmp_path / "demo"
    with jobs_here():
        demo(out)
    for name, tiers in (("rope", {"rope"}), ("cloth", {"cloth-1", "cloth-3"})):
        for method in ("sift", "oracle"):
            path = out / "scores" / name / f"{method}--given" / "standard" / "scores.json"
            scores = json.loads(path.read_text())["tiers"]
            assert set(scores) == tiers
            assert all((found["rmse_px"] == 0) == (method == "oracle") for found in scores.values())
    page = (out / "report" / "index.html").read_text()
    assert all(words in page for words in ("SIFT", "Cloth 3", "best matches"))
    assert is_challenge(out / "challenge")


def files(root: Path) -> dict[str, bytes]:
    """Everything except the logs and the notes of what each stage cost."""
    return {
        name: data
        for name, data in files_of(root).items()
        if Path(name).suffix in COMPARED
        and not {".pliant", "stages", "table.json"} & set(Path(name).parts)
    }


@pytest.mark.blender
@pytest.mark.long
def test_twice_gives_the_same_bytes(made: Path, tmp_path: Path) -> None:
    demo(tmp_path / "again")
    first, second = files(made), files(tmp_path / "again")
    assert first.keys() == second.keys()
    assert [name for name in first if first[name] != second[name]] == []
    assert any(name.startswith("sets/rope/truth/") for name in first)
    assert any(name.endswith("scores.json") for name in first)


@pytest.mark.blender
@pytest.mark.long
def test_oracle_is_perfect_and_the_others_are_plausible(made: Path) -> None:
    methods = ("sift", "surf", "orb", "identity", "random", "centroid", "oracle")
    tiers = {"rope": {"rope"}, "cloth": {"cloth-1", "cloth-3"}}
    asked = [(each, method) for each in tiers for method in (*methods, f"don-{each}")]
    for name, method in asked:
        path = made / "scores" / name / f"{method}--given" / "standard" / "scores.json"
        scores = json.loads(path.read_text())
        assert set(scores["tiers"]) == tiers[name]
        for values in scores["tiers"].values():
            if method == "oracle":
                assert values["rmse_px"] == 0
                assert all(values[f"pck_{each}px"] == 1 for each in (1, 2, 4, 8, 16, 32))
            else:
                least_px = 0.3 if method.startswith("don-") else 1
                assert least_px < values["rmse_px"] < 200  # the diagonal of 160 x 120


@pytest.mark.blender
@pytest.mark.long
def test_page_shows_table_frames_and_matches(made: Path) -> None:
    page = (made / "report" / "index.html").read_text()
    shown = ("SIFT", "SURF", "ORB", "mahotas", "Cloth 3", "best matches", "don-rope", "don-cloth")
    for words in shown:
        assert words in page
    assert page.count("data:image/png") >= 3
    (verdict,) = re.findall(r'<div class="verdict"><p>(.*)</p>', page)
    assert re.fullmatch(r"Rope.*|Cloth.*", verdict)
    learned, local, _control = map(float, re.findall(r"by (\d+) px", verdict))
    assert learned < local
    bars = page[page.index('<table class="bars">') :]
    widths = re.findall(r"width: ([\d.]+)%", bars[: bars.index("</table>")])
    lengths = list(map(float, widths))
    assert lengths == sorted(lengths)
    assert (lengths[0], lengths[-1]) == (0, 70)  # the oracle and the worst method
    assert '<a href="#scores">' in page
    outside = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    assert "http://" not in outside.replace("http://www.w3.org", "")
    assert "https://" not in outside


def test_foreign_folder_is_refused_and_kept(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    assert run(["demo", "--out", str(tmp_path)]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
