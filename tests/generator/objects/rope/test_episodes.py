"""Episodes: physics by the rule, actions as recorded, frames that repeat to the byte."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.generator.objects.rope.body import RopeBody
from pliant.generator.objects.rope.dynamics import RopeState
from pliant.generator.objects.rope.episode import Episode, next_action
from pliant.generator.settings import RopeSettings
from tests.generator.objects.rope.test_shapes import closest_stretches
from tests.generator.world import scene

SETTINGS = RopeSettings()


@pytest.mark.parametrize("shape", [pytest.param("open", marks=pytest.mark.long), "knot"])
def test_the_rules_hold_through_an_episode(shape: str) -> None:
    episode = Episode(RopeBody(SETTINGS), shape, lambda: np.random.default_rng(8))
    spacing = SETTINGS.length_m / (SETTINGS.particles - 1)
    before = episode.state.centreline()
    for frame in range(600):
        episode.step()
        line = episode.state.centreline()
        assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(
            SETTINGS.length_m, rel=0.03
        )
        pieces = np.linalg.norm(np.diff(episode.state.chain, axis=0), axis=1) / spacing
        assert np.abs(pieces - 1).max() < 0.03
        assert line[:, 2].min() >= SETTINGS.radius_m * (1 - 1e-9)
        # No faster than the cap on speeds, whatever the hand does.
        assert np.linalg.norm(line - before, axis=1).max() < 2.1 / SETTINGS.frame_rate_hz
        before = line
        if frame % 20 == 0:
            nearest = closest_stretches(line, 2.5 * SETTINGS.diameter_m)
            assert nearest >= 0.9 * SETTINGS.diameter_m
    assert episode.info["action"] >= 3


def test_crossings_form_only_because_points_are_lifted() -> None:
    """An open rope gets crossings; the strand on top lies over the one it crossed."""
    settings = RopeSettings(ball=False)
    episode = Episode(RopeBody(settings), "open", lambda: np.random.default_rng(2))
    seen = 0
    for frame in range(900):
        episode.step()
        if frame % 30 == 0:
            for crossing in episode.pose(episode.frame).info["crossings"]:
                seen += 1
                assert crossing["position_m"][2] > 2.5 * settings.radius_m
    assert seen > 0


def test_actions_are_recorded_frame_by_frame() -> None:
    scene_object = scene("rope", frames=200, episodes=True)
    last = -1
    hand = None
    for frame in range(200):
        info = scene_object.pose(frame).info
        if frame == 0:
            assert info["phase"] == "start"
            assert len(info["start_control_points_m"]) == len(info["start_handles_m"])
            continue
        assert info["action"] in (last, last + 1)
        moved = np.array(info["d_action"])
        if info["phase"] == "wait":
            assert info["hand_m"] is None
            assert not moved.any()
            hand = None
        else:
            assert 0.0 <= info["picked_s"] <= 1.0
            if hand is not None and info["action"] == last:
                np.testing.assert_allclose(hand + moved, info["hand_m"], atol=1e-12)
            hand = np.array(info["hand_m"])
            # The paper's nodes moved by up to 0.03 a frame.
            assert np.linalg.norm(moved) < 0.03
        last = info["action"]


def test_the_held_point_goes_where_the_hand_goes() -> None:
    episode = Episode(RopeBody(SETTINGS), "open", lambda: np.random.default_rng(1))
    lifted = 0.0
    for _ in range(120):
        episode.step()
        if episode.info["phase"] in ("lift", "carry"):
            held = round(episode.info["picked_s"] * (SETTINGS.particles - 1))
            hand = np.array(episode.info["hand_m"])
            gap = float(np.linalg.norm(episode.state.chain[held] - hand))
            assert gap < 2 * SETTINGS.diameter_m
            lifted = max(lifted, float(episode.state.chain[held, 2]))
    assert lifted > SETTINGS.radius_m + 0.02


def test_the_hand_brings_back_what_strayed() -> None:
    line = np.zeros((65, 3))
    line[:, 0] = np.linspace(0, 1.2, 65)
    action = next_action(0, line, SETTINGS, np.random.default_rng(0))
    assert action.kind == "gather"
    assert action.held == 64
    # Toward the middle, by 0.45 rope lengths at most.
    assert action.end_m[0] < 1.2 - 0.3 * SETTINGS.length_m
    assert np.linalg.norm(action.end_m - line[64, :2]) <= 0.45 * SETTINGS.length_m + 1e-12


def test_a_rope_at_rest_stays_at_rest() -> None:
    episode = Episode(RopeBody(SETTINGS), "loop", lambda: np.random.default_rng(3))
    for _ in range(60):
        episode.state.advance()
    before = episode.state.now.copy()
    for _ in range(60):
        episode.state.advance()
    assert np.abs(episode.state.now - before).max() < 2e-4


def test_a_dropped_rope_falls_straight_and_lies_on_the_table() -> None:
    line = np.zeros((65, 3))
    line[:, 0] = np.linspace(-0.6, 0.6, 65)
    line[:, 2] = 0.2
    settings = RopeSettings(ball=False)
    state = RopeState(settings, line, None)
    for _ in range(6):
        state.advance()
    fallen = 0.2 - state.chain[:, 2]
    # 0.1 s of free fall, a little damped: 4.9 cm.
    assert fallen.max() - fallen.min() < 1e-9
    assert 0.03 < fallen.mean() < 0.05
    for _ in range(120):
        state.advance()
    np.testing.assert_allclose(state.chain[:, 2], settings.radius_m, atol=1e-6)
    np.testing.assert_allclose(state.chain[:, :2], line[:, :2], atol=1e-6)


def test_forces_between_particles_push_nothing_along() -> None:
    """Bending, stretch and contact keep the middle of a crumpled rope in the air in place."""
    rng = np.random.default_rng(4)
    line = np.cumsum(rng.normal(0, 0.011, (65, 3)), axis=0)
    line[:, 2] += 5.0 - line[:, 2].mean()
    state = RopeState(RopeSettings(ball=False), line, None)
    middle = line.mean(axis=0)
    state.advance()
    assert np.abs(state.chain.mean(axis=0)[:2] - middle[:2]).max() < 2e-3
    assert np.linalg.norm(state.chain - line, axis=1).max() > 5e-3


def test_the_surface_turns_smoothly_in_time() -> None:
    """Beside the motion of its cross section, no point moves by more than a fifth of a radius."""
    scene_object = scene("rope", frames=150, episodes=True)
    rest = scene_object.parts[0].rest
    rows = np.rint(rest[:, 0] / SETTINGS.length_m * (SETTINGS.rows - 1)).astype(int)
    first = np.flatnonzero(rows == 0)
    before = scene_object.pose(0).vertices["rope"]
    for frame in range(1, 150):
        now = scene_object.pose(frame).vertices["rope"]
        for row in range(0, SETTINGS.rows, 20):
            ring = np.flatnonzero(rows == row)
            assert len(ring) == len(first)
            arms = [each[ring] - each[ring].mean(axis=0) for each in (before, now)]
            assert np.linalg.norm(arms[1] - arms[0], axis=1).max() < 0.2 * SETTINGS.radius_m
        before = now
