"""The recipes of docs/published-networks.md, with substitutes of the packages' interfaces.

What each substitute answers is known, so that sizes, half pixels and the order of coordinates are
tested.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pliant.baselines import Frame

torch = pytest.importorskip("torch")

PAGE = Path(__file__).resolve().parents[3] / "docs" / "published-networks.md"
RECIPES = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
POINTS = np.array([[32, 4], [80.5, 16.5]], np.float32)
CLIP = [Frame(np.zeros((32, 128, 3), np.uint8))] * 3


def method_of(recipe: str) -> Any:
    values: dict[str, Any] = {}
    exec(compile(recipe, str(PAGE), "exec"), values)
    return values["method"]


def test_cotracker(monkeypatch: pytest.MonkeyPatch) -> None:
    """A network that moves every point by 4 px a frame to the right."""

    class Network(torch.nn.Module):  # type: ignore[name-defined]
        def forward(self, video: Any, queries: Any) -> Any:
            assert video.shape == (1, 3, 3, 32, 128)
            assert queries.tolist() == [[[0, 31.5, 3.5], [0, 80, 16]]]
            steps = torch.arange(3)[None, :, None, None] * torch.tensor([4.0, 0.0])
            return queries[:, None, :, 1:] + steps, torch.ones(1, 3, 2, dtype=torch.bool)

    monkeypatch.setattr(torch.hub, "load", lambda repository, name: Network())
    found = list(method_of(RECIPES[0]).track(CLIP, POINTS))
    np.testing.assert_allclose(found[1].uv_px, POINTS + np.array([8, 0]), atol=1e-4)
    assert found[1].visible.tolist() == [1, 1]


def test_tapnext(monkeypatch: pytest.MonkeyPatch) -> None:
    """A network that moves every point by 4 px of 256 a frame to the right."""
    asked = []

    class Network:
        def __init__(self, image_size: tuple[int, int]) -> None:
            assert image_size == (256, 256)

        def __call__(self, video: Any, query_points: Any = None, state: Any = None) -> Any:
            assert video.shape == (1, 1, 256, 256, 3)
            if state is None:
                asked.append(query_points)
                state = SimpleNamespace(at=query_points[..., 1:], step=0)
            tracks = state.at + state.step * torch.tensor([0.0, 4.0])  # (y, x)
            odds = torch.zeros(*tracks.shape[:2], 1)
            state = SimpleNamespace(at=state.at, step=state.step + 1)
            return tracks[:, None], None, odds[:, None], state

    package: Any = ModuleType("tapnet.tapnext")
    package.tapnext_torch = SimpleNamespace(TAPNext=Network)
    restore = SimpleNamespace(restore_model_from_jax_checkpoint=lambda model, path: model)
    package.tapnext_torch_utils = restore
    monkeypatch.setitem(sys.modules, "tapnet", ModuleType("tapnet"))
    monkeypatch.setitem(sys.modules, "tapnet.tapnext", package)
    found = list(method_of(RECIPES[1]).track(CLIP, POINTS))
    assert asked[0].tolist() == [[[0, 32, 64], [0, 132, 161]]]  # (t, y, x) of 256x256 px
    np.testing.assert_allclose(found[1].uv_px, POINTS + np.array([4, 0]), atol=1e-4)
    assert found[1].visible.tolist() == [0.5, 0.5]
