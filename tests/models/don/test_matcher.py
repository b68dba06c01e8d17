from __future__ import annotations

import itertools
import math
import pickle
import shutil
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import torch
from torch import nn

from pliant.baselines.matcher import HeatMatcher
from pliant.baselines.tracing import Reframed
from pliant.loaders.frame_store import FrameStore
from pliant.loaders.inputs import NetworkInput
from pliant.models.don import calibration as calibration_module
from pliant.models.don.calibration import calibrate, fit_sharpness
from pliant.models.don.candidates import pixel_grid, widened
from pliant.models.don.certainty import Calibration, mean_doubt
from pliant.models.don.decoding import Decode, Widths, decode_position, mixture_of_modes
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.rope_reader import RopeReader
from pliant.models.don.search import Search
from pliant.models.don.settings import AnswerSettings, DonSettings
from pliant.models.don.validation import ValidationPair, draw_validation_pairs, validate
from pliant.models.networks.descriptor_network import NetworkSettings, build_network
from pliant.spec.arrays import Mask
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Frame, Pair
from pliant.viewer.explorer.descriptor_colours import descriptor_colours
from tests.loaders.sheet_dataset import sheet_map
from tests.models.don.planted import planted

SIZE = (80, 60)
GRID = torch.tensor([[u + 0.5, v + 0.5] for v in range(6) for u in range(10)])


class ColourIsPlace(nn.Module):
    """The sheet's red and green say where on it a pixel is: a perfect descriptor by hand."""

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        return image[:, :2] * 4


def by_colour(settings: AnswerSettings | None = None, scale: float = 8.0) -> DonMatcher:
    return planted(ColourIsPlace(), SIZE, settings or AnswerSettings(), scale=scale)


def calibrated(matcher: DonMatcher, pairs: list[ValidationPair]) -> Calibration:
    """Return the calibration of a matcher, which a run's folder stores as it is."""
    found = calibrate(matcher, pairs, SIZE)
    assert Calibration.from_document(asdict(found)) == found
    return found


@pytest.fixture
def few_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Calibration tries few temperatures and radii: which kinds have one of their own is tested."""
    monkeypatch.setattr(calibration_module, "TEMPERATURES", (0.5, 1.0, 4.0))
    monkeypatch.setattr(calibration_module, "MODE_RADII_PX", (4.0,))


def drawn(dataset: Dataset, pairs: int, queries: int, seed: int = 3) -> list[ValidationPair]:
    store = FrameStore(dataset, "sheet", "train", SIZE)
    return draw_validation_pairs(store, pairs, queries, seed)


@pytest.fixture(scope="module")
def pairs(sheet_dataset: Dataset) -> list[ValidationPair]:
    return drawn(sheet_dataset, 8, 60, seed=0)


def mask_of(view: Frame) -> Mask:
    assert view.mask is not None
    return view.mask


def first_sigmas(matcher: DonMatcher, pair: Pair) -> npt.NDArray[np.float32]:
    """Return the standard deviation of each answer's heaviest mode."""
    modes = matcher.answer(pair).modes
    assert modes is not None
    return np.array([rows[rows[:, 3].argmax(), 2] for rows in modes])


def within(pair: ValidationPair) -> ValidationPair:
    """The pair without the points on the sheet's rim, whose colours are mixed with the table's."""
    keep = np.ones(len(pair.uv_a_px), bool)
    for view, uv in ((pair.source, pair.uv_a_px), (pair.target, pair.uv_b_px[:, 0])):
        for shift in ((-2, 0), (2, 0), (0, -2), (0, 2)):
            column, row = np.floor(uv + shift).astype(int).T
            keep &= mask_of(view)[row, column]
    return replace(
        pair, uv_a_px=pair.uv_a_px[keep], uv_b_px=pair.uv_b_px[keep], visible=pair.visible[keep]
    )


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
        mask = np.pad(mask_of(view), around)
        return Frame(rgb, mask if masks else None, key=f"{view.key} placed")

    def errors_px(fill: tuple[float, float]) -> npt.NDArray[np.float64]:
        matcher = by_colour(AnswerSettings(fill=fill, search="image"), scale=200.0)
        if not masks:  # as a network that predicts masks finds them, at its own size
            monkeypatch.setattr(type(matcher.reader), "_shown", found)
        placed_pair = Pair(placed(pair.source), placed(pair.target), pair.uv_a_px + corner)
        return np.asarray(
            np.linalg.norm(matcher.answer(placed_pair).uv_px - corner - pair.uv_b_px[:, 0], axis=1)
        )

    def found(reader: RopeReader, view: Frame) -> npt.NDArray[np.bool_]:
        shown = pair.source if view.key.startswith(pair.source.key) else pair.target
        return np.pad(mask_of(shown), [(corner[1], 150), (corner[0], 200)])[::5, ::5]

    pair = within(pairs[0])
    pair = replace(pair, uv_a_px=pair.uv_a_px.astype(np.float32))
    assert np.median(errors_px((0.54, 0.74))) < 0.5
    assert np.median(errors_px((0.001, 0.74))) > 1.0


