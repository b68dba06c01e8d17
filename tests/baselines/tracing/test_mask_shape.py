"""Parts, loose ends and balls of drawn masks."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.tracing import MaskShape, RopeTracer
from pliant.spec.frame import Frame
from tests.baselines.tracing.test_tracing import loop, painted, wave

LINE = np.stack([np.linspace(40, 280, 300), np.full(300, 30.0)], axis=1)
UPRIGHT = np.stack([np.full(300, 160.0), np.linspace(10, 230, 300)], axis=1)


def rope(*curves: np.ndarray) -> np.ndarray:
    return np.any([painted(curve, ball=False)[0] for curve in curves], axis=0)


@pytest.mark.parametrize(
    ("mask", "expected"),
    [
        (rope(wave()), (1, 2)),
        (rope(loop()), (1, 2)),
        (rope(wave(), LINE), (2, 4)),
        (rope(wave(), UPRIGHT), (1, 4)),
        (np.zeros((240, 320), bool), (0, 0)),
        (np.ones((240, 320), bool), (1, 0)),
    ],
    ids=["wave", "loop", "two apart", "two crossing", "empty", "full"],
)
def test_parts_and_ends(mask: np.ndarray, expected: tuple[int, int]) -> None:
    shape = MaskShape.of(mask)
    assert (shape.parts, shape.ends) == expected
    assert shape.several_ropes == (max(expected) > 2)
    assert not shape.has_ball


def test_a_ball_is_no_loose_end() -> None:
    mask, objects = painted(wave())
    assert MaskShape.of(mask, objects) == MaskShape(parts=1, ends=1, has_ball=False)


def test_a_user_is_told_what_is_wrong_with_masks() -> None:
    mask, objects = painted(wave())
    rgb = np.zeros((*mask.shape, 3), np.uint8)
    tracer = RopeTracer()
    right = Frame(rgb, mask, objects=objects)
    assert tracer.remarks(right, right) == []
    (one,) = tracer.remarks(right, Frame(rgb, mask | rope(LINE), objects=objects | rope(LINE)))
    assert "mask of the target shows more than one rope (parts: 2, loose ends: 3)" in one
    (other,) = tracer.remarks(Frame(rgb, objects, objects=objects), right)
    assert "mask of the source contains a ball" in other
    for bare in (Frame(rgb, mask), Frame(rgb, mask, objects=mask)):
        (doubtful,) = tracer.remarks(right, bare)
        assert doubtful.startswith("No ball is known at an end of the rope in the target: without")
    assert "in the source and the target: without" in tracer.remarks(bare, bare)[0]
    for unread in (Frame(rgb), Frame(rgb, np.zeros_like(mask))):
        (unanswered,) = tracer.remarks(right, unread)
        assert unanswered.startswith("The target has no mask that shows a rope, so rope-tracer")
