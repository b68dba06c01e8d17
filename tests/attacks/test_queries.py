"""Nothing in the public queries tells the answers: attacks on published sets, without an image."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

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

SMALL: dict[str, Any] = {
    "width": 96,
    "height": 72,
    "style": "raster",
    "seed": 2_718_281_828_459_045,
}
SETS = {
    "configurations": GenerateConfig(
        tiers=("rope", "cloth-1"),
        splits={"test": 10},
        cloth=ClothSettings(points_a_side=33, tracked_a_side=33),
        queries=QuerySettings(queries_per_pair=32),
        id="configurations",
        **SMALL,
    ),
    "episodes": GenerateConfig(
        tiers=("rope",),
        splits={"test": 3},
        frames=12,
        episodes=True,
        queries=QuerySettings(pairs_per_sequence=12, queries_per_pair=32),
        id="episodes",
        **SMALL,
    ),
}
CASES = [
    ("configurations", "rope"),
    ("configurations", "cloth-1"),
    ("episodes", "rope"),
    ("tracks", "rope"),
]


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, Path]]:
    """Each set as (public half, whole); `tracks` asks the episodes' points from frame 0 on."""
    root = tmp_path_factory.mktemp("attacked")
    made = {}
    for name, config in SETS.items():
        assert not generate(config, root / name, engine=InProcess()).failed
        made[name] = config
    tracks = SETS["episodes"].replace(queries=QuerySettings(queries_per_pair=32, kind="track"))
    shutil.copytree(root / "episodes", root / "tracks")
    write_dataset_files(tracks, plan_tasks(tracks), root / "tracks")
    halves = {}
    for name in (*made, "tracks"):
        settings = PublishSettings(hold_out=("test",), answers_are_public=True)
        facts = publish(root / name, root / f"{name}-public", settings)
        assert not any("query pixels" in text for text in facts.warnings)
        halves[name] = facts.public, root / name
    return halves


def half(published: dict[str, tuple[Path, Path]], name: str, tier: str) -> tuple[Queries, Answers]:
    public, whole = published[name]
    return read_queries(public, "test")[tier], read_answers(whole, "test", tier)


@pytest.mark.parametrize(("name", "tier"), CASES)
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(each, marks=pytest.mark.long) for each in (1, 2))]
)
def test_no_attack_beats_its_null(
    published: dict[str, tuple[Path, Path]], name: str, tier: str, seed: int
) -> None:
    queries, answers = half(published, name, tier)
    assert len(queries.pair) > 500
    leaks = [each for each in attack_everything(queries, answers, seed=seed) if each.leaks]
    assert leaks == []


def leaks_of(queries: Queries, answers: Answers) -> set[str]:
    return {
        each.attack.split(" (")[0] for each in attack_everything(queries, answers) if each.leaks
    }


@pytest.mark.parametrize("tier", ["rope", "cloth-1"])
def test_sorted_rows_are_noticed(published: dict[str, tuple[Path, Path]], tier: str) -> None:
    queries, answers = half(published, "configurations", tier)
    order = np.lexsort((answers.point, queries.pair))
    shown = {}
    for frame in queries.shown:
        asked = answers.point[queries.source == frame][: len(queries.shown[frame])]
        shown[frame] = queries.shown[frame][np.argsort(asked)]
    told = replace(queries, uv_px=queries.uv_px[order], shown=shown)
    true = replace(
        answers,
        uv_px=answers.uv_px[order],
        visible=answers.visible[order],
        point=answers.point[order],
    )
    found = leaks_of(told, true)
    assert {"rank, one axis", "columns of a row and its answer"} <= found
    assert tier == "rope" or "rank, two axes" in found


def test_answers_among_the_query_pixels_are_noticed(
    published: dict[str, tuple[Path, Path]],
) -> None:
    """The target frame asks the very points that it is asked about."""
    queries, answers = half(published, "tracks", "rope")
    shown = {}
    for frame in np.unique(queries.target):
        rows = np.flatnonzero((queries.target == frame) & answers.visible)
        shown[int(frame)] = np.random.default_rng(0).permutation(answers.uv_px[rows])
    found = leaks_of(replace(queries, shown=shown), answers)
    assert {"assignment", "answers among query pixels"} <= found


def test_points_left_out_are_noticed(published: dict[str, tuple[Path, Path]]) -> None:
    """Each pair leaves out the points that its target does not show."""
    queries, answers = half(published, "configurations", "rope")
    keep = answers.visible
    told = replace(
        queries,
        pair=queries.pair[keep],
        source=queries.source[keep],
        target=queries.target[keep],
        uv_px=queries.uv_px[keep],
    )
    true = replace(
        answers,
        uv_px=answers.uv_px[keep],
        visible=answers.visible[keep],
        point=answers.point[keep],
    )
    assert "missing points visible" in leaks_of(told, true)
