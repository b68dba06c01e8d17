"""Every tracer answers for every mask: no path is a valid outcome, a traceback is none."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.tracing import RopeTracer, Trace, rope_traces
from pliant.baselines.tracing.settings import TRACING
from pliant.spec.ball import separate_ball
from pliant.spec.frame import Frame, Pair
from tests.baselines.tracing.random_masks import random_masks


def any_likelihood(rng: np.random.Generator, uv_px: np.ndarray) -> np.ndarray:
    """What networks say of pixels: nothing, or something that is sure and wrong."""
    if rng.random() < 0.3:
        return np.ones((len(uv_px), TRACING.chain_steps))
    return rng.random((len(uv_px), TRACING.chain_steps)) ** rng.uniform(1, 100) + 1e-6


def check_traces(traces: list[Trace], mask: np.ndarray) -> None:
    for trace in traces:
        assert np.isfinite(trace.uv_px).all()
        assert trace.length_px > 0
        assert 0 <= trace.coverage <= 1
        assert np.isfinite([trace.half_px, trace.score, *trace.sight.ravel()]).all()
        assert (np.abs(trace.uv_px) <= 3 * max(mask.shape)).all()


def try_masks(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    tracer = RopeTracer()
    before: Frame | None = None
    for number in range(count):
        mask, objects = random_masks(rng)
        rope, ball = separate_ball(objects)
        assert (rope | (False if ball is None else ball) == objects).all()
        check_traces(rope_traces(mask, objects, lambda uv: any_likelihood(rng, uv)), mask)
        view = Frame(np.zeros((*mask.shape, 3), np.uint8), mask, None, str(number), objects)
        asked = rng.random((3, 2)).astype(np.float32) * np.array(mask.shape[::-1], np.float32)
        answers = tracer.answer(Pair(view, before or view, asked))
        assert np.isfinite(answers.uv_px).all()
        assert len(tracer.remarks(view, view)) <= 4  # masks (2), cut, coming back
        before = view


@pytest.mark.usefixtures("quick_tracing")
def test_tracers_answer_for_any_mask() -> None:
    try_masks(0, 30)


def test_a_rope_in_the_middle_of_its_ball_leaves_it_any_way() -> None:
    """Neither the mask around the start nor the way from the ball's middle says which."""
    gap = np.hypot(*(np.mgrid[:61, :61] - 30.0))
    mask, objects = gap < 6, gap < 14
    check_traces(rope_traces(mask, objects), mask)


@pytest.mark.long
@pytest.mark.usefixtures("quick_tracing")
@pytest.mark.parametrize("seed", range(100, 200))
def test_tracers_answer_for_ten_thousand_masks(seed: int) -> None:
    try_masks(seed, 100)
