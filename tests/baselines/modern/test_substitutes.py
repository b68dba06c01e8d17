"""Wrappers of packages that cannot be installed here, with substitutes of the same interface.

Each has the calls, shapes and conventions of the package itself; what it answers is known, so
that sizes, half pixels and the order of coordinates are tested.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.baselines import Frame
from pliant.spec.errors import CallError
from pliant.spec.frame import Pair

torch = pytest.importorskip("torch")

POINTS = np.array([[10.5, 10.5], [30, 25], [41.25, 7.75]], np.float32)


def noise(height: int, width: int, seed: int = 0) -> Any:
    return np.random.default_rng(seed).integers(0, 255, (height, width, 3), np.uint8)


def install(monkeypatch: pytest.MonkeyPatch, name: str, **members: Any) -> ModuleType:
    """Make a package importable, with its parents."""
    parts = name.split(".")
    for count in range(1, len(parts)):
        parent = ".".join(parts[:count])
        if parent not in sys.modules:
            monkeypatch.setitem(sys.modules, parent, ModuleType(parent))
    package = ModuleType(name)
    vars(package).update(members)
    monkeypatch.setitem(sys.modules, name, package)
    return package


def test_roma_v2_gets_the_users_weights_and_gives_its_warp(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The warp moves everything by a tenth of the target's width to the right."""
    loaded = []

    class Model:
        def __init__(self) -> None:
            loaded.append(
                torch.hub.load_state_dict_from_url("https://web/w.pt", map_location="cpu")
            )

        def apply_setting(self, setting: str) -> None:
            if setting not in ("base", "fast"):
                raise TypeError(setting)

        def match(self, source: Any, target: Any) -> Any:
            assert (source.shape, target.shape) == ((40, 60, 3), (40, 120, 3))
            v, u = torch.meshgrid(
                (torch.arange(16) + 0.5) / 8 - 1, (torch.arange(24) + 0.5) / 12 - 1, indexing="ij"
            )
            warp = torch.stack([u + 0.2, v], dim=-1)[None]
            return {"warp_AB": warp, "overlap_AB": torch.full((1, 16, 24, 1), 0.75)}

    install(monkeypatch, "romav2", RoMaV2=Model)
    torch.save({"a": torch.ones(1)}, tmp_path / "w.pt")
    before = torch.hub.load_state_dict_from_url
    method: Any = pliant.open_method("roma-v2", weights=str(tmp_path / "w.pt"))
    assert list(loaded[0]) == ["a"]
    assert torch.hub.load_state_dict_from_url is before
    found = method.answer(Pair(Frame(noise(40, 60)), Frame(noise(40, 120)), POINTS))
    np.testing.assert_allclose(found.uv_px, POINTS * [2, 1] + [12, 0], atol=1e-4)
    np.testing.assert_allclose(found.visible, 0.75)
    with pytest.raises(CallError, match="no such setting; found slow"):
        pliant.open_method("roma-v2", weights=str(tmp_path / "w.pt"), setting="slow")


def test_flow_of_ptlflow_is_in_pixels_of_the_image(monkeypatch: pytest.MonkeyPatch) -> None:
    class Network(torch.nn.Module):  # type: ignore[name-defined]
        def forward(self, given: Any) -> Any:
            images = given["images"]
            assert images.shape == (1, 2, 3, 48, 64)
            blue, _, red = images[0, 0].mean(dim=(1, 2))
            assert blue < 0.1 < 0.9 < red  # the package takes blue first
            flow = torch.zeros(1, 1, 2, 48, 64)
            flow[:, :, 0], flow[:, :, 1] = 4.0, -2.0
            return {"flows": flow}

    def get_model(name: str, ckpt_path: str) -> Any:
        if name != "sea_raft_s":
            raise ValueError(f"Unknown model name: {name}")
        return Network()

    install(monkeypatch, "ptlflow", get_model=get_model, __version__="0")
    method: Any = pliant.open_method("flow", weights="things", model="sea_raft_s", size=[64, 48])
    red = np.zeros((96, 64, 3), np.uint8)
    red[..., 0] = 255
    found = method.answer(Pair(Frame(red), Frame(red), POINTS))
    np.testing.assert_allclose(found.uv_px, POINTS + np.array([4, -4]), atol=1e-4)
    with pytest.raises(CallError, match=r"ptlflow cannot load this.*Unknown model name"):
        pliant.open_method("flow", weights="things", model="sea_raft_xl")


