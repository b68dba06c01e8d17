"""Wrappers of packages that are rarely installed: RAFT, RoMa, CoTracker3."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.baselines import Frame, TrackMatcher
from pliant.spec.errors import CallError
from pliant.spec.frame import Pair

torch = pytest.importorskip("torch")


def noise(height: int, width: int) -> Any:
    return np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)


def test_raft_of_random_weights(tmp_path: Path) -> None:
    try:
        flow = importlib.import_module("torchvision.models.optical_flow")
    except (ImportError, RuntimeError) as error:  # the second: built for another torch
        pytest.skip(f"needs torchvision: {error}")
    torch.manual_seed(0)
    torch.save(flow.raft_small().state_dict(), tmp_path / "raft.pth")
    method = pliant.open_method("raft", weights=str(tmp_path / "raft.pth"), small=True, updates=2)
    view = Frame(noise(131, 140))  # rounded up to 136x144
    queries = np.random.default_rng(0).uniform(0, 130, (9, 2)).astype(np.float32)
    found = method.answer(Pair(view, view, queries)).uv_px  # type: ignore[union-attr]
    image = method._images.image(view)  # type: ignore[union-attr]
    assert image.shape == (1, 3, 136, 144)
    expected = flow.raft_small()
    expected.load_state_dict(torch.load(tmp_path / "raft.pth"))
    with torch.inference_mode():
        own = expected.eval()(2 * image - 1, 2 * image - 1, num_flow_updates=2)[-1][0].numpy()
    middle = queries[4] * [144 / 140, 136 / 131] - 0.5
    column, row = np.rint(middle).astype(int)
    assert found[4] - queries[4] == pytest.approx(
        own[:, row, column] * [140 / 144, 131 / 136], abs=1
    )


@pytest.mark.parametrize("symmetric", [False, True])
def test_roma_reads_the_warp_of_the_package(
    symmetric: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A package with RoMa's interface, whose warp moves everything by a tenth of the image."""

    class Model:
        def __init__(self) -> None:
            self.symmetric = symmetric

        def match(self, source: Any, target: Any, device: str) -> Any:
            assert (source.size, target.size, device) == ((60, 40), (120, 40), "cpu")
            v, u = torch.meshgrid(
                (torch.arange(20) + 0.5) / 10 - 1, (torch.arange(30) + 0.5) / 15 - 1, indexing="ij"
            )
            forward = torch.stack([u, v, u + 0.2, v], dim=-1)
            whole = torch.cat([forward, -forward], dim=1) if symmetric else forward
            return whole[None], torch.full(whole.shape[:2], 0.25)[None]

    given: dict[str, Any] = {}

    def roma_outdoor(device: str, **options: Any) -> Model:
        given.update(options)
        return Model()

    package = ModuleType("romatch")
    package.roma_outdoor = roma_outdoor  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "romatch", package)
    torch.save({"a": torch.zeros(1)}, tmp_path / "roma.pth")
    method = pliant.open_method("roma", weights=str(tmp_path / "roma.pth"))
    assert given["dinov2_weights"] is None
    assert list(given["weights"]) == ["a"]
    queries = np.array([[10, 10], [30, 25], [0.5, 0.5]], np.float32)
    found = method.answer(Pair(Frame(noise(40, 60)), Frame(noise(40, 120)), queries))  # type: ignore[union-attr]
    np.testing.assert_allclose(found.uv_px, queries * [2, 1] + [12, 0], atol=1e-4)
    assert found.visible is not None
    np.testing.assert_allclose(found.visible, 0.25)


def test_cotracker_of_random_weights(tmp_path: Path) -> None:
    predictor = pytest.importorskip("cotracker.predictor")
    torch.manual_seed(0)
    network = predictor.CoTrackerPredictor(checkpoint=None, offline=True, v2=False, window_len=60)
    torch.save(network.model.state_dict(), tmp_path / "cotracker.pth")
    method = pliant.open_method("cotracker", weights=str(tmp_path / "cotracker.pth"))
    assert isinstance(method, TrackMatcher)
    queries = np.array([[10, 10], [30.25, 25]], np.float32)
    found = list(method.track([Frame(noise(48, 64))] * 3, queries))
    assert len(found) == 2
    assert all(each.uv_px.shape == (2, 2) and each.visible is not None for each in found)