def test_search_stays_in_the_mask_unless_told(pairs: list[ValidationPair]) -> None:
    pair = pairs[0]
    corner = np.zeros_like(mask_of(pair.target))
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
    nowhere = np.zeros_like(mask_of(pair.target))
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
    assert np.isnan(heat.values[~mask_of(pair.target)]).all()
    assert 0 < heat.confidence <= 1


def likely(weights: dict[int, float]) -> torch.Tensor:
    """Return log p of one query over 60 pixels, float (1, 60)."""
    p = torch.full((1, 60), 1e-12)
    for pixel, weight in weights.items():
        p[0, pixel] = weight
    return p.log()


PULLED = {23: 0.5, 24: 0.25, 59: 0.25}
"""The most probable pixel, (3.5, 2.5), has one likely neighbour."""
PEAK_AND_HILL = {0: 0.28, 57: 0.24, 58: 0.24, 59: 0.24}


@pytest.mark.parametrize(
    ("weights", "how", "place"),
    [
        (PULLED, "argmax", [3.5 + 1 / 3, 2.5]),
        (PULLED, "soft", [5.25, 3.25]),
        (PEAK_AND_HILL, "median", [8.5, 5.5]),
        (PEAK_AND_HILL, "argmax", [0.5, 0.5]),
    ],
)
def test_positions_by_hand(weights: dict[int, float], how: Decode, place: list[float]) -> None:
    found = decode_position(likely(weights), GRID, how)[0]
    assert found.tolist() == pytest.approx(place, abs=1e-6)


TWO_NEAR = {9: 0.3, 11: 0.3, 40: 0.4}
"""Pixel 40 is the highest; then 9 and 11 share a mode, of variance 1 / 2 per axis."""
SIX_APART = {20: 0.5, 26: 0.3, 50: 0.2}
"""Within 9 px the first two are one mode: mean 20 + 6 * 3 / 8, variance 36 * 15 / 64 along u."""


@pytest.mark.parametrize(
    ("weights", "widths", "radius_px", "modes"),
    [
        (TWO_NEAR, Widths(0.5), 4.0, [[40.5, 0.5, 0.4], [10.5, math.sqrt(0.5 + 0.25), 0.6]]),
        # A narrower spread moves neither modes nor weights; a single pixel has none to shrink.
        (TWO_NEAR, Widths(0.5, 0.5), 4.0, [[40.5, 0.5, 0.4], [10.5, math.sqrt(0.375), 0.6]]),
        (SIX_APART, Widths(0.0), 4.0, [[20.5, 0, 0.5], [26.5, 0, 0.3], [50.5, 0, 0.2]]),
        (SIX_APART, Widths(0.0), 9.0, [[22.75, math.sqrt(36 * 15 / 128), 0.8], [50.5, 0, 0.2]]),
    ],
)
def test_modes_by_hand(
    weights: dict[int, float], widths: Widths, radius_px: float, modes: list[list[float]]
) -> None:
    line = torch.tensor([[u + 0.5, 0.5] for u in range(60)])
    found, used = mixture_of_modes(likely(weights), line, widths, radius_px)
    shown = found[0][used[0]].numpy()
    np.testing.assert_allclose(shown[:, [0, 2, 3]], modes, atol=1e-4)
    np.testing.assert_allclose(shown[:, 1], 0.5, atol=1e-4)


def test_the_blur_of_the_target_comes_off() -> None:
    variance = torch.tensor([4.0, 2.25, 1.0])
    found = Widths(0.5, 2.0, 1.5).of(variance)
    # 4 (4 - 2.25) + 0.25 = 7.25; nothing is left of the others but a hundredth.
    expected = [math.sqrt(7.25), math.sqrt(4 * 0.0225 + 0.25), math.sqrt(4 * 0.01 + 0.25)]
    assert found.tolist() == pytest.approx(expected, rel=1e-6)
    # Squared, a deviation of 2 px becomes 4 and one of half a pixel a quarter.
    apart = Widths(0.0, 1.0, 0.0, 2.0).of(torch.tensor([4.0, 0.25]))
    assert apart.tolist() == pytest.approx([4.0, 0.25], rel=1e-6)


def test_weights_sum_to_one_and_sigmas_are_positive() -> None:
    log_p = torch.randn(50, 60, generator=torch.Generator().manual_seed(0)).log_softmax(dim=1)
    modes, used = mixture_of_modes(log_p, GRID, Widths(0.3))
    torch.testing.assert_close((modes[..., 3] * used).sum(dim=1), torch.ones(50))
    assert (modes[..., 2][used] >= 0.3).all()


