"""Halves of a dataset, its bundles, and a Python in which only the base dependencies exist."""

from __future__ import annotations

import shutil
import sys
import venv
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from packaging.requirements import Requirement

from pliant.publishing.competition.bundle import write_bundle
from pliant.publishing.competition.wheel import LIBRARIES
from tests.evaluator.conftest import Scene, make_scene


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """The analytic scene of the evaluator\'s tests."""
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
def bundles(halves: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that `pliant publish` leaves in the private half."""
    out = tmp_path_factory.mktemp("bundles") / "codabench"
    write_bundle(*halves, out)
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


@pytest.fixture(scope="session")
def bare_python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Python whose environment holds the libraries that scoring needs, and nothing else.

    The environment is made without pip; each library, and what it requires in turn, is linked
    into it file by file from where it is installed here. Pliant itself is not among them.
    """
    folder = tmp_path_factory.mktemp("bare") / "venv"
    venv.create(folder, symlinks=True, with_pip=False)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    site = folder / "lib" / version / "site-packages"
    for name in _closure(LIBRARIES):
        distribution = metadata.distribution(name)
        tops = {file.parts[0] for file in distribution.files or () if file.parts[0] != ".."}
        for top in tops - {"__pycache__"}:
            target = site / top
            if not target.exists():
                target.symlink_to(Path(str(distribution.locate_file(top))))
    return folder / "bin" / "python"


def _closure(names: Any) -> set[str]:
    found: set[str] = set()
    waiting = list(names)
    while waiting:
        name = waiting.pop().lower()
        if name in found:
            continue
        found.add(name)
        for line in metadata.requires(name) or ():
            required = Requirement(line)
            if required.marker is None or required.marker.evaluate({"extra": ""}):
                waiting.append(required.name)
    return found