def test_cotracker_counts_from_pixel_indices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A package with CoTracker's interface that moves every point by its first colour value."""
    asked = []

    class Predictor(torch.nn.Module):  # type: ignore[name-defined]
        def __init__(self, checkpoint: None, offline: bool, v2: bool, window_len: int) -> None:
            super().__init__()
            self.model = torch.nn.Linear(1, 1)

        def forward(self, video: Any, queries: Any) -> Any:
            asked.append(queries)
            walked = video[:, :, 0, 0, 0] - video[:, :1, 0, 0, 0]  # (1, T)
            tracks = queries[:, None, :, 1:] + walked[:, :, None, None]
            return tracks, torch.ones(tracks.shape[:3], dtype=torch.bool)

    package = ModuleType("cotracker.predictor")
    package.CoTrackerPredictor = Predictor  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "cotracker", ModuleType("cotracker"))
    monkeypatch.setitem(sys.modules, "cotracker.predictor", package)
    torch.save({"model": torch.nn.Linear(1, 1).state_dict()}, tmp_path / "w.pth")
    method = pliant.open_method("cotracker", weights=str(tmp_path / "w.pth"), batch=1)
    views = [Frame(np.full((8, 9, 3), value, np.uint8)) for value in (10, 13, 17)]
    points = np.array([[0.5, 2.5], [4, 4]], np.float32)
    found = list(method.track(views, points))  # type: ignore[union-attr]
    np.testing.assert_allclose(found[0].uv_px, points + 3, atol=1e-4)
    np.testing.assert_allclose(found[1].uv_px, points + 7, atol=1e-4)
    assert found[1].visible is not None
    assert found[1].visible.tolist() == [1, 1]
    assert [each.tolist() for each in asked] == [[[[0, 0, 2]]], [[[0, 3.5, 3.5]]]]


def test_tapir_of_random_weights(tmp_path: Path) -> None:
    package = pytest.importorskip("tapnet.torch.tapir_model")
    torch.manual_seed(0)
    torch.save(package.TAPIR(pyramid_level=1).state_dict(), tmp_path / "tapir.pt")
    method = pliant.open_method("tapir", weights=str(tmp_path / "tapir.pt"), size=64)
    queries = np.array([[10, 10], [30.25, 25], [7, 40]], np.float32)
    found = list(method.track([Frame(noise(48, 64))] * 3, queries))  # type: ignore[union-attr]
    assert len(found) == 2
    assert all(each.uv_px.shape == (3, 2) and each.visible is not None for each in found)


def test_tapir_counts_from_the_corner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package with TAPIR's interface that moves every point by 4 px a frame to the right."""
    asked = []

    class Network(torch.nn.Linear):  # type: ignore[name-defined]
        def __init__(self, pyramid_level: int) -> None:
            super().__init__(1, pyramid_level)

        def forward(self, video: Any, points: Any) -> Any:
            assert (video.shape, float(video.min())) == ((1, 3, 64, 64, 3), -1)
            asked.append(points)
            walked = torch.arange(3)[:, None] * torch.tensor([4.0, 0.0])  # (T, 2)
            tracks = points[:, :, None, [2, 1]] + walked
            odds = torch.zeros(tracks.shape[:3])
            return {"tracks": tracks, "occlusion": odds, "expected_dist": odds}

    package = ModuleType("tapnet.torch.tapir_model")
    package.TAPIR = Network  # type: ignore[attr-defined]
    for name in ("tapnet", "tapnet.torch"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, "tapnet.torch.tapir_model", package)
    torch.save(torch.nn.Linear(1, 1).state_dict(), tmp_path / "w.pt")
    method = pliant.open_method("tapir", weights=str(tmp_path / "w.pt"), size=64)
    points = np.array([[32, 4], [80, 16]], np.float32)
    view = Frame(np.zeros((32, 128, 3), np.uint8))
    found = list(method.track([view] * 3, points))  # type: ignore[union-attr]
    assert asked[0].tolist() == [[[0, 8, 16], [0, 32, 40]]]  # (t, y, x) of 64x64 px
    np.testing.assert_allclose(found[1].uv_px, points + np.array([16, 0]), atol=1e-4)
    assert found[1].visible is not None
    assert found[1].visible.tolist() == [0.25, 0.25]


def test_missing_library_and_weights_are_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "romatch", None)
    with pytest.raises(CallError, match=r"roma needs the library 'romatch'.*pip install romatch"):
        pliant.open_method("roma", weights="default")
    monkeypatch.setitem(sys.modules, "romatch", SimpleNamespace())
    with pytest.raises(CallError, match="weights file not found"):
        pliant.open_method("roma", weights=str(tmp_path / "none.pth"))
    (tmp_path / "text.pth").write_text("not weights")
    with pytest.raises(CallError, match="the weights cannot be read"):
        pliant.open_method("roma", weights=str(tmp_path / "text.pth"))