def test_mast3r_counts_from_pixel_indices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Descriptors name the pixel; the second image shows the first two pixels to the right."""
    asked: list[Any] = []

    class Network(torch.nn.Module):  # type: ignore[name-defined]
        @classmethod
        def from_pretrained(cls, weights: str) -> Any:
            assert weights == "file.pth"
            return cls()

        def forward(self, *views: Any) -> Any:
            asked.extend(views)
            height, width = views[0]["img"].shape[-2:]
            v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
            places = torch.stack([u, v], dim=-1).float()
            return [
                {"desc": (places - shift)[None]} for shift in (torch.zeros(2), torch.tensor([2, 0]))
            ]

    def fast_reciprocal_nns(a: Any, b: Any, subsample_or_initxy1: int, **options: Any) -> Any:
        assert options == {"device": "cpu", "dist": "dot", "block_size": 8192}
        step = subsample_or_initxy1
        xy = (
            np.mgrid[step // 2 : a.shape[1] - 2 : step, step // 2 : a.shape[0] : step]
            .reshape(2, -1)
            .T
        )
        wanted = a[xy[:, 1], xy[:, 0]]
        gap = torch.cdist(wanted, b.reshape(-1, 2))
        row, column = np.unravel_index(gap.argmin(dim=1).numpy(), b.shape[:2])
        return xy, np.stack([column, row], axis=1)

    install(monkeypatch, "mast3r.model", AsymmetricMASt3R=Network)
    install(monkeypatch, "mast3r.fast_nn", fast_reciprocal_NNs=fast_reciprocal_nns)
    method: Any = pliant.open_method("mast3r", weights="file.pth", size=[60, 40], step=4)
    found = method.answer(Pair(Frame(noise(48, 128)), Frame(noise(48, 64)), POINTS))
    # 64x48 is the size rounded up to 16: the source is twice as wide, the target as it is.
    np.testing.assert_allclose(found.uv_px, POINTS * [0.5, 1] + [2, 0], atol=1e-3)
    assert asked[0]["true_shape"].tolist() == [[48, 64]]
    assert asked[0]["img"].min() < -0.9


@pytest.mark.parametrize("suffix", [".pt", ".npz"])
def test_tapnext_goes_frame_by_frame(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A network that moves every point by 4 px a frame to the right."""
    asked: list[Any] = []

    class Network(torch.nn.Linear):  # type: ignore[name-defined]
        def __init__(self, image_size: tuple[int, int]) -> None:
            super().__init__(1, 1)
            assert image_size == (64, 64)

        def forward(self, video: Any, query_points: Any = None, state: Any = None) -> Any:
            assert video.shape == (1, 1, 64, 64, 3)
            if state is None:
                asked.append(query_points)
                state = SimpleNamespace(at=query_points[..., 1:], step=0)
            tracks = state.at + state.step * torch.tensor([0.0, 4.0])  # (y, x)
            odds = torch.zeros(*tracks.shape[:2], 1)
            state = SimpleNamespace(at=state.at, step=state.step + 1)
            return tracks[:, None], None, odds[:, None], state

    restored = []

    def restore(model: Any, path: str) -> Any:
        restored.append(path)
        return model

    install(monkeypatch, "tapnet.tapnext.tapnext_torch", TAPNext=Network)
    install(
        monkeypatch, "tapnet.tapnext.tapnext_torch_utils", restore_model_from_jax_checkpoint=restore
    )
    path = tmp_path / f"w{suffix}"
    values = torch.nn.Linear(1, 1).state_dict()
    torch.save({"state_dict": {f"tapnext.{name}": each for name, each in values.items()}}, path)
    method: Any = pliant.open_method("tapnext", weights=str(path), size=64)
    assert restored == ([str(path)] if suffix == ".npz" else [])
    points = np.array([[32, 4], [80, 16]], np.float32)
    view = Frame(np.zeros((32, 128, 3), np.uint8))
    found = list(method.track([view] * 3, points))
    assert asked[0].tolist() == [[[0, 8, 16], [0, 32, 40]]]  # (t, y, x) of 64x64 px
    np.testing.assert_allclose(found[1].uv_px, points + np.array([16, 0]), atol=1e-4)
    assert found[1].visible.tolist() == [0.5, 0.5]
