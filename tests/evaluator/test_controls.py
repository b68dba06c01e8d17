"""The note on controls that beat a method, with errors worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.evaluator.controls import Controls
from tests.evaluator.hand_made import Split, split

# Two pairs. Pair 0: one point. Pair 1: three visible points on a line, 10 px apart, and a hidden
# one. All of them move by (3, 4) from the source to the target, so `identity` errs by 5 px.
TRUE = np.array([[7, 8], [10, 20], [20, 20], [30, 20], [500, 500]], float)


def said(
    error_px: float, *, moved: tuple[float, float] = (3, 4), method: str = "sift"
) -> str | None:
    answer_px = TRUE + np.array([error_px, 0])
    made = Split(split([1, 4]), answer_px, TRUE, hidden=[4], uv_a_px=TRUE - moved)
    controls = Controls(5)
    controls.update(made.block(0, 2))
    return controls.sentence(method)


def test_a_better_method_gets_no_note() -> None:
    assert said(4.0) is None
    assert said(5.0) is None  # as good as standing still


def test_standing_still_is_named_with_its_errors() -> None:
    sentence = said(8.0) or ""
    assert "the control `identity` is better (RMSE 5 px against 8 px, median error 5 px" in sentence
    assert "standing still" in sentence
    assert "centroid" not in sentence


@pytest.mark.parametrize(("control", "errors"), [
    # The other two points' middle: 15, 0 and 15 px; the only point of pair 0 counts as answered.
    ("centroid", f"RMSE {np.sqrt(2050 / 4):.3g} px against 40 px, median error 15 px"),
    # The next point, round and round: 10, 10 and 20 px.
    ("random", f"RMSE {np.sqrt(2200 / 4):.3g} px against 40 px, median error 15 px"),
])  # fmt: skip
def test_places_on_the_object_are_compared(control: str, errors: str) -> None:
    sentence = said(40.0, moved=(300, 400)) or ""
    assert f"the control `{control}` is better ({errors}" in sentence
    assert "identity" not in sentence


def test_a_control_is_not_compared_with_itself() -> None:
    assert said(8.0, method="identity") is None
