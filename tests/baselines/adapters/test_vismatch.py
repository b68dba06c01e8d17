"""`vismatch:NAME`, with a substitute of the package's interface, and with the package itself."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.baselines import Frame, Pair
from pliant.baselines.predict import predict
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.parquet import read_footer
from tests.baselines.cards import Motion, Similarity, card_view

torch = pytest.importorskip("torch")

MOVED = np.array([13, 4])


class Shifted:
    """Matches pixel (x, y), counted from 0, with (x + 13, y + 4), everywhere in the image."""

    skip_ransac = False

    def __init__(self, device: str, keypoints: int, scores: bool) -> None:
        self.given = (device, keypoints)
        self._scores = scores

    def __call__(self, source: Any, target: Any) -> dict[str, Any]:
        assert self.skip_ransac
        assert source.shape == target.shape == (3, 200, 240)
        assert 0 <= source.min() <= source.max() <= 1
        places = np.stack(np.meshgrid(np.arange(0, 227, 3), np.arange(0, 196, 3)), -1).reshape(
            -1, 2
        )
        score = np.linspace(0, 1, len(places)) if self._scores else None
        return {
            "matched_kpts0": places,
            "matched_kpts1": places + MOVED,
            "matched_confidences": score,
        }


@pytest.fixture
def package(monkeypatch: pytest.MonkeyPatch) -> dict[str, Shifted]:
    made: dict[str, Shifted] = {}

    def get_matcher(name: str, device: str, max_num_keypoints: int) -> Shifted:
        made[name] = Shifted(device, max_num_keypoints, scores=name == "scored")
        return made[name]

    fake = SimpleNamespace(available_models=["scored", "sift-nn"], get_matcher=get_matcher)
    monkeypatch.setitem(sys.modules, "vismatch", fake)
    return made


@pytest.mark.parametrize("name", ["scored", "sift-nn"])
def test_matches_are_interpolated_in_pliant_s_pixels(
    name: str, package: dict[str, Shifted]
) -> None:
    method: Any = pliant.open_method(f"vismatch:{name}", keypoints=500)
    assert method.name == f"vismatch:{name}"
    view = card_view(Similarity())
    bare = Frame(view.rgb)
    queries = np.array([[100.5, 90.5], [60, 71.25]], np.float32)
    np.testing.assert_allclose(
        method.answer(Pair(bare, bare, queries)).uv_px, queries + MOVED, atol=1e-4
    )
    assert package[name].given == ("cpu", 500)
    found = method.match(bare, bare)
    np.testing.assert_allclose(found.uv_a_px[0], [0.5, 0.5])
    assert (found.score.min(), found.score.max()) == (0 if name == "scored" else 1, 1)
    on_card = method.match(view, bare)
    assert len(on_card.score) < len(found.score)
    assert all(view.mask[int(v), int(u)] for u, v in on_card.uv_a_px)  # type: ignore[index]


def test_the_footer_names_the_model(
    package: dict[str, Shifted], cards: Dataset, tmp_path: Path
) -> None:
    out = tmp_path / "out.parquet"
    predict(cards, "test", pliant.open_method("vismatch:sift-nn"), out, kind="matches")
    method = read_footer(out)["method"]
    assert method["name"] == "vismatch:sift-nn"
    assert method["implementation"] == "vismatch sift-nn"


def test_what_is_not_there_is_said(package: dict[str, Shifted]) -> None:
    with pytest.raises(CallError, match="vismatch has no model 'roam'; required: scored, sift-nn"):
        pliant.open_method("vismatch:roam")
    with pytest.raises(CallError, match="unexpected keyword argument 'weights'"):
        pliant.open_method("vismatch:sift-nn", weights="x")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["sift-nn", "orb-nn"])
def test_the_package_itself(name: str) -> None:
    pytest.importorskip("vismatch", reason="a user's install")
    moved = Motion(Similarity(), Similarity(angle_deg=40, centre=(121.7, 98.2)))
    method: Any = pliant.open_method(f"vismatch:{name}")
    assert np.median(moved.error(method.answer(moved.pair).uv_px)) < 1.5


def test_the_control_that_the_page_compares_with() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "published-networks.md").read_text()
    figures = pliant.evaluate("sample", pliant.predict("sample", "random")).overall
    assert f"`random` has {figures['rmse_px']:.1f} / {figures['median_px']:.1f} px" in page
