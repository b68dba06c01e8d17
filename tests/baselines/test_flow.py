"""Points followed by optical flow through frames whose motion is known."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines import METHODS, Frame, Pair, TrackMatcher
from pliant.baselines.flow import FLOWS, FlowChain
from tests.baselines.cards import Motion, Similarity, card_view
from tests.known import known

pytest.importorskip("cv2")

CHAINS = list(FLOWS)


def chain(name: str) -> FlowChain:
    matcher = METHODS[name]()
    assert isinstance(matcher, FlowChain)
    assert isinstance(matcher, TrackMatcher)
    return matcher


@pytest.mark.parametrize("name", CHAINS)
def test_points_follow_a_turn_of_72_degrees_in_small_steps(name: str) -> None:
    poses = [Similarity(angle_deg=4 * step, centre=(120 + step, 100)) for step in range(19)]
    whole = Motion(poses[0], poses[-1])
    *_, last = chain(name).track([card_view(each) for each in poses], whole.queries)
    # Windows do not turn, so each step drifts.
    assert np.median(whole.error(last.uv_px)) < 3
    assert known(last.visible).mean() > 0.95
    assert np.median(whole.error(chain(name).answer(whole.pair).uv_px)) > 10


@pytest.mark.parametrize("name", CHAINS)
def test_a_point_that_does_not_return_stays_and_is_hidden(name: str) -> None:
    """The left half of the next frame is another texture; the right half moves by (2.5, 0)."""
    before, after = Similarity(), Similarity(centre=(122.5, 100))
    target = card_view(after).rgb.copy()
    other = np.random.default_rng(0).integers(0, 256, (*target[:, :120].shape[:2], 1))
    target[:, :120] = other
    card = np.stack(np.meshgrid(np.arange(-50, 51, 5), np.arange(-50, 51, 5)), -1).reshape(-1, 2)
    start = before.place(card).astype(np.float32)
    left, right = start[:, 0] < 95, start[:, 0] > 145
    answers = chain(name).answer(Pair(card_view(before), Frame(target), start))
    visible, sigma_px = known(answers.visible), known(answers.sigma_px)
    assert visible[left].mean() < 0.15
    assert visible[right].mean() > 0.95
    lost = visible == 0
    np.testing.assert_array_equal(answers.uv_px[lost], start[lost])
    assert sigma_px[lost].min() > sigma_px[right & ~lost].max()
    moved = answers.uv_px[right] - start[right]
    np.testing.assert_allclose(np.median(moved, axis=0), [2.5, 0], atol=0.1)


@pytest.mark.parametrize("name", CHAINS)
def test_small_blank_and_unequal_images_are_answered(name: str) -> None:
    query = np.array([[0.5, 0.5]], dtype=np.float32)
    speck = Frame(np.full((1, 1, 3), 90, dtype=np.uint8))
    assert chain(name).answer(Pair(speck, speck, query)).uv_px.tolist() == [[0.5, 0.5]]
    noise = np.random.default_rng(1).integers(0, 256, (60, 80, 3)).astype(np.uint8)
    twice = Frame(np.repeat(np.repeat(noise, 2, axis=0), 2, axis=1))
    found = chain(name).answer(
        Pair(Frame(noise), twice, np.array([[40.5, 30.5]], dtype=np.float32))
    )
    np.testing.assert_allclose(found.uv_px, [[81, 61]], atol=0.3)
