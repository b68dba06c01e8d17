"""Halves of a dataset and its bundle."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.publishing.competition.bundle import write_bundle
from tests.evaluator.conftest import Scene, make_scene


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """The analytic scene of the evaluator's tests."""
    return make_scene(tmp_path_factory.mktemp("analytic"))


@pytest.fixture(scope="session")
def halves(scene: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """What everybody gets of the analytic scene, and what is kept back."""
    folder = tmp_path_factory.mktemp("halves")
    public, private = folder / "public", folder / "private"
    (public / "queries").mkdir(parents=True)
    private.mkdir()
    for name in ("dataset.json", "sequences.parquet"):
        shutil.copy(scene.root / name, public)
        shutil.copy(scene.root / name, private)
    shutil.copy(scene.root / "queries" / "test.parquet", public / "queries")
    shutil.copytree(scene.root / "truth", private / "truth")
    without_colour = shutil.ignore_patterns("rgb")
    shutil.copytree(scene.root / "sequences", private / "sequences", ignore=without_colour)
    return public, private


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with the form of a wheel of Pliant; .ci/wheel scores with a real one."""
    path = tmp_path_factory.mktemp("wheel") / "pliant-0.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("pliant/__init__.py", "")
    return path


@pytest.fixture(scope="session")
def bundles(
    halves: tuple[Path, Path], wheel: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The folder that `pliant publish --bundle` leaves in the private half."""
    out = tmp_path_factory.mktemp("bundles") / "codabench"
    write_bundle(*halves, wheel, out)
    return out


@pytest.fixture(scope="session")
def submission(scene: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Answers off by some pixels, with probabilities and spreads, for every metric."""
    rng = np.random.default_rng(3)
    answers = scene.table(
        scene.true_px + rng.normal(0, 6, (scene.rows, 2)),
        visible=rng.random(scene.rows).astype(np.float32),
        sigma=rng.uniform(2, 9, scene.rows).astype(np.float32),
    )
    return scene.submit(tmp_path_factory.mktemp("submission") / "mine.parquet", answers)
