"""The learned matcher on a sheet whose colours say where on it a pixel is."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from pliant.baselines.matcher import HeatMatcher
from pliant.loaders.inputs import NetworkInput
from pliant.models.don.calibration import calibrate, fit_sharpness
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.rope_reader import RopeReader
from pliant.models.don.settings import AnswerSettings, DonSettings
from pliant.models.don.validation import ValidationPair, validate
from pliant.models.losses.matches import widened
from pliant.models.networks.descriptor_network import DescriptorNetwork, NetworkSettings
from pliant.spec.arrays import BoolArray, FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Frame, Pair
from pliant.viewer.explorer.layers import descriptor_colours
from tests.known import known
from tests.loaders.sheet_dataset import sheet_map
from tests.models.don.planted import SIZE, by_colour, within


@pytest.mark.parametrize("decode", ["argmax", "median", "soft"])
@pytest.mark.parametrize(("rotations", "mirrored"), [(1, False), (1, True), (2, False), (4, True)])
def test_answers_are_right_to_a_fraction_of_a_pixel(
    pairs: list[ValidationPair], decode: str, rotations: int, mirrored: bool
) -> None:
    """Copies vote in their own frames: a slip in turning or mirroring positions would show."""
    settings = AnswerSettings(decode=decode, rotations=rotations, mirrored=mirrored)  # type: ignore[arg-type]
    figures = validate(by_colour(settings), [within(pair) for pair in pairs], SIZE)
    assert figures["median_px"] < 0.25
    assert figures["rmse_px"] < 0.5


def test_validation_names_the_network_alone_where_traces_answer(
    pairs: list[ValidationPair],
) -> None:
    """A sheet is no rope: its traces answer badly, whatever the network knows."""
    found = validate(by_colour(AnswerSettings(decode="trace")), [within(pairs[0])], SIZE)
    assert found["network_rmse_px"] < 0.5 < found["rmse_px"]
    assert "network_rmse_px" not in validate(by_colour(), [within(pairs[0])], SIZE)


def test_answers_are_in_the_pixels_of_each_view(sheet_dataset: Dataset) -> None:
    """Source and target may have different sizes; neither is the network's."""
    source, target = sheet_dataset.sequences[0], sheet_dataset.sequences[1]
    rgb = target.rgb(0)
    large = Frame(rgb.repeat(3, axis=0).repeat(2, axis=1), key="large")
    small = Frame(source.rgb(0), mask=source.surface(0).object_id == 1, key="small")
    matcher = by_colour(AnswerSettings(search="image"))
    to_a, to_b = (sheet_map(number, 0, SIZE, 0.0) for number in (0, 1))
    material = np.array([[0.3, 0.3], [0.5, 0.7], [0.7, 0.6]])
    uv_a = (material @ to_a[:, :2].T + to_a[:, 2]).astype(np.float32)
    answers = matcher.answer(Pair(small, large, uv_a))
    expected = (material @ to_b[:, :2].T + to_b[:, 2]) * [2, 3]
    np.testing.assert_allclose(answers.uv_px, expected, atol=1.0)


@pytest.mark.parametrize("masks", [True, False])
def test_a_small_object_is_looked_at_enlarged(
    pairs: list[ValidationPair], monkeypatch: pytest.MonkeyPatch, *, masks: bool
) -> None:
    """In a picture five times as large, a pixel of the network is five of the sheet's."""
    corner = np.array([120, 90])

    def placed(view: Frame) -> Frame:
        around = [(corner[1], 150), (corner[0], 200)]
        rgb = np.pad(view.rgb, [*around, (0, 0)], mode="edge")
        mask = np.pad(known(view.mask), around)
        return Frame(rgb, mask if masks else None, key=f"{view.key} placed")

    def errors_px(fill: tuple[float, float]) -> FloatArray:
        matcher = by_colour(AnswerSettings(fill=fill, search="image"), scale=200.0)
        if not masks:  # as a network that predicts masks finds them, at its own size
            monkeypatch.setattr(type(matcher.reader), "_shown", found)
        placed_pair = Pair(placed(pair.source), placed(pair.target), pair.uv_a_px + corner)
        return np.asarray(
            np.linalg.norm(matcher.answer(placed_pair).uv_px - corner - pair.uv_b_px[:, 0], axis=1)
        )

    def found(reader: RopeReader, view: Frame) -> BoolArray:
        shown = pair.source if view.key.startswith(pair.source.key) else pair.target
        return np.pad(known(shown.mask), [(corner[1], 150), (corner[0], 200)])[::5, ::5]

    pair = within(pairs[0])
    pair = replace(pair, uv_a_px=pair.uv_a_px.astype(np.float32))
    assert np.median(errors_px((0.54, 0.74))) < 0.5
    assert np.median(errors_px((0.001, 0.74))) > 1.0


def test_search_stays_in_the_mask_unless_told(pairs: list[ValidationPair]) -> None:
    pair = pairs[0]
    corner = np.zeros_like(known(pair.target.mask))
    corner[:8, :8] = True
    target = replace(pair.target, mask=corner, key="corner")
    inside = by_colour().answer(Pair(pair.source, target, pair.uv_a_px)).uv_px
    assert (inside <= 8).all()
    anywhere = by_colour(AnswerSettings(search="image")).answer(
        Pair(pair.source, target, pair.uv_a_px)
    )
    assert (anywhere.uv_px > 8).any()


