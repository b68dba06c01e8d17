"""Nothing in the public queries tells the answers: attacks on published sets, without an image."""

from __future__ import annotations

import functools
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest

pytest.importorskip("numba", reason="making the datasets needs the extra 'generate'")
pytest.importorskip("scipy", reason="the attacks need the extra 'generate'")

from pliant.generator.config import GenerateConfig, QuerySettings
from pliant.generator.runner.dataset_files import write_dataset_files
from pliant.generator.runner.plan import plan_tasks
from pliant.generator.runner.run import generate
from pliant.generator.settings.cloth import ClothSettings
from pliant.publishing import PublishSettings, publish
from tests.attacks.attacked_queries import Answers, Queries, read_answers, read_queries
from tests.attacks.query_attacks import attack_everything
from tests.generator.runner.standin import InProcess

QUERIES = QuerySettings(queries_per_pair=32)
ROPES = GenerateConfig(
    tiers=("rope",),
    splits={"test": 10},
    queries=QUERIES,
    width=96,
    height=72,
    style="raster",
    seed=2_718_281_828_459_045,
    id="ropes",
)
CLOTHS = ClothSettings(points_a_side=33, tracked_a_side=33)
SETS = {
    "ropes": ROPES,
    "cloths": ROPES.replace(tiers=("cloth-1",), cloth=CLOTHS, id="cloths"),
    "episodes": ROPES.replace(
        splits={"test": 3},
        frames=12,
        episodes=True,
        queries=QUERIES.replace(pairs_per_sequence=12),
        id="episodes",
    ),
}
LONG = [pytest.param(name, marks=pytest.mark.long) for name in ("cloths", "episodes", "tracks")]

NAMES = ("pair", "source", "target", "uv_px", "visible", "point")
D = TypeVar("D", Queries, Answers)

Half = Callable[[str], tuple[Queries, Answers]]


@pytest.fixture(scope="module")
def half(tmp_path_factory: pytest.TempPathFactory) -> Half:
    """A function: name of a set -> its public queries and its answers; a set is made when asked.

    `tracks` asks the episodes' points from frame 0 on.
    """
    root = tmp_path_factory.mktemp("attacked")

    def make(name: str) -> Path:
        whole = root / name
        if whole.exists():
            return whole
        if name != "tracks":
            assert not generate(SETS[name], whole, engine=InProcess()).failed
            return whole
        tracks = SETS["episodes"].replace(queries=QUERIES.replace(kind="track"))
        shutil.copytree(make("episodes"), whole)
        write_dataset_files(tracks, plan_tasks(tracks), whole)
        return whole

    @functools.cache
    def read(name: str) -> tuple[Queries, Answers]:
        whole = make(name)
        settings = PublishSettings(hold_out=("test",), answers_are_public=True)
        facts = publish(whole, root / f"{name}-public", settings)
        assert not any("query pixels" in text for text in facts.warnings)
        ((tier, queries),) = read_queries(facts.public, "test").items()
        return queries, read_answers(whole, "test", tier)

    return read


@pytest.mark.parametrize("name", ["ropes", *LONG])
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(each, marks=pytest.mark.long) for each in (1, 2))]
)
def test_no_attack_beats_its_null(half: Half, name: str, seed: int) -> None:
    queries, answers = half(name)
    assert len(queries.pair) > 500
    leaks = [each for each in attack_everything(queries, answers, seed=seed) if each.leaks]
    assert leaks == []


def taken(data: D, rows: Any) -> D:
    """Return some rows of queries or answers, in a given order."""
    columns = [name for name in NAMES if hasattr(data, name)]
    return replace(data, **{name: getattr(data, name)[rows] for name in columns})


def leaks_of(queries: Queries, answers: Answers) -> set[str]:
    return {
        each.attack.split(" (")[0]
        for each in attack_everything(queries, answers, draws=12)
        if each.leaks
    }


@pytest.mark.parametrize("name", ["ropes", LONG[0]])
def test_sorted_rows_are_noticed(half: Half, name: str) -> None:
    queries, answers = half(name)
    order = np.lexsort((answers.point, queries.pair))
    shown = {}
    for frame in queries.shown:
        asked = answers.point[queries.source == frame][: len(queries.shown[frame])]
        shown[frame] = queries.shown[frame][np.argsort(asked)]
    found = leaks_of(
        replace(queries, uv_px=queries.uv_px[order], shown=shown), taken(answers, order)
    )
    assert {"rank, one axis", "columns of a row and its answer"} <= found
    assert name == "ropes" or "rank, two axes" in found


@pytest.mark.parametrize("name", ["ropes", LONG[2]])
def test_answers_among_the_query_pixels_are_noticed(half: Half, name: str) -> None:
    """The target frame asks the very points that it is asked about."""
    queries, answers = half(name)
    shown = {}
    for frame in np.unique(queries.target):
        rows = np.flatnonzero((queries.target == frame) & answers.visible)
        shown[int(frame)] = np.random.default_rng(0).permutation(answers.uv_px[rows])
    found = leaks_of(replace(queries, shown=shown), answers)
    assert "answers among query pixels" in found
    assert name == "ropes" or "assignment" in found  # frames of an episode are almost similar


def test_points_left_out_are_noticed(half: Half) -> None:
    """Each pair leaves out the points that its target does not show."""
    queries, answers = half("ropes")
    keep = answers.visible
    assert "missing points visible" in leaks_of(taken(queries, keep), taken(answers, keep))
