"""Ropes, cables and cloths next to the object: in the picture and the truth, never asked about."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pliant.generator.config import QuerySettings
from pliant.generator.objects.tiers import sample_scene_object
from pliant.generator.seeding import SequenceTask
from pliant.generator.settings import SceneSettings
from pliant.spec.dataset import Dataset
from pliant.spec.sequence import RecordedFrame
from tests.generator.world import made, newly_hidden, small
from tests.known import known

CONFIG = small(
    size=(200, 150),
    seed=11,
    scene=SceneSettings(distractors=(2, 3), distractor_over=1.0),
    queries=QuerySettings(pairs_per_sequence=2, queries_per_pair=16),
)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, Dataset]:
    """The same ropes with distractors over them, and alone."""
    root = tmp_path_factory.mktemp("distractors")
    return made(CONFIG, root / "with"), made(CONFIG.replace(scene=SceneSettings()), root / "alone")


def test_they_are_objects_of_the_dataset(pair: tuple[Dataset, Dataset]) -> None:
    tier = pair[0].tiers["rope"]
    assert [each.name for each in tier.objects] == [
        "rope", "ball", "distractor-1", "distractor-2", "distractor-3",
    ]  # fmt: skip
    configs = [json.loads((each.root / "dataset.json").read_bytes())["provenance"] for each in pair]
    # Datasets without distractors keep their bytes.
    assert ["scene" in each["config"] for each in configs] == [True, False]


def test_the_object_is_the_same_and_partly_hidden(pair: tuple[Dataset, Dataset]) -> None:
    hidden = 0
    for with_them, alone in zip(*(each.sequences for each in pair), strict=True):
        hidden += newly_hidden(with_them, alone, 0)
        assert 2 <= len(with_them.info["parameters"]["distractors"]) <= 3
    assert hidden > 0


def test_their_masks_are_separate(pair: tuple[Dataset, Dataset]) -> None:
    for sequence in pair[0].sequences:
        frame = RecordedFrame(sequence, 0)
        ids = frame.object_ids
        assert ids is not None
        assert (ids > 2).sum() > 200
        np.testing.assert_array_equal(known(frame.mask), ids == 1)
        np.testing.assert_array_equal(known(frame.objects), (ids == 1) | (ids == 2))


@pytest.mark.parametrize("tier", ["rope", pytest.param("cloth-1", marks=pytest.mark.long)])
def test_no_distractor_is_inside_the_object(tier: str) -> None:
    """Each is above every vertex of the object that is below its own vertices."""
    kinds = {"rope": 1.0, "cable": 1.0, "cloth": 1.0}
    scene = SceneSettings(distractors=(4, 4), distractor_kinds=kinds, distractor_over=1.0)
    config = CONFIG.replace(tiers=(tier,), scene=scene)
    config = config.replace(cloth=config.cloth.replace(points_a_side=25, tracked_a_side=17))
    over = 0
    for index in range(2):
        scene_object = sample_scene_object(config, SequenceTask(tier, "test", index))
        vertices = scene_object.pose(0).vertices
        tops = np.concatenate([vertices[name] for name in vertices if "distractor" not in name])
        tree = cKDTree(tops[:, :2])
        for part in scene_object.parts:
            if part.colour is None:
                continue
            own = vertices[part.name]
            assert own[:, 2].min() >= 0
            for place, below in zip(own, tree.query_ball_point(own[:, :2], 0.004), strict=True):
                if below:
                    over += 1
                    assert place[2] >= tops[below, 2].max() - 1e-9
    assert over > 20


def test_next_to_the_object_where_there_is_room(tmp_path: Path) -> None:
    """Without `distractor_over` a smooth rope keeps nearly all of its visible points."""
    scene = SceneSettings(distractors=(2, 2), distractor_over=0.0)
    rope = CONFIG.rope.replace(shapes={"open": 1.0})
    for sequence in made(CONFIG.replace(scene=scene, rope=rope), tmp_path / "d").sequences:
        states = np.array(sequence.correspondences(0)["visibility"].to_pylist())
        assert (states == "occluded").mean() < 0.1
