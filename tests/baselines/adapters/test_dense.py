"""Dense flow and warps of a rendered pair whose motion is known exactly."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pliant.baselines import Frame
from pliant.baselines.adapters import Images, from_flow, from_warp
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.frame import Pair
from tests.baselines.adapters.conftest import centres, counted
from tests.baselines.cards import Motion
from tests.known import known


@pytest.mark.parametrize("size", [None, (120, 50)])
@pytest.mark.parametrize("cells", [(200, 240), (25, 30)])
@pytest.mark.parametrize("channels_first", [False, True])
def test_flow(size: Any, cells: tuple[int, int], channels_first: bool, motion: Motion) -> None:
    scale = np.array(size or (240, 200)) / (240, 200)

    def flow(source: Any, target: Any) -> Any:
        assert source.shape[1::-1] == tuple(size or (240, 200))
        at = centres(*cells)
        found = (motion.move(at) - at) * scale  # px of the image that the function receives
        return found.transpose(2, 0, 1)[None] if channels_first else found

    method = from_flow(flow, images=Images(size=size))
    found = method.answer(motion.pair)
    assert motion.error(found.uv_px).max() < 1e-4  # an affine motion is bilinear
    assert found.visible is None


@pytest.mark.parametrize("coordinates", ["pixel", "index", "normalised"])
@pytest.mark.parametrize("size", [None, (120, 50)])
def test_warp(coordinates: Any, size: Any, motion: Motion) -> None:
    def warp(source: Any, target: Any) -> Any:
        to = counted(motion.move(centres(40, 60)), coordinates, size)
        return to, centres(40, 60)[..., 0] / 240  # certainty grows from left to right

    method = from_warp(warp, images=Images(size=size, coordinates=coordinates))
    found = method.answer(motion.pair)
    assert motion.error(found.uv_px).max() < 1e-4
    np.testing.assert_allclose(known(found.visible), motion.queries[:, 0] / 240, atol=1e-6)


def test_identity_at_the_image_border() -> None:
    """Half a cell is beyond the outer centres: the flow of the border continues there."""
    view = Frame(np.zeros((32, 48, 3), np.uint8))
    corners = np.array([[0, 0], [48, 32], [0.2, 31.9]], np.float32)
    for method in (
        from_flow(lambda source, target: np.zeros((4, 6, 2))),
        from_warp(lambda source, target: centres(4, 6) * [48 / 240, 32 / 200]),
    ):
        np.testing.assert_allclose(
            method.answer(Pair(view, view, corners)).uv_px, corners, atol=1e-5
        )


def test_torch_flow_on_a_device_with_a_multiple(motion: Motion) -> None:
    torch = pytest.importorskip("torch")

    def flow(source: Any, target: Any) -> Any:
        assert (source.shape, source.dtype) == ((1, 3, 256, 256), torch.float32)
        assert 0 < source.mean() < 1
        at = centres(256, 256)
        found = (motion.move(at) - at) * [256 / 240, 256 / 200]
        return torch.from_numpy(found).permute(2, 0, 1)[None].requires_grad_()

    method = from_flow(flow, images=Images(multiple=64, device="cpu"))
    found = method.answer(motion.pair)
    assert motion.error(found.uv_px).max() < 1e-3


def test_wrong_shape_is_one_sentence(motion: Motion) -> None:
    method = from_flow(lambda source, target: np.zeros((200, 240, 3)), name="mine")
    with pytest.raises(SubmissionError, match=r"'mine' returned no map; found shape \(200, 240, 3"):
        method.answer(motion.pair)
    of_three = from_flow(lambda source, target: (1, 2, 3), name="mine")
    with pytest.raises(SubmissionError, match=r"'mine' returned a tuple of another .*; found 3"):
        of_three.answer(motion.pair)


@pytest.mark.parametrize(("confidence", "visible"), [(1.0004, 1), (-0.0004, 0), (7, 7), (-1, -1)])
def test_a_confidence_is_not_made_certain(
    confidence: float, visible: float, motion: Motion
) -> None:
    """What passes 0 or 1 by more than rounding stays as it is, and the loop refuses it."""
    flow = np.zeros((20, 24, 2)), np.full((20, 24), confidence)
    found = known(from_flow(lambda source, target: flow).answer(motion.pair).visible)
    assert set(found.tolist()) == {visible}


@pytest.mark.parametrize(
    "images", [{"size": 64}, {"size": (64, 48, 3)}, {"size": (0, 5)}, {"multiple": 0}]
)
def test_sizes_that_are_none_are_refused(images: Any) -> None:
    with pytest.raises(CallError, match=r"size|multiple"):
        Images(**images)
