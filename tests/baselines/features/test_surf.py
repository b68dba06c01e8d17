"""Which SURF runs, and that its name is told."""

from __future__ import annotations

import pickle
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pliant.baselines.features.opencv_features import OpencvFeatures
from pliant.baselines.features.surf import MahotasSurf, open_surf
from pliant.baselines.methods import local_feature
from pliant.spec.errors import MissingExtraError


class FakeKeypoint(SimpleNamespace):
    def __init__(
        self, x: float, y: float, size: float, angle: float, response: float, octave: int, row: int
    ) -> None:
        super().__init__(pt=(x, y), size=size, class_id=row)


class FakeSurf:
    """Has the interface of `cv2.xfeatures2d.SURF`; its descriptor is the position."""

    def detectAndCompute(self, image: Any, mask: None) -> tuple[list[Any], Any]:  # noqa: N802
        if image.max() == image.min():
            return [], None
        return self.compute(image, [FakeKeypoint(3.25, 4, 9, 0, 0, 0, 0)])

    def descriptorSize(self) -> int:  # noqa: N802
        return 64

    def compute(self, image: Any, keypoints: list[Any]) -> tuple[list[Any], Any]:
        back = keypoints[::-1]  # OpenCV may reorder
        rows = np.zeros((len(back), 64), dtype=np.float32)
        rows[:, :2] = [keypoint.pt for keypoint in back]
        rows[:, 2] = [keypoint.size for keypoint in back]
        return back, rows


@pytest.fixture
def opencv_with_surf(monkeypatch: pytest.MonkeyPatch) -> None:
    module = SimpleNamespace(
        __version__="4.11.0-nonfree",
        error=RuntimeError,
        KeyPoint=FakeKeypoint,
        xfeatures2d=SimpleNamespace(SURF_create=lambda hessianThreshold: FakeSurf()),
    )
    monkeypatch.setitem(sys.modules, "cv2", module)


@pytest.mark.usefixtures("opencv_with_surf")
def test_opencvs_surf_is_preferred_and_named() -> None:
    features = open_surf()
    assert isinstance(features, OpencvFeatures)
    facts = local_feature("surf").describe()
    assert (facts["name"], facts["implementation"]) == ("surf", "opencv")
    assert facts["version"] == "4.11.0-nonfree"
    image = np.arange(100, dtype=np.uint8).reshape(10, 10)
    assert features.detect(image).uv_px.tolist() == [[3.75, 4.5]]
    assert features.detect(np.zeros_like(image)).descriptors.shape == (0, 64)
    uv_px = np.array([[1.5, 2.5], [4.0, 5.0]], dtype=np.float32)
    described = features.describe_at(image, uv_px)
    np.testing.assert_array_equal(described[:, :2], uv_px - 0.5 + 64)
    np.testing.assert_allclose(described[:, 2], 22.5)  # scale 3: 3 · 9 / 1.2


def test_mahotas_runs_where_opencv_has_none() -> None:
    assert isinstance(open_surf(), MahotasSurf)
    facts = local_feature("surf").describe()
    assert (facts["name"], facts["implementation"]) == ("surf", "mahotas")
    assert facts["version"]


def test_build_without_nonfree_algorithms_falls_back(monkeypatch: pytest.MonkeyPatch) -> None:
    class OpencvError(Exception):
        pass

    def excluded(**settings: float) -> None:
        raise OpencvError("This algorithm is patented and is excluded in this configuration")

    module = SimpleNamespace(
        error=OpencvError, xfeatures2d=SimpleNamespace(SURF_create=excluded), __version__="4"
    )
    monkeypatch.setitem(sys.modules, "cv2", module)
    assert isinstance(open_surf(), MahotasSurf)


def test_neither_is_said_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("cv2", "mahotas", "mahotas.features"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError, match=r"pip install 'pliant\[classical\]'") as caught:
        local_feature("surf")
    assert caught.value.exit_code == 2


def test_points_near_the_edge_are_described() -> None:
    image = np.random.default_rng(0).integers(0, 256, (90, 120)).astype(np.uint8)
    found = MahotasSurf().detect(image)
    assert len(found.uv_px) == len(found.descriptors) > 10
    corners = np.array([[0.5, 0.5], [119.5, 89.5]], dtype=np.float32)
    described = MahotasSurf().describe_at(image, corners)
    np.testing.assert_allclose(np.linalg.norm(described, axis=1), 1, rtol=1e-5)


def test_travels_to_another_process() -> None:
    matcher = pickle.loads(pickle.dumps(local_feature("surf")))
    assert matcher.describe() == local_feature("surf").describe()
