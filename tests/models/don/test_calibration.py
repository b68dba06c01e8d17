"""Certainty that is fitted on validation pairs: of answers, of kinds of pairs, of visibility."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from pliant.baselines.tracing import Reframed
from pliant.models.don import calibration as calibration_module
from pliant.models.don.calibration import calibrate
from pliant.models.don.certainty import Calibration, mean_log_sigma
from pliant.models.don.comparison import Search
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.rope_reader import RopeReader
from pliant.models.don.settings import AnswerSettings
from pliant.models.don.validation import ValidationPair
from pliant.models.networks.descriptor_network import pixel_grid
from pliant.spec.arrays import Float32Array
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Frame, Pair
from tests.known import known
from tests.models.don.planted import SIZE, ColourIsPlace, by_colour, drawn, within


def calibrated(matcher: DonMatcher, pairs: list[ValidationPair]) -> Calibration:
    """Return the calibration of a matcher, which a run's folder stores as it is."""
    found = calibrate(matcher, pairs, SIZE)
    assert Calibration.from_document(asdict(found)) == found
    return found


def first_sigmas(matcher: DonMatcher, pair: Pair) -> Float32Array:
    """Return the standard deviation of each answer's heaviest mode."""
    modes = known(matcher.answer(pair).modes)
    return np.array([rows[rows[:, 3].argmax(), 2] for rows in modes])


def every_second_off(pairs: Iterable[ValidationPair], by_px: float) -> list[ValidationPair]:
    """Return pairs of which every second has truths moved at random; their targets say so."""
    rng = np.random.default_rng(0)
    moved = []
    for number, pair in enumerate(pairs):
        off = (by_px * rng.standard_normal(pair.uv_b_px.shape)).astype(np.float32)
        target = replace(pair.target, key=f"{'off' if number % 2 else 'exact'} {number}")
        moved.append(replace(pair, target=target, uv_b_px=pair.uv_b_px + off * (number % 2)))
    return moved


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
    assert known(calibration.figures)["ece"] < 0.1
    matcher.calibration = calibration
    answers = matcher.answer(pairs[0])
    assert all(
        abs(rows[:, 3].sum() - 1) < 1e-3 and (rows[:, 2] > 0).all() for rows in known(answers.modes)
    )
    matcher.settings = AnswerSettings(distribution="none")
    assert matcher.answer(pairs[0]).modes is None


@pytest.mark.long
@pytest.mark.usefixtures("few_tried")
def test_rectified_views_have_a_calibration_of_their_own(
    sheet_dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Truths are 6 px off wherever the target counts as rectified: only its answers doubt more."""
    pairs = every_second_off(map(within, drawn(sheet_dataset, 24, 30)), 6)
    matcher = by_colour(scale=400.0)

    def seen(view: Frame) -> Reframed:
        as_it_is = Reframed.unchanged(view)
        slanted = view.key.startswith("off")
        return replace(as_it_is, homography=np.eye(3), tilted=True) if slanted else as_it_is

    monkeypatch.setattr(matcher.reader, "seen", seen)
    calibration = calibrated(matcher, pairs)
    assert calibration.tilted is not None
    matcher.calibration = calibration
    straight, slanted = (first_sigmas(matcher, pair) for pair in pairs[:2])
    assert np.median(slanted) > 3 * np.median(straight)
    few = calibrate(matcher, pairs[:12], SIZE)
    assert few.tilted is None, "six pairs are too few"


@pytest.mark.usefixtures("few_tried")
def test_views_without_masks_have_a_calibration_of_their_own(
    sheet_dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = [within(pair) for pair in drawn(sheet_dataset, 4, 30)]
    matcher = by_colour(scale=400.0)
    assert calibrate(matcher, pairs, SIZE).unmasked is None, "it finds no masks"
    monkeypatch.setattr(RopeReader, "finds_masks", True)
    calibration = calibrated(matcher, pairs)
    modest = replace(known(calibration.unmasked), sigma_floor_px=9.0)
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
    several = Calibration(tilted=tilted, unmasked=unmasked, either_way=either)
    assert several.for_views(tilted=True, unmasked=True, either_way=True) is unmasked
    assert several.for_views(tilted=True, unmasked=False, either_way=True) is either
    assert several.for_views(tilted=True, unmasked=False, either_way=False) is tilted
    assert several.for_views(tilted=False, unmasked=False, either_way=False) is several
    apart = Calibration(tilted=either, unmasked=Calibration(tilted=tilted))
    assert apart.for_views(tilted=True, unmasked=True, either_way=False) is tilted
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
    mixed = every_second_off(pairs, 9)
    matcher = by_colour(scale=400.0)
    search = matcher.search

    def blurred(source: Reframed, target: Reframed, uv_a_px: Float32Array) -> Search:
        found = search(source, target, uv_a_px)
        if not target.view.key.startswith("off"):
            return found
        flat = (found.log_p / 40).log_softmax(dim=1)
        return replace(found, log_p=flat, deciding=flat)

    monkeypatch.setattr(matcher, "search", blurred)
    together = calibrate(matcher, mixed, SIZE)
    assert together.doubtful is None, "too few pairs for groups"
    monkeypatch.setattr(calibration_module, "_PAIRS_A_GROUP", 4)
    apart = calibrated(matcher, mixed)
    doubtful = known(apart.doubtful)
    for pair in mixed:
        views = Reframed.unchanged(pair.source), Reframed.unchanged(pair.target)
        found = blurred(*views, pair.uv_a_px)
        vague = pair.target.key.startswith("off")
        assert apart.where(found.log_p, found.uv_px) is (doubtful if vague else apart)
    each = [apart.figures, doubtful.figures]
    assert np.mean([found["nll"] for found in each if found]) < known(together.figures)["nll"]


def test_doubt_is_the_log_of_the_spread() -> None:
    """Gaussians of 2 and of 5 px on a grid; and a single pixel, which has no spread."""
    grid = pixel_grid(80, 80, 1, torch.device("cpu"))
    squared = (grid - 40).square().sum(dim=1)
    log_p = torch.stack([-squared / (2 * sigma**2) for sigma in (2, 5)]).log_softmax(dim=1)
    assert mean_log_sigma(log_p, grid) == pytest.approx((np.log(2) + np.log(5)) / 2, abs=1e-3)
    single = torch.where(squared == squared.min(), 0.0, -200.0)[None, :1]
    assert np.isfinite(mean_log_sigma(single, grid[:1]))


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
    assert known(calibration.figures)["visible_accuracy"] > 0.9
    matcher.calibration = calibration
    seen, gone = (known(matcher.answer(pair).visible) for pair in changed[:2])
    assert np.median(seen) > 0.5 > np.median(gone)


def test_visible_is_a_half_at_the_threshold() -> None:
    calibration = Calibration(visible_at=2.0, visible_slope=3.0)
    p = calibration.visible(np.array([0.0, 2.0, 4.0]))
    assert p.tolist() == pytest.approx([1.0, 0.5, 1 / 9])
