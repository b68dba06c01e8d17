"""The network that finds a rope and its ball in a picture, and its training."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from scipy import ndimage

from pliant.models.don import painted_tables
from pliant.models.don.loading import load_masks
from pliant.models.don.mask_training import (
    SAMPLINGS,
    _sample,
    coloured,
    fit_masks,
)
from pliant.models.don.painted_tables import _PATTERNS, painted_table
from pliant.models.networks.mask_network import CLOTH_SIDE, MASKS, WIDE
from pliant.models.shipped import FOLDER
from pliant.spec.frame import Frame
from tests.models.don.test_segmentation import BALL, HEIGHT, ROPE, WIDTH, overlap, scene


def painted() -> Frame:
    return Frame(scene()[0], mask=ROPE, objects=ROPE | BALL)


def test_the_shipped_network_finds_rope_and_ball_without_the_shadow() -> None:
    network = load_masks(FOLDER / "don-rope" / MASKS)
    rgb, rope, ball, shadow = scene()
    p_rope, p_objects = network.found(rgb)
    assert p_objects[ball].mean() > 0.8
    # The network's output cells are 2 px wide, so the object's edge reaches 1 px into the shadow.
    beyond = shadow & ~ndimage.binary_dilation(rope | ball)
    assert p_objects[beyond].mean() < 0.05
    assert overlap(p_rope > 0.5, rope) > 0.8
    # Upright and narrow pictures are not enlarged beyond that.
    assert network.found(np.zeros((2000, 17, 3), np.uint8)).shape == (2, 640, 5)
    upright = network.found(np.ascontiguousarray(np.rot90(rgb)))
    assert overlap(np.rot90(upright[0] > 0.5, -1), rope) > 0.8
    # A picture of another size is seen at the same one.
    halved = network.found(np.ascontiguousarray(rgb[::2, ::2]))
    assert halved.shape == (2, HEIGHT, WIDTH)
    assert overlap(halved[1] > 0.5, p_objects > 0.5) > 0.7


def test_the_shipped_network_finds_a_cloth_and_not_the_cable_on_it() -> None:
    network = load_masks(FOLDER / "don-cloth" / MASKS)
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    cloth = (np.abs(u - 260) < 140) & (np.abs(v - 240) < 130)
    cable = np.abs(v - 60 - 0.5 * u - 30 * np.sin(u / 60)) < 6
    light = 0.7 + 0.3 * u / WIDTH + 0.05 * np.sin(u / 25 + v / 40)
    rgb = np.full((HEIGHT, WIDTH, 3), [120.0, 105.0, 90.0])
    rgb[cloth], rgb[cable] = [70, 140, 90], [30, 30, 35]
    picture = (rgb * light[..., None]).clip(0, 255).astype(np.uint8)
    found = network.found(picture, CLOTH_SIDE)[0]
    p = np.kron(found, np.ones((2, 2)))
    assert overlap(p > 0.5, cloth & ~cable) > 0.8
    assert p[cable & ~cloth].mean() < 0.2


def test_a_sample_shows_what_its_masks_say() -> None:
    frame = painted()
    rgb = np.zeros_like(frame.rgb)
    rgb[ROPE] = [255, 0, 0]
    rgb[BALL] = [0, 255, 0]
    rng = np.random.default_rng(3)
    for _ in range(5):
        sample = _sample(frame.replace(rgb=rgb), rng, SAMPLINGS["rope"])
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
    for relit in [False] * 20 + [True] * 60:
        drawn = coloured(picture.clone(), objects.expand(1, 2, 64, 80), 0.0, relit=relit)
        assert drawn.shape == picture.shape
        assert 0 <= float(drawn.min()) <= float(drawn.max()) <= 1
        across = (drawn[0, :, 30, 1:] - drawn[0, :, 30, :-1]).abs().sum(dim=0)
        edges.append(float(across[[29, 59]].mean() / across.median()))  # patterns have edges too
    assert np.median(edges[:20]) > 5
    assert np.median(edges[20:]) > 5


def test_further_sets_are_seen_in_later_cycles_alone() -> None:
    steps: list[int] = []
    seen_after: set[int] = set()

    class Further(list[Frame]):
        def __getitem__(self, index: Any) -> Any:
            seen_after.add(len(steps))
            return super().__getitem__(index)

    fit_masks(
        [[painted()]],
        steps=1,
        later=(2,),
        later_sets=[Further([painted()])],
        seed=0,
        sampling=SAMPLINGS["rope"],
        progress=lambda step, _: steps.append(step),
    )
    assert seen_after == {1, 2}


@pytest.mark.long
def test_a_short_training_finds_a_rope() -> None:
    frame = painted()
    losses: list[float] = []
    network = fit_masks(
        [[frame]],
        steps=100,
        later=(8, 8),
        seed=0,
        sampling=SAMPLINGS["rope"],
        progress=lambda step, figures: losses.append(figures["loss"]),
    )
    assert len(losses) == 116
    assert np.mean(losses[90:100]) < 0.5 * np.mean(losses[:10])
    once, again = (
        fit_masks([[frame]], steps=2, later=(2,), widen=True, seed=0, sampling=SAMPLINGS["rope"])
        for _ in range(2)
    )
    assert len(once.state_dict()["encoder.1.conv1.weight"]) == WIDE[1]
    torch.testing.assert_close(again.state_dict(), once.state_dict(), rtol=0, atol=0)
    assert overlap(network.found(frame.rgb)[0] > 0.5, ROPE) > 0.8


SHAPE = (128, 160)


def test_a_table_is_a_picture_that_its_seed_decides() -> None:
    first, again, other = (painted_table(*SHAPE, np.random.default_rng(k)) for k in (4, 4, 5))
    assert first.shape == (*SHAPE, 3)
    assert first.dtype == np.float32
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).mean() > 0.05


def test_tables_have_edges_of_all_directions_and_contrasts() -> None:
    rng = np.random.default_rng(0)
    tables = [painted_table(*SHAPE, rng) for _ in range(60)]
    assert min(table.min() for table in tables) >= 0
    assert max(table.max() for table in tables) <= 1
    steps = np.array([np.percentile(np.abs(np.diff(t, axis=1)).max(axis=2), 99) for t in tables])
    assert np.percentile(steps, 10) < 0.3
    assert np.percentile(steps, 90) > 0.8
    colour = [np.ptp(table, axis=2).mean() for table in tables]
    assert min(colour) < 0.05 < 0.3 < max(colour)
    across, down = (
        np.array([np.abs(np.diff(table, axis=axis)).mean() for table in tables]) for axis in (1, 0)
    )
    assert (across > 2 * down).any()
    assert (down > 2 * across).any()


@pytest.mark.parametrize("pattern", _PATTERNS)
def test_every_pattern_differs_from_a_plain_table(pattern: painted_tables.Pattern) -> None:
    rng = np.random.default_rng(1)
    drawn = [pattern(SHAPE, rng) for _ in range(12)]
    assert {table.shape for table in drawn} == {(*SHAPE, 3)}
    assert {table.dtype for table in drawn} == {np.dtype(np.float32)}
    assert np.mean([table.std(axis=(0, 1)).max() > 0.02 for table in drawn]) > 0.7
