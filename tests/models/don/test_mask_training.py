"""The network that finds a rope and its ball in a picture, and its training."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from pliant.models.don.mask_training import _coloured, _sample, fit_masks
from pliant.models.networks.mask_network import MASKS, MaskNetwork
from pliant.models.shipped import FOLDER
from pliant.models.training.checkpoint import load_weights
from pliant.spec.frame import Frame
from tests.models.don.test_segmentation import HEIGHT, WIDTH, overlap, scene

ROPE, BALL = scene()[1:3]


def painted() -> Frame:
    return Frame(scene()[0], mask=ROPE, objects=ROPE | BALL)


def test_the_shipped_network_finds_rope_and_ball_without_the_shadow() -> None:
    network = MaskNetwork()
    load_weights(network, FOLDER / "don-rope" / MASKS)
    rgb, rope, ball, shadow = scene()
    p_rope, p_objects = network.found(rgb)
    assert p_objects[ball].mean() > 0.8
    assert p_objects[shadow].mean() < 0.05
    assert overlap(p_rope > 0.5, rope) > 0.8
    # A picture of another size is seen at the same width.
    halved = network.found(np.ascontiguousarray(rgb[::2, ::2]))
    assert halved.shape == (2, HEIGHT, WIDTH)
    assert overlap(halved[1] > 0.5, p_objects > 0.5) > 0.7


def test_a_sample_shows_what_its_masks_say() -> None:
    frame = painted()
    rgb = np.zeros_like(frame.rgb)
    rgb[ROPE] = [255, 0, 0]
    rgb[BALL] = [0, 255, 0]
    rng = np.random.default_rng(3)
    for _ in range(5):
        sample = _sample(frame.replace(rgb=rgb), rng)
        rope, objects = sample[3], sample[4]
        torch.testing.assert_close(sample[0], rope, atol=1e-5, rtol=0)
        torch.testing.assert_close(sample[1], objects - rope, atol=1e-5, rtol=0)
        assert objects.max() > 0.5


def test_other_colours_leave_objects_where_they_are() -> None:
    torch.manual_seed(0)
    objects = torch.zeros(1, 1, 64, 80)
    objects[..., 20:40, 30:60] = 1
    picture = torch.where(objects > 0, torch.tensor([0.8, 0.3, 0.2]).view(1, 3, 1, 1), 0.4)
    edges = []
    for _ in range(20):
        drawn = _coloured(picture.clone(), objects)
        assert drawn.shape == picture.shape
        assert 0 <= float(drawn.min()) <= float(drawn.max()) <= 1
        across = (drawn[0, :, 30, 1:] - drawn[0, :, 30, :-1]).abs().sum(dim=0)
        edges.append(float(across[[29, 59]].mean() / across.mean()))
    assert np.median(edges) > 5


@pytest.mark.long
def test_a_short_training_finds_a_rope() -> None:
    frame = painted()
    network = fit_masks([[frame]], steps=80, seed=0)
    again = fit_masks([[frame]], steps=2, seed=0)
    torch.testing.assert_close(
        again.state_dict(), fit_masks([[frame]], steps=2, seed=0).state_dict(), rtol=0, atol=0
    )
    assert overlap(network.found(frame.rgb)[0] > 0.5, ROPE) > 0.8
