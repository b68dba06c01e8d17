"""`import pliant`: load, predict, evaluate and validate in memory."""

from __future__ import annotations

import dataclasses
import doctest
import importlib
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pliant
from pliant.baselines import METHODS
from pliant.baselines.predict import predict as predict_file
from pliant.evaluator import evaluate as evaluate_file
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, MissingExtraError, SpecError
from pliant.spec.opening import SAMPLE
from tests.known import known

README = Path(__file__).parents[1] / "README.md"
DOCUMENT = Path(__file__).parents[1] / "docs" / "python.md"


@pytest.fixture(scope="module")
def ds(tiny_dataset: Path) -> Dataset:
    return pliant.load(tiny_dataset)


API_PAGE = (
    (DOCUMENT.parent / "site_pages.py").read_text().partition("API: Final")[2].partition("}")[0]
)
DOCUMENTED = re.findall(r'"((?:\w+\.)+\w+)"', API_PAGE)
"""Names below `pliant` in the site's API reference."""

NEEDS = {"scene": "bpy", "loaders": "torch", "models": "torch", "streaming": "torch"}
"""Package -> module of the extra that it needs."""


def test_public_names_are_documented_and_others_do_not_exist() -> None:
    assert all(getattr(pliant, name) for name in pliant.__all__)
    assert {f"api.{name}" for name in pliant.__all__[1:]} <= set(DOCUMENTED)
    with pytest.raises(AttributeError, match="no attribute 'lod'"):
        pliant.lod  # noqa: B018


@pytest.mark.parametrize("where", DOCUMENTED)
def test_every_public_function_has_an_example_that_runs(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, _, name = where.rpartition(".")
    needed = NEEDS.get(where.partition(".")[0], "numpy")
    pytest.importorskip("torch" if name == "stream" else needed)
    monkeypatch.chdir(tmp_path)
    documented = getattr(importlib.import_module(f"pliant.{module}"), name)
    names = {"pliant": pliant, "Path": Path}
    (test,) = doctest.DocTestFinder(recurse=False).find(documented, name, globs=names)
    assert test.examples
    assert doctest.DocTestRunner().run(test).failed == 0


def test_dataset_is_a_collection_of_sequences(ds: Dataset) -> None:
    assert len(ds) == 15
    assert ds["rope-test-000000"].id == "rope-test-000000"
    assert [each.id for each in ds] == [ds[index].id for index in range(15)]
    assert repr(ds).startswith("Dataset('tiny' ")
    assert "15 sequences (train 6, val 3, test 6), 30 frames" in repr(ds)
    assert len(repr(ds)) < 160
    with pytest.raises(SpecError, match="no such sequence"):
        ds["rope-test-999999"]


def test_frames_of_a_split_and_tier(ds: Dataset) -> None:
    frames = ds.frames("test", "rope")
    assert [frame.key for frame in frames] == [
        f"rope-test-00000{sequence}/{index}" for sequence in (0, 1) for index in (0, 1)
    ]
    frame = frames[0]
    assert frame.rgb.shape == (120, 160, 3)
    assert frame.mask is not None
    assert np.isfinite(known(frame.depth_m)[frame.mask]).all()
    assert 0 < frame.mask.sum() < frame.mask.size
    assert frame.camera is not None
    assert frame.camera.K.shape == (3, 3)
    assert frame.camera.world_to_camera.shape == (4, 4)
    assert len(frame.correspondences) == len(frame.sequence.points())
    assert ds["rope-test-000000"][-1] == frames[1]
    with pytest.raises(CallError, match="no such frames"):
        ds.frames("tets")


def test_pairs_follow_the_queries_file(ds: Dataset) -> None:
    pairs = ds.pairs("test")
    table = ds.queries("test")
    assert sum(len(pair) for pair in pairs) == len(table)
    stacked = np.concatenate([pair.queries for pair in pairs])
    np.testing.assert_array_equal(stacked[:, 0], table["u_a"].to_numpy())
    asked = [(pair.source.sequence.id, pair.target.index) for pair in pairs for _ in pair.queries]
    expected = zip(table["sequence_a"].to_pylist(), table["frame_b"].to_pylist(), strict=True)
    assert asked == list(expected)
    assert re.fullmatch(r"QueryPair\(0: \S+ -> \S+, \d+ queries\)", repr(pairs[0]))


def test_predicting_and_scoring_in_memory_equal_the_files(ds: Dataset, tmp_path: Path) -> None:
    answers = pliant.predict(ds, "sift")
    file, memory = tmp_path / "file.parquet", tmp_path / "memory.parquet"
    predict_file(ds, "test", METHODS["sift"](), file)
    assert answers.write(memory).read_bytes() == file.read_bytes()
    expected = evaluate_file(file, ds).overall
    for given in (answers, memory, answers.to_table()):
        assert pliant.evaluate(ds, given).overall == expected


def test_answers_to_another_dataset_are_refused(ds: Dataset) -> None:
    """As many queries with the same numbers do not make them answers to these queries."""
    sample = pliant.predict("sample", "identity")
    of_another = dataclasses.replace(sample, dataset=ds)
    with pytest.raises(CallError, match=r"answers: .*other queries; found SplitAnswers"):
        pliant.evaluate("sample", of_another)
    assert pliant.evaluate(SAMPLE, sample).overall["rmse_px"] is not None


def test_a_generated_dataset_validates(tiny_dataset: Path, tiny_episode: Path, ds: Dataset) -> None:
    report = pliant.validate(ds)
    for each in (report, pliant.validate(tiny_episode)):
        assert [str(issue) for issue in each.issues] == []
    assert pliant.validate(tiny_dataset) == report
    assert report.frames == 30


def test_the_ten_lines_of_the_readme_run(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    assert len([line for line in code.splitlines() if line]) <= 10
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    rmse_px, pck = map(float, done.stdout.split())
    assert 30 < rmse_px < 80  # the centroid of a rope in pictures of 256 x 192
    assert 0 <= pck < 0.1


def test_the_documented_example_runs(
    tiny_dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every Python block of docs/python.md, in order, on the tiny dataset."""
    blocks = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    assert len(blocks) >= 4
    code = "\n".join(blocks)
    code = code.replace('"DATA"', repr(str(tiny_dataset)))
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(DOCUMENT), "exec"), {"__name__": "example"})
    assert (tmp_path / "centre.parquet").stat().st_size > 1000


def test_a_mistyped_folder_without_a_network_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`sets/ropes` may be the id of a dataset on the Hub, whose library has errors of its own."""
    core = pytest.importorskip("fsspec").core

    class Unreachable:
        def isfile(self, _: str) -> bool:
            raise RuntimeError("Name or service not known")

    monkeypatch.setattr(core, "url_to_fs", lambda url: (Unreachable(), url))
    with pytest.raises(SpecError, match=r"^sets/ropes: folder not found.*not known$"):
        pliant.load("sets/ropes")
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(MissingExtraError, match=r"^folder sets/ropes not found, and .*publish"):
        pliant.load("sets/ropes")
