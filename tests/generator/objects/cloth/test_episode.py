"""Episodes: what the hand says it did is what the frames show, and nothing crosses."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from pliant.generator.objects.cloth.grid import grid_mesh
from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.generator.objects.cloth.handling import Action, grip, hand_path, hand_steps
from pliant.generator.objects.cloth.intersections import find_intersections
from pliant.generator.settings import ClothSettings
from tests.generator.world import scene

COARSE = ClothSettings(points_a_side=33)
FRAMES = 120

Frames = list[tuple[np.ndarray, dict[str, Any]]]
"""Vertices and facts of each frame."""


def test_the_hand_goes_where_it_is_told() -> None:
    action = Action("fold", 5, (0.3, -0.1), lift_m=0.2, lower_m=0.15, speed_m_s=0.5)
    path = hand_path(action)
    np.testing.assert_allclose(path[0], [0, 0, 0])
    np.testing.assert_allclose(path[-1], [0.3, -0.1, 0.05])
    assert path[:, 2].max() == pytest.approx(0.2)
    for dt_s in (1 / 500, 1 / 3000):
        moves = hand_steps(action, dt_s)
        np.testing.assert_allclose(moves.sum(axis=0), path[-1], atol=1e-12)
        speed = np.linalg.norm(moves, axis=1) / dt_s
        assert speed.max() <= 0.5 * 1.001
        assert speed.max() > 0.45
        assert speed[[0, -1]].max() < 0.05  # starts and ends gently


def test_a_grip_is_a_patch_cut_at_the_rim() -> None:
    grid = GridShape(4, 5)
    assert grip(0, grid).tolist() == [0, 1, 5, 6]
    assert grip(7, grid).tolist() == [1, 2, 3, 6, 7, 8, 11, 12, 13]
    assert grip(19, grid).tolist() == [13, 14, 18, 19]


@pytest.fixture(scope="module")
def frames() -> Frames:
    scene_object = scene("cloth-1", index=3, frames=FRAMES, episodes=True, cloth=COARSE)
    poses = [scene_object.pose(frame) for frame in range(FRAMES)]
    return [(pose.vertices["cloth"], dict(pose.info)) for pose in poses]


def test_an_episode_starts_flat_and_is_handled(frames: Frames) -> None:
    first, info = frames[0]
    assert np.ptp(first[:, 2]) < 1e-4
    assert info["coverage"] == pytest.approx(1.0, abs=0.01)
    names = {i["action"]["name"] for _, i in frames if i["action"]}
    numbers = [i["action"]["index"] for _, i in frames if i["action"]]
    assert names <= {"fold", "drop", "spread"}
    assert len(set(numbers)) >= 2
    assert numbers == sorted(numbers)
    assert any(i["action"] is None for _, i in frames)  # and let go of between
    assert min(i["coverage"] for _, i in frames) < 0.97


def test_the_hand_of_a_frame_holds_the_cloth_there(frames: Frames) -> None:
    held = 0
    for (_, before), (vertices, now) in itertools.pairwise(frames):
        moved = np.array(now["d_action"])
        # 0.6 m/s at 30 frames/s: a small action per frame.
        assert np.linalg.norm(moved) <= 0.6 / 30 * 1.01
        if now["action"] is None:
            assert now["hand"] is None
            assert not moved.any()
            continue
        hand = np.array(now["hand"])
        if before["action"] is not None and before["action"] == now["action"]:
            np.testing.assert_allclose(hand - np.array(before["hand"]), moved, atol=1e-12)
        u, v = now["action"]["picked"]
        picked = vertices.reshape(65, 65, 3)[round(v * 64), round(u * 64)]
        last_of_action = now is frames[-1][1] or moved[2] < 0  # let go within the frame
        assert np.linalg.norm(picked - hand) < 0.02 or last_of_action
        held += 1
    assert held > 40


def test_no_frame_of_an_episode_crosses_itself_or_jumps(frames: Frames) -> None:
    faces, edges = grid_mesh(GridShape(65, 65))
    for vertices, _ in frames[::3]:
        assert np.isfinite(vertices).all()
        assert len(find_intersections(vertices, faces, edges)) == 0
        assert vertices[:, 2].min() >= 0.001 - 1e-12
    places = np.stack([vertices for vertices, _ in frames])
    step_m = np.linalg.norm(np.diff(places, axis=0), axis=2)
    assert step_m.max() < 3.0 / 30
    assert np.abs(places[:, :, :2]).max() < 1.0  # stays about where the camera looks


def test_an_episode_of_a_higher_tier_starts_from_its_configuration() -> None:
    info = scene("cloth-3", index=3, frames=2, episodes=True, cloth=COARSE).pose(0).info
    assert 0.25 <= info["coverage"] <= 0.42
    assert info["start"]["actions"]
    assert info["start"]["coverage"] == info["coverage"]