@pytest.mark.usefixtures("few_tried")
def test_calibration_makes_an_overconfident_matcher_honest(pairs: list[ValidationPair]) -> None:
    """Noise makes the errors larger than the sharp softmax believes."""

    class Noisy(ColourIsPlace):
        def forward(self, image: torch.Tensor) -> torch.Tensor:
            g = torch.Generator().manual_seed(int(image.abs().sum() * 1000) % 2**31)
            return super().forward(image) + 0.7 * torch.randn(image[:, :2].shape, generator=g)

    matcher = by_colour(scale=400.0)
    matcher.network.backbone = Noisy()
    calibration = calibrate(matcher, pairs, (640, 480))
    assert calibration.temperature > 1.5
    assert calibration.figures is not None
    assert calibration.figures["ece"] < 0.1
    matcher.calibration = calibration
    answers = matcher.answer(pairs[0])
    assert answers.modes is not None
    assert all(
        abs(rows[:, 3].sum() - 1) < 1e-3 and (rows[:, 2] > 0).all() for rows in answers.modes
    )
    matcher.settings = AnswerSettings(distribution="none")
    assert matcher.answer(pairs[0]).modes is None


@pytest.mark.long
@pytest.mark.usefixtures("few_tried")
def test_rectified_views_have_a_calibration_of_their_own(
    sheet_dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Truths are 6 px off wherever the target counts as rectified: only its answers doubt more."""
    rng = np.random.default_rng(0)
    pairs = []
    for number, pair in enumerate(map(within, drawn(sheet_dataset, 24, 30))):
        off = (6 * rng.standard_normal(pair.uv_b_px.shape)).astype(np.float32)
        name = "slanted" if number % 2 else "straight"
        pairs.append(
            replace(
                pair,
                target=replace(pair.target, key=f"{name} {number}"),
                uv_b_px=pair.uv_b_px + off * (number % 2),
            )
        )
    matcher = by_colour(scale=400.0)

    def seen(view: Frame) -> Reframed:
        as_it_is = Reframed.unchanged(view)
        slanted = view.key.startswith("slanted")
        return replace(as_it_is, homography=np.eye(3), tilted=True) if slanted else as_it_is

    monkeypatch.setattr(matcher.reader, "seen", seen)
    calibration = calibrated(matcher, pairs)
    assert calibration.tilted is not None
    matcher.calibration = calibration
    straight, slanted = (first_sigmas(matcher, pair) for pair in pairs[:2])
    assert np.median(slanted) > 3 * np.median(straight)
    few = calibrate(matcher, pairs[:12], SIZE)
    assert few.tilted is None, "six pairs are too few"


def test_frames_of_two_datasets_are_not_confused(sheet_dataset: Dataset, tmp_path: Path) -> None:
    """A matcher remembers what it found in a frame by its `cache_key`."""
    other = Dataset.open(shutil.copytree(sheet_dataset.root, tmp_path / "other"))
    keys = []
    for dataset in (sheet_dataset, other):
        keys.append({pair.source.cache_key for pair in drawn(dataset, 4, 5)})
    assert not keys[0] & keys[1]


@pytest.mark.usefixtures("few_tried")
def test_views_without_masks_have_a_calibration_of_their_own(
    sheet_dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = [within(pair) for pair in drawn(sheet_dataset, 4, 30)]
    matcher = by_colour(scale=400.0)
    assert calibrate(matcher, pairs, SIZE).unmasked is None, "it finds no masks"
    monkeypatch.setattr(RopeReader, "finds_masks", True)
    calibration = calibrated(matcher, pairs)
    assert calibration.unmasked is not None
    modest = replace(calibration.unmasked, sigma_floor_px=9.0)
    matcher.calibration = replace(calibration, sigma_floor_px=0.5, unmasked=modest)
    pair = pairs[0]
    bare = replace(pair.target, mask=None, objects=None, key="bare")
    given, found = (
        first_sigmas(matcher, Pair(pair.source, target, pair.uv_a_px))
        for target in (pair.target, bare)
    )
    assert np.median(given) < 5 < 9 <= np.median(found)


@pytest.mark.long
@pytest.mark.usefixtures("few_tried")
def test_ropes_whose_ends_look_alike_have_a_calibration_of_their_own(
    sheet_dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = [within(pair) for pair in drawn(sheet_dataset, 24, 30)]
    matcher = by_colour(scale=400.0)
    assert calibrate(matcher, pairs, SIZE).either_way is None, "its ends are not alike"
    every_second = itertools.cycle([True, False])
    monkeypatch.setattr(Search, "either_way", property(lambda _: next(every_second)))
    assert calibrated(matcher, pairs).either_way is not None


def test_of_several_calibrations_that_of_found_masks_holds_first_and_a_tilts_last() -> None:
    tilted, unmasked, either = (Calibration(spread=spread) for spread in (2.0, 3.0, 4.0))
    known = Calibration(tilted=tilted, unmasked=unmasked, either_way=either)
    assert known.for_views(tilted=True, unmasked=True, either_way=True) is unmasked
    assert known.for_views(tilted=True, unmasked=False, either_way=True) is either
    assert known.for_views(tilted=True, unmasked=False, either_way=False) is tilted
    assert known.for_views(tilted=False, unmasked=False, either_way=False) is known
    older = Calibration(tilted=tilted)
    assert older.for_views(tilted=True, unmasked=True, either_way=True) is tilted
    assert older.for_views(tilted=False, unmasked=True, either_way=True) is older


@pytest.mark.usefixtures("few_tried")
def test_pairs_of_more_doubt_have_a_calibration_of_their_own(
    pairs: list[ValidationPair], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every second pair has flattened probabilities and truths moved by 9 px.

    Its doubt is therefore higher, and selects the second of the two calibrations.
    """
    rng = np.random.default_rng(0)
    mixed = []
    for number, pair in enumerate(pairs):
        vague = number % 2 == 1
        off = (9 * rng.standard_normal(pair.uv_b_px.shape)).astype(np.float32)
        target = replace(pair.target, key=f"{'vague' if vague else 'clear'} {number}")
        mixed.append(replace(pair, target=target, uv_b_px=pair.uv_b_px + off * vague))
    matcher = by_colour(scale=400.0)
    search = matcher.search

    def blurred(source: Reframed, target: Reframed, uv_a_px: npt.NDArray[np.float32]) -> Search:
        found = search(source, target, uv_a_px)
        if not target.view.key.startswith("vague"):
            return found
        flat = (found.log_p / 40).log_softmax(dim=1)
        return replace(found, log_p=flat, deciding=flat)

    monkeypatch.setattr(matcher, "search", blurred)
    together = calibrate(matcher, mixed, SIZE)
    assert together.doubtful is None, "too few pairs for groups"
    monkeypatch.setattr(calibration_module, "_PAIRS_A_GROUP", 4)
    apart = calibrated(matcher, mixed)
    assert apart.doubtful is not None
    for pair in mixed:
        views = Reframed.unchanged(pair.source), Reframed.unchanged(pair.target)
        found = blurred(*views, pair.uv_a_px)
        vague = pair.target.key.startswith("vague")
        assert apart.where(found.log_p, found.uv_px) is (apart.doubtful if vague else apart)
    each = [apart.figures, apart.doubtful.figures]
    assert together.figures is not None
    assert np.mean([found["nll"] for found in each if found]) < together.figures["nll"]


def test_doubt_is_the_log_of_the_spread() -> None:
    """Gaussians of 2 and of 5 px on a grid; and a single pixel, which has no spread."""
    grid = pixel_grid(80, 80, 1, torch.device("cpu"))
    squared = (grid - 40).square().sum(dim=1)
    log_p = torch.stack([-squared / (2 * sigma**2) for sigma in (2, 5)]).log_softmax(dim=1)
    assert mean_doubt(log_p, grid) == pytest.approx((np.log(2) + np.log(5)) / 2, abs=1e-3)
    single = torch.where(squared == squared.min(), 0.0, -200.0)[None, :1]
    assert np.isfinite(mean_doubt(single, grid[:1]))


@pytest.mark.usefixtures("few_tried")
def test_visible_is_learned_from_the_distance(pairs: list[ValidationPair]) -> None:
    """Half the truths are declared hidden, and their colour is made to be nowhere."""
    changed = []
    for number, pair in enumerate(pairs):
        hidden = number % 2 == 1
        source = pair.source
        if hidden:
            source = replace(
                source, rgb=np.uint8(255) - source.rgb // np.uint8(8), key=f"hidden {number}"
            )
        visible = np.zeros_like(pair.visible) if hidden else pair.visible
        changed.append(replace(pair, source=source, visible=visible))
    matcher = by_colour()
    calibration = calibrate(matcher, changed, SIZE)
    assert calibration.visible_slope > 0
    assert calibration.figures is not None
    assert calibration.figures["visible_accuracy"] > 0.9
    matcher.calibration = calibration
    seen = matcher.answer(changed[0]).visible
    gone = matcher.answer(changed[1]).visible
    assert seen is not None
    assert gone is not None
    assert np.median(seen) > 0.5 > np.median(gone)


def test_visible_is_a_half_at_the_threshold() -> None:
    calibration = Calibration(visible_at=2.0, visible_slope=3.0)
    p = calibration.visible(np.array([0.0, 2.0, 4.0]))
    assert p.tolist() == pytest.approx([1.0, 0.5, 1 / 9])


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
    network = build_network(NetworkSettings(name="resnet18"), NetworkInput())
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
