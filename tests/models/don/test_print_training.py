"""The network that matches prints, and the painted pictures that it learns from."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.stats import spearmanr

from pliant.loaders import FrameStore
from pliant.models.don import print_training
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.print_training import _painted_pair, _Picture, _sheet, fit_prints
from pliant.models.networks.print_network import is_printed, print_planes
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Pair
from tests.models.shipped_models import made_like_training_set, shipped_don

SIZE = (120, 90)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> FrameStore:
    folder = tmp_path_factory.mktemp("cloths") / "set"
    made = made_like_training_set("don-cloth", folder, 3, tiers=["cloth-3"], seed=81)
    return FrameStore(Dataset.open(made.root), "cloth-3", "test", SIZE)


def colours_at(picture: _Picture) -> np.ndarray:
    """The colours of a picture at its points, float (N, 3), without those near an edge."""
    smooth = cv2.GaussianBlur(picture.planes[:3].transpose(1, 2, 0), (0, 0), 1.0)
    column, row = picture.uv_px.T.astype(np.float32) - np.float32(0.5)
    return np.asarray(cv2.remap(smooth, column, row, cv2.INTER_LINEAR)[:, 0])


def test_both_pictures_of_a_pair_show_the_same_print_at_their_points(store: FrameStore) -> None:
    sheets = [_sheet(store, number) for number in range(len(store))]
    rng = np.random.default_rng(3)
    alike, shuffled = [], []
    for _ in range(12):
        first, second = map(colours_at, _painted_pair(sheets, rng))
        other = second[rng.permutation(len(second))]
        alike.append(np.mean([spearmanr(first[:, k], second[:, k])[0] for k in range(3)]))
        shuffled.append(np.mean([spearmanr(first[:, k], other[:, k])[0] for k in range(3)]))
    assert np.median(alike) > 0.5
    assert abs(np.median(shuffled)) < 0.2


def test_the_other_side_of_a_folded_cloth_is_told_by_the_map(store: FrameStore) -> None:
    """Mirroring a sheet's material exchanges front and back nowhere: the larger side is front."""
    for number in range(len(store)):
        sheet = _sheet(store, number)
        assert sheet.front[sheet.mask].mean() >= 0.5


def test_training_tells_places_of_a_print_apart(
    store: FrameStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one painted pair again and again, what is known without the print is soon surpassed."""
    pair = _painted_pair([_sheet(store, 0)], np.random.default_rng(1))
    monkeypatch.setattr(print_training, "_painted_pair", lambda *_: pair)
    hasty = print_training._OPTIMISER.replace(warmup=2)
    monkeypatch.setattr(print_training, "_OPTIMISER", hasty)
    losses: list[float] = []
    network = fit_prints(
        [store], steps=24, seed=5, progress=lambda _, figures: losses.append(figures["loss"])
    )
    assert len(losses) == 24
    assert not network.training
    assert np.mean(losses[-4:]) < np.mean(losses[:4]) - 0.7
    described = network.described(np.full((18, 24, 3), 90, np.uint8), np.ones((18, 24), np.bool_))
    assert described.shape == (16, 18, 24)


def test_planes_are_centred_on_the_object_alone() -> None:
    rgb = np.full((6, 8, 3), 0.9, np.float32)
    mask = np.zeros((6, 8), np.bool_)
    mask[1:5, 2:6] = True
    rgb[1:5, 2:4], rgb[1:5, 4:6] = 0.2, 0.6
    planes = print_planes(rgb, mask)
    assert planes.shape == (4, 6, 8)
    np.testing.assert_allclose(planes[:3, mask].mean(axis=1), 0, atol=1e-6)
    np.testing.assert_allclose(planes[0, 2, 2], -0.2 / 0.24, rtol=1e-5)  # spread 0.2, and 0.04
    assert (planes[:, ~mask] == 0).all()
    assert (planes[3, mask] == 1).all()
    assert (print_planes(rgb, np.zeros_like(mask)) == 0).all()


def test_a_print_is_seen_and_shading_is_none() -> None:
    mask = np.ones((40, 60), np.bool_)
    shade = np.linspace(60, 200, 60)[None, :, None]
    plain = (shade * np.array([1.0, 0.8, 0.6])).repeat(40, axis=0).astype(np.uint8)
    assert not is_printed(plain, mask)
    printed = plain.copy()
    printed[10:30, 20:40] = (30, 60, 180)
    assert is_printed(printed, mask)
    assert not is_printed(printed, np.zeros_like(mask))


@pytest.fixture(scope="module")
def matcher() -> DonMatcher:
    return shipped_don("don-cloth")


def test_prints_are_described_and_blank_cloths_are_not(
    matcher: DonMatcher, blank_cloths: list[Pair], printed: list[Pair]
) -> None:
    views = matcher._views
    assert all(views.described(pair.source).prints is None for pair in blank_cloths)
    assert all(views.described(pair.source).prints is not None for pair in printed)


def test_only_a_print_in_both_pictures_changes_an_answer(
    matcher: DonMatcher, printed: list[Pair], blank_cloths: list[Pair]
) -> None:
    alone = shipped_don("don-cloth")
    alone.match_prints_with(None)
    mixed = Pair(printed[0].source, blank_cloths[0].target, printed[0].uv_a_px)
    for pair, changed in ((printed[0], True), (blank_cloths[0], False), (mixed, False)):
        same = np.array_equal(matcher.answer(pair).uv_px, alone.answer(pair).uv_px)
        assert same != changed
