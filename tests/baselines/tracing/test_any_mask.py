"""Every tracer answers for every mask: no path is a valid outcome, a traceback is none."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy import ndimage

from pliant.baselines.tracing import RopeTracer, Trace, rope_traces
from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import Mask
from pliant.spec.ball import separate_ball
from pliant.spec.frame import Frame, Pair

KINDS = ("thin", "thick", "holed", "fragmented", "pixel", "full", "figure eight", "noise", "edge")


def random_masks(rng: np.random.Generator) -> tuple[Mask, Mask]:
    """Return the masks of a rope and of the rope with its ball, if it has one: bool (H, W)."""
    height, width = (int(side) for side in rng.integers(8, 49, 2))
    kind = KINDS[int(rng.integers(len(KINDS)))]
    mask = np.zeros((height, width), np.bool_)
    start = (int(rng.integers(height)), int(rng.integers(width)))
    if kind == "full":
        mask[:] = True
    elif kind == "pixel":
        mask[start] = True
    elif kind == "noise":
        mask = rng.random(mask.shape) < rng.uniform(0.02, 0.98)
    elif kind == "edge":  # a rope that the picture cuts along its side
        mask[:, : int(rng.integers(1, 4))] = True
    else:
        line = _figure_eight(rng) if kind == "figure eight" else _random_line(rng)
        radius = {"thin": 0.5, "thick": 6.0}.get(kind, rng.uniform(0.5, 4.0))
        mask = _painted(line * [height - 1, width - 1], mask.shape, radius)
        if kind == "holed":
            mask &= rng.random(mask.shape) > rng.uniform(0.02, 0.5)
        if kind == "fragmented":
            mask &= ndimage.zoom(rng.random((5, 5)), np.array(mask.shape) / 5, order=0) > 0.4
        start = (int(line[0, 0] * (height - 1)), int(line[0, 1] * (width - 1)))
    if rng.random() < 0.5:
        return mask, mask
    rows, columns = np.indices(mask.shape)
    ball = np.hypot(rows - start[0], columns - start[1]) <= rng.uniform(0.4, 8.0)
    return mask & ~ball, mask | ball


def _random_line(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Return a smooth line that may cross itself, float64 (N, 2), 0 to 1."""
    corners = rng.random((int(rng.integers(2, 9)), 2))
    at = np.linspace(0, len(corners) - 1, 400)
    line = np.stack([np.interp(at, np.arange(len(corners)), c) for c in corners.T], axis=1)
    return np.asarray(ndimage.gaussian_filter1d(line, 15, axis=0, mode="nearest"))


def _figure_eight(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    turn = np.linspace(0, 2 * np.pi * rng.uniform(0.7, 1.0), 400)
    return 0.5 + 0.45 * np.stack([np.sin(2 * turn), np.sin(turn)], axis=1)


def _painted(line: npt.NDArray[np.float64], shape: tuple[int, ...], radius: float) -> Mask:
    mask = np.ones(shape, np.bool_)
    mask[tuple(np.rint(line).astype(int).T)] = False
    return np.asarray(ndimage.distance_transform_edt(mask) <= radius)


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
