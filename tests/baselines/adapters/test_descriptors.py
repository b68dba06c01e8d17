"""Maps of descriptors that name material places, on a rendered pair and a rendered dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.baselines import Frame, HeatMatcher
from pliant.baselines.adapters import Images, from_descriptors
from pliant.baselines.adapters.density import DensityCalibration, mixture
from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Pair
from tests.baselines.adapters.conftest import Motion, centres
from tests.evaluator.figures import figure


def waves(places: FloatArray, least: float, most: float) -> FloatArray:
    """Random plane waves of a place, (..., 48): near places have similar values."""
    rng = np.random.default_rng(2)
    angle, period = rng.uniform(0, 2 * np.pi, 24), rng.uniform(least, most, 24)
    along = places @ (2 * np.pi / period * np.stack([np.cos(angle), np.sin(angle)]))
    return np.concatenate([np.cos(along), np.sin(along)], axis=-1)


def describing(motion: Motion, cells: FloatArray) -> Any:
    """Return a function that describes the card's places at cells: first before, then after."""
    poses = iter([motion.before, motion.after])
    return lambda image: waves(next(poses).locate(cells), 90, 300)


@pytest.mark.parametrize(("stride", "most_px"), [(1, 0.02), (2, 0.02), (5, 0.06), (10, 0.25)])
@pytest.mark.parametrize("size", [None, (120, 50)])
def test_any_stride_is_refined_below_a_pixel(
    stride: int, most_px: float, size: Any, motion: Motion
) -> None:
    cells = centres(200 // stride, 240 // stride)
    method = from_descriptors(describing(motion, cells), images=Images(size=size))
    found = method.answer(Pair(motion.source, motion.target, motion.queries))
    assert np.median(motion.error(found.uv_px)) < most_px
    assert motion.error(found.uv_px).max() < 4 * most_px


@pytest.mark.parametrize("size", [None, (480, 400)])
def test_cells_that_do_not_cover_the_image(size: Any, motion: Motion) -> None:
    """Centres at 0.5, 4.5, 8.5 ... px, as of an unpadded network of stride 4."""
    factor = 1 if size is None else 2
    at = np.stack(np.meshgrid(np.arange(0.5, 237, 4), np.arange(0.5, 197, 4)), axis=-1)
    grid = (4.0 * factor, 0.5 * factor)
    method = from_descriptors(describing(motion, at), images=Images(size=size), grid=grid)
    found = method.answer(Pair(motion.source, motion.target, motion.queries))
    assert motion.error(found.uv_px).max() < 0.2


def test_tensors_have_channels_first(motion: Motion) -> None:
    torch = pytest.importorskip("torch")
    describe = describing(motion, centres(50, 60))

    def tensors(image: Any) -> Any:
        assert image.shape == (1, 3, 200, 240)
        return torch.from_numpy(describe(image)).permute(2, 0, 1)[None]

    method = from_descriptors(tensors, images=Images(device="cpu"))
    found = method.answer(Pair(motion.source, motion.target, motion.queries))
    assert motion.error(found.uv_px).max() < 0.2


def test_heat_is_the_similarity_on_the_object(motion: Motion) -> None:
    method = from_descriptors(describing(motion, centres(100, 120)))
    assert isinstance(method, HeatMatcher)
    heat = method.heat(motion.source, motion.target, motion.queries[0])
    assert motion.target.mask is not None
    np.testing.assert_array_equal(np.isfinite(heat.values), motion.target.mask)
    v, u = np.unravel_index(np.nanargmax(heat.values), heat.values.shape)
    assert np.linalg.norm([u + 0.5, v + 0.5] - motion.move(motion.queries[:1])[0]) < 2
    assert 0 < heat.confidence <= 1


def test_object_that_is_not_seen_is_the_middle() -> None:
    view = Frame(np.zeros((40, 60, 3), np.uint8), mask=np.zeros((40, 60), np.bool_))
    found = from_descriptors(lambda image: np.ones((4, 6, 3))).answer(
        Pair(view, view, np.ones((2, 2), np.float32))
    )
    assert found.uv_px.tolist() == [[30, 20]] * 2
    assert found.modes is not None


def test_mixture_of_two_equal_places() -> None:
    at = np.stack(np.meshgrid(np.arange(0, 200, 4.0), np.arange(0, 40, 4.0)), axis=-1).reshape(
        -1, 2
    )
    score = np.full((1, len(at)), -1.0)
    for place in ([40, 20], [160, 20]):
        score[0, np.linalg.norm(at - place, axis=1) < 1] = 1
    (modes,) = mixture(score, at, 4.0, DensityCalibration(temperature=0.05))
    assert sorted(modes[:, 0].tolist()) == pytest.approx([40, 160], abs=0.1)
    assert modes[:, 3].tolist() == pytest.approx([0.5, 0.5], abs=0.01)
    assert modes[:, 2].max() < 2


class Material:
    """Describes frames by the material coordinates under every third pixel, with noise."""

    def __init__(self, dataset: Dataset) -> None:
        frames = [frame for split in ("val", "test") for frame in dataset.frames(split)]
        self.by_image = {frame.rgb.tobytes(): frame for frame in frames}

    def __call__(self, image: Any) -> Any:
        surface = self.by_image[image.tobytes()].surface
        assert surface is not None
        places = np.stack([surface.m0, surface.m1], axis=-1)[1::3, 1::3].astype(float)
        noise = np.random.default_rng(0).normal(0, 0.02, places.shape)
        return waves(places + noise, 0.3, 1.5)


def test_calibration_makes_the_truth_likelier(tiny_dataset: Path) -> None:
    dataset = Dataset.open(tiny_dataset)
    method = from_descriptors(Material(dataset), grid=(3.0, 1.5))
    method.calibration = DensityCalibration(temperature=0.01)  # far too sure
    before = pliant.evaluate(dataset, pliant.predict(dataset, method))
    method.calibrate(dataset, "val", pairs=6)
    after = pliant.evaluate(dataset, pliant.predict(dataset, method))
    assert figure(after, "median_px") == figure(before, "median_px") < 4
    assert figure(after, "nll") < figure(before, "nll") - 0.5
    assert method.describe()["calibration"]["fitted_on"] == "tiny/val"