def test_a_thin_mask_is_not_lost(pairs: list[ValidationPair]) -> None:
    mask = np.zeros((480, 640), bool)
    mask[100:300, 201] = True
    view = Frame(np.zeros((480, 640, 3), np.uint8), mask=mask, key="thin")
    answers = by_colour().answer(Pair(pairs[0].source, view, pairs[0].uv_a_px))
    assert np.abs(answers.uv_px[:, 0] - 201).max() < 8


def test_no_queries_and_empty_masks(pairs: list[ValidationPair]) -> None:
    pair = pairs[0]
    nothing = by_colour().answer(Pair(pair.source, pair.target, np.zeros((0, 2), np.float32)))
    assert nothing.uv_px.shape == (0, 2)
    nowhere = np.zeros_like(known(pair.target.mask))
    unseen = replace(pair.target, mask=nowhere, key="unseen")
    assert np.isfinite(by_colour().answer(Pair(pair.source, unseen, pair.uv_a_px)).uv_px).all()


def test_heat_peaks_at_the_answer(pairs: list[ValidationPair]) -> None:
    matcher = by_colour()
    assert isinstance(matcher, HeatMatcher)
    pair = pairs[0]
    query = pair.uv_a_px[pair.visible[:, 0]][0]
    heat = matcher.heat(pair.source, pair.target, query)
    assert heat.values.shape == pair.target.rgb.shape[:2]
    peak = np.unravel_index(np.nanargmax(heat.values), heat.values.shape)
    answer = matcher.answer(Pair(pair.source, pair.target, query[None])).uv_px[0]
    assert np.hypot(peak[1] + 0.5 - answer[0], peak[0] + 0.5 - answer[1]) < 1.5
    assert np.isnan(heat.values[~known(pair.target.mask)]).all()
    assert 0 < heat.confidence <= 1


def test_colours_are_the_same_in_all_pictures() -> None:
    rng = np.random.default_rng(0)
    shared = rng.normal(size=(4, 5, 6)).astype(np.float32)
    masks = [np.ones((4, 5), bool)] * 2
    a, b = descriptor_colours([shared, shared[::-1]], masks)
    np.testing.assert_allclose(a, b[::-1])
    assert len(np.unique(a.reshape(-1, 3), axis=0)) > 10
    flat = descriptor_colours([shared[..., :2]], [np.zeros((4, 5), bool)])
    assert (flat[0] == 1).all()


def test_matcher_is_in_evaluation_mode() -> None:
    network = DescriptorNetwork(NetworkSettings(name="resnet18"), NetworkInput())
    assert not DonMatcher(network.train(), DonSettings()).network.training


def test_a_narrow_mask_leaves_out_points_that_a_margin_of_one_pixel_holds() -> None:
    """A strip 1.4 px wide over pixel rows: at half coverage only one row is in the mask."""
    mask = torch.zeros(1, 6, 8, dtype=torch.bool)
    mask[0, 3] = True
    side_v_px = torch.tensor([2.9, 3.5, 4.2])  # seen points across the strip
    rows = side_v_px.long()
    assert mask[0, rows, 4].tolist() == [False, True, False]
    assert widened(mask, 1)[0, rows, 4].all()
    assert torch.equal(widened(mask, 0), mask)


@pytest.mark.usefixtures("few_tried")
@pytest.mark.parametrize("decode", ["median", pytest.param("soft", marks=pytest.mark.long)])
def test_a_contrastive_network_is_sharpened_before_it_answers(
    pairs: list[ValidationPair], decode: str
) -> None:
    """Descriptors that are right, but closer together than a scale of 1 can tell apart."""
    settings = AnswerSettings(decode=decode)  # type: ignore[arg-type]
    matcher = by_colour(settings, scale=0.002)
    inner = [within(pair) for pair in pairs]
    before = validate(matcher, inner, SIZE)["rmse_px"]
    matcher.sharpness = fit_sharpness(matcher, inner)
    after = validate(matcher, inner, SIZE)["rmse_px"]
    assert before > 2 * after
    assert after < 1.5
    assert calibrate(matcher, inner, SIZE).sharpness == matcher.sharpness > 10


def test_copies_share_traces_through_a_folder(
    pairs: list[ValidationPair], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`pliant predict --workers 2` sends the matcher to other processes."""
    matcher = by_colour(AnswerSettings(decode="trace"))
    matcher.share(tmp_path)
    copy = pickle.loads(pickle.dumps(matcher))
    expected = matcher.answer(pairs[0])
    assert len(list((tmp_path / "traces").iterdir())) == 2

    def refuse(*_: Any) -> Any:
        raise AssertionError("a picture was traced again")

    monkeypatch.setattr("pliant.models.don.rope_reader.rope_traces", refuse)
    np.testing.assert_array_equal(copy.answer(pairs[0]).uv_px, expected.uv_px)
