"""Episodes with a gripper and queries on points that move."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.generator.config import QuerySettings
from pliant.generator.settings import RopeSettings
from pliant.spec.dataset import Dataset
from tests.generator.world import made, newly_hidden, small

FRAMES = 24
CONFIG = small(
    size=(240, 180),
    splits={"test": 1},
    episodes=True,
    frames=FRAMES,
    seed=3,
    gripper=True,
    rope=RopeSettings(frame_rate_hz=15.0, substeps=96, hand_speed_m_s=(0.3, 0.6)),
    queries=QuerySettings(pairs_per_sequence=9, skips=(1, 5, 15), moving_share=0.5),
)


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return made(CONFIG, tmp_path_factory.mktemp("moving") / "episode")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    config = CONFIG.replace(gripper=False)
    return made(config, tmp_path_factory.mktemp("moving") / "plain")


def test_the_gripper_is_an_object_that_hides_points_and_is_never_asked(
    episode: Dataset, plain: Dataset
) -> None:
    tier = episode.tiers["rope"]
    assert [each.name for each in tier.objects] == ["rope", "ball", "gripper"]
    with_it, without = episode.sequences[0], plain.sequences[0]
    hidden = 0
    for frame, info in enumerate(with_it.info["frame_info"]):
        held = info["hand_m"] is not None
        shown = (with_it.surface(frame).object_id == 3).sum()
        assert (shown > 50) == held, frame
        newly = newly_hidden(with_it, without, frame)
        assert bool(newly) <= held
        hidden += newly
    assert hidden > 0


def test_asked_points_move_and_targets_are_never_sources(episode: Dataset) -> None:
    sequence, asked_pairs = episode.sequences[0], list(episode.pairs("test"))
    pairs = [(pair.source.index, pair.target.index) for pair in asked_pairs]
    assert {b - a for a, b in pairs} == {1, 5, 15}
    assert not {a for a, _ in pairs} & {b for _, b in pairs}
    uv = np.stack(
        [
            np.stack([sequence.correspondences(f)[name] for name in ("u_px", "v_px")], axis=1)
            for f in range(FRAMES)
        ]
    )
    for pair in asked_pairs:
        a = pair.source.index
        asked = [int(np.abs(uv[a] - each).sum(axis=1).argmin()) for each in pair.uv_a_px]
        far = np.linalg.norm(uv[[a + 1, a + 5, a + 15]][:, asked] - uv[a, asked], axis=2) > 4
        assert far.any(axis=0).mean() >= 0.5
