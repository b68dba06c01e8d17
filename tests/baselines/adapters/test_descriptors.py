"""Maps of descriptors that name material places, on a pair whose motion is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pliant.baselines import Frame, HeatMatcher
from pliant.baselines.adapters import Images, from_descriptors
from pliant.spec.arrays import FloatArray
from pliant.spec.errors import SubmissionError
from pliant.spec.frame import Pair
from tests.baselines.adapters.conftest import centres
from tests.baselines.cards import Motion
from tests.known import known


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
    found = method.answer(motion.pair)
    assert np.median(motion.error(found.uv_px)) < most_px
    assert motion.error(found.uv_px).max() < 4 * most_px


@pytest.mark.parametrize("size", [None, (480, 400)])
def test_cells_that_do_not_cover_the_image(size: Any, motion: Motion) -> None:
    """Centres at 0.5, 4.5, 8.5 ... px, as of an unpadded network of stride 4."""
    factor = 1 if size is None else 2
    at = np.stack(np.meshgrid(np.arange(0.5, 237, 4), np.arange(0.5, 197, 4)), axis=-1)
    grid = (4.0 * factor, 0.5 * factor)
    method = from_descriptors(describing(motion, at), images=Images(size=size), grid=grid)
    found = method.answer(motion.pair)
    assert motion.error(found.uv_px).max() < 0.2


@pytest.mark.parametrize("size", [None, (120, 50)])
@pytest.mark.parametrize("channels", [3, 12, 48])
def test_arrays_may_have_channels_first(channels: int, size: Any, motion: Motion) -> None:
    """Cells of 20x24 and 48 channels: the proportions of the image tell which is which."""
    found = []
    for order in ((0, 1, 2), (2, 0, 1)):
        describe = describing(motion, centres(20, 24))
        method = from_descriptors(
            lambda image: describe(image)[..., :channels].transpose(order),  # noqa: B023
            images=Images(size=size),
        )
        found.append(method.answer(motion.pair).uv_px)
    np.testing.assert_array_equal(found[0], found[1])


def test_descriptors_that_are_not_finite_are_refused(motion: Motion) -> None:
    method = from_descriptors(lambda image: np.full((4, 5, 3), np.nan))
    with pytest.raises(SubmissionError, match="not finite; found 60 of 60 values"):
        method.answer(motion.pair)


def test_tensors_have_channels_first(motion: Motion) -> None:
    torch = pytest.importorskip("torch")
    describe = describing(motion, centres(50, 60))

    def tensors(image: Any) -> Any:
        assert image.shape == (1, 3, 200, 240)
        return torch.from_numpy(describe(image)).permute(2, 0, 1)[None]

    method = from_descriptors(tensors, images=Images(device="cpu"))
    found = method.answer(motion.pair)
    assert motion.error(found.uv_px).max() < 0.2


def test_heat_is_the_similarity_on_the_object(motion: Motion) -> None:
    method = from_descriptors(describing(motion, centres(100, 120)))
    assert isinstance(method, HeatMatcher)
    heat = method.heat(motion.source, motion.target, motion.queries[0])
    np.testing.assert_array_equal(np.isfinite(heat.values), known(motion.target.mask))
    v, u = np.unravel_index(np.nanargmax(heat.values), heat.values.shape)
    assert np.linalg.norm([u + 0.5, v + 0.5] - motion.move(motion.queries[:1])[0]) < 2
    assert 0 < heat.confidence <= 1


def test_object_that_is_not_seen_is_the_middle() -> None:
    view = Frame(np.zeros((40, 60, 3), np.uint8), mask=np.zeros((40, 60), np.bool_))
    found = from_descriptors(lambda image: np.ones((4, 6, 3))).answer(
        Pair(view, view, np.ones((2, 2), np.float32))
    )
    assert found.uv_px.tolist() == [[30, 20]] * 2
