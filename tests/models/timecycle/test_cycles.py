"""The losses by name, their gradients, and where patches come from."""

from __future__ import annotations

import math

import pytest
import torch

from pliant.models.networks.descriptor_network import sample_descriptors
from pliant.models.timecycle.cycles import cycle_losses, grid_error, weighted_sum
from pliant.models.timecycle.network import (
    MomentLocaliser,
    TimeCycleNetwork,
    affinity,
    cell_grid,
    cut_patches,
    place,
    soft_inlier,
)
from pliant.models.timecycle.patches import draw_patches, interest
from pliant.models.timecycle.settings import ClipSettings, CycleLossSettings, TimeCycleSettings
from pliant.spec.configuration import read_settings
from pliant.spec.errors import CallError

NETWORK = "network={descriptor_dim: 16, widths: [8, 16, 32], global_blocks: 1}"
SETTINGS = read_settings(
    TimeCycleSettings, None, ["width=96", "height=64", "clips.patch=0.5", NETWORK]
)
WIDE = SETTINGS.replace(network=SETTINGS.network.replace(descriptor_dim=96))


def clip(network: TimeCycleNetwork, seed: int = 0) -> dict[str, torch.Tensor]:
    """A clip of four noise frames and two patches of the last, encoded."""
    generator = torch.Generator().manual_seed(seed)
    images = torch.rand(1, 4, 3, 64, 96, generator=generator)
    patches = draw_patches(
        images,
        torch.zeros(1, 4, 64, 96, dtype=torch.bool),
        network.cells,
        ClipSettings(patches=2, choose="motion", turn_deg=0, recolour=0),
        generator,
    )
    frames = network.encode(images.flatten(0, 1)).unflatten(0, (1, 4))
    return {
        "frames": frames[patches.clip],
        "patch": network.encode(patches.images).flatten(2).transpose(1, 2),
        "start": patches.placement,
        "weight": patches.weight,
    }


def only(name: str, **changes: float) -> CycleLossSettings:
    none = {"similarity": 0.0, "skip": 0.0, "long": 0.0, "self_cycle": 0.0}
    return CycleLossSettings(**{**none, name: 1.0, **changes})


@pytest.mark.parametrize("name", ["long", "skip", "similarity", "self_cycle"])
def test_each_part_alone_reaches_the_encoder(name: str) -> None:
    torch.manual_seed(1)
    network = TimeCycleNetwork(SETTINGS)
    settings = only(name)
    parts = cycle_losses(network, **clip(network), settings=settings)
    named = {key for key in parts if not key.endswith("_cells")}
    assert named == {name.removesuffix("_cycle")}
    weighted_sum(parts, settings).backward()
    gradients = [p.grad for p in network.encoder.parameters() if p.requires_grad]
    assert all(g is not None and torch.isfinite(g).all() for g in gradients)
    assert all(float(g.abs().max()) > 0 for g in gradients if g is not None)


def still(length: int, start: tuple[float, float]) -> dict[str, torch.Tensor]:
    """The losses of a still clip in which every cell is its own direction, from a wrong start.

    The patch is 4x4 cells about (5, 4): columns 3 to 6, rows 2 to 5.
    """
    network = TimeCycleNetwork(WIDE)
    network.temperature = 0.02
    frame = torch.eye(96).reshape(96, 8, 12)
    frames = frame.expand(1, length, 96, 8, 12)
    patch = frame[:, 2:6, 3:7].flatten(1).T[None]
    weight = torch.full((1, 16), 1 / 16)
    placed = torch.tensor([[*start, 0.0]])
    return cycle_losses(network, frames, patch, placed, weight, CycleLossSettings())


def test_cycles_of_a_still_and_distinct_clip_come_home() -> None:
    """Perfect descriptors (every cell its own direction) and nothing moves: no error at all."""
    parts = still(4, (5.0, 4.0))
    assert float(parts["long"]) < 1e-6
    assert float(parts["skip"]) < 1e-6
    assert float(parts["similarity"]) == pytest.approx(-1, abs=1e-4)
    assert float(parts["self"]) == pytest.approx(0, abs=1e-3)
    moved = still(4, (6.0, 5.0))  # one cell off in u and v: sqrt(2) cells
    assert float(moved["long_cells"]) == pytest.approx(2**0.5, abs=1e-3)
    assert float(moved["self"]) > 0.5


def test_the_paper_weights_are_the_defaults_and_sum_as_named() -> None:
    parts = {"long": 10.0, "skip": 3.0, "similarity": -0.5, "self": 2.0, "long_cells": 99.0}
    tensors = {name: torch.tensor(value) for name, value in parts.items()}
    total = weighted_sum(tensors, CycleLossSettings(self_cycle=0.0))
    assert float(total) == pytest.approx(0.02 * 10 + 0.1 * 3 - 0.5)


def test_cycles_are_averaged() -> None:
    """In a still clip each cycle has the same error, so that a sum would grow with the frames."""
    for length in (3, 4, 6):
        parts = still(length, (6.0, 4.0))  # a patch of 4 cells, one cell off
        assert float(parts["long"]) == pytest.approx(1 / 4**2, abs=1e-4)
        assert float(parts["skip"]) == pytest.approx(1 / 4**2, abs=1e-4)
        assert float(parts["similarity"]) == pytest.approx(-1, abs=1e-4)


def test_patches_lie_on_the_object_where_the_mask_may_be_seen() -> None:
    mask = torch.zeros(1, 2, 64, 96, dtype=torch.bool)
    mask[:, -1, 16:24, 40:56] = True  # row 2, columns 5 and 6
    chances = interest(torch.rand(1, 2, 3, 64, 96), mask, "mask", 8).reshape(8, 12)
    assert chances[2, 5:7].tolist() == pytest.approx([0.5, 0.5])
    assert float(chances.sum()) == pytest.approx(1)
    nothing = interest(torch.rand(1, 2, 3, 64, 96), torch.zeros_like(mask), "mask", 8)
    assert nothing[0].tolist() == pytest.approx([1 / 96] * 96)


def test_patches_lie_where_it_moves_and_a_still_object_is_not_forgotten() -> None:
    images = torch.full((1, 3, 3, 64, 96), 0.2)
    images[..., 0:8, 0:4] = 1.0  # still, cell (0, 0)
    for frame in range(3):
        images[0, frame, :, 40:48, 8 * frame + 8 : 8 * frame + 16] = 1.0  # moves along row 5
    unseen = torch.ones(1, 3, 64, 96, dtype=torch.bool)
    chances = interest(images, unseen, "motion", 8).reshape(8, 12)
    assert float(chances[5, 1:4].sum()) > 0.7
    assert float(chances[0, 0]) > 0.05
    assert float(chances.sum()) == pytest.approx(1)
    still = interest(torch.full((1, 3, 3, 64, 96), 0.2), unseen, "motion", 8)
    assert still[0].tolist() == pytest.approx([1 / 96] * 96)


def test_cells_off_the_object_or_the_frame_count_little() -> None:
    mask = torch.zeros(1, 2, 64, 96, dtype=torch.bool)
    mask[:, -1, :8, :8] = True
    patches = draw_patches(
        torch.rand(1, 2, 3, 64, 96),
        mask,
        4,
        ClipSettings(patches=3, choose="mask", turn_deg=180, recolour=0.1),
        torch.Generator().manual_seed(0),
    )
    assert patches.images.shape == (3, 3, 32, 32)
    assert patches.weight.sum(dim=1).tolist() == pytest.approx([1, 1, 1])
    # The patches lie within the frame's corner, the object in their own: few cells count.
    assert float(patches.weight.max(dim=1).values.min()) > 3 / 16
    assert float(patches.placement[:, :2].min()) >= 2.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("width=100", "multiple of 8"),
        ("clips.step_max=0", "clips.step_max: "),
        ("losses={similarity: 0, skip: 0, long: 0, self_cycle: 0}", "one weight above 0"),
        ("propagation={context: 0, first_weight: 0}", "above 0 without context frames"),
        ("kind=don", "unknown value"),
    ],
)
def test_settings_that_cannot_be_are_refused(change: str, message: str) -> None:
    with pytest.raises(CallError, match=message):
        read_settings(TimeCycleSettings, None, [change])


@pytest.mark.parametrize("name", ["unet", "resnet18"])
@pytest.mark.parametrize("stride", [4, 8])
def test_networks_describe_cells_by_unit_vectors(name: str, stride: int) -> None:
    network = TimeCycleNetwork(SETTINGS.replace(network=SETTINGS.network.replace(name=name)))
    images = torch.rand(1, 3, 64, 96)
    with torch.no_grad():
        found = network.eval().encode(images, stride)
        pixels = network.encoder(images)
    assert found.shape == (1, 16, 64 // stride, 96 // stride)
    torch.testing.assert_close(found.norm(dim=1), torch.ones_like(found[:, 0]))
    mean = pixels[0, :, :stride, stride : 2 * stride].mean(dim=(1, 2))
    torch.testing.assert_close(found[0, :, 0, 1], torch.nn.functional.normalize(mean, dim=0))


def test_with_a_lift_products_follow_distances() -> None:
    """1 - <a, b> is half the squared distance over the squared lift, where the lift is long."""
    network = TimeCycleNetwork(SETTINGS.replace(lift=50.0)).eval()
    images = torch.rand(1, 3, 64, 96)
    with torch.no_grad():
        lifted = network.encode(images)[0].flatten(1).double()
        cells = torch.nn.functional.avg_pool2d(network.encoder(images), 8)[0].flatten(1)
    products = 1 - lifted.T @ lifted
    distances = torch.cdist(cells.T.double(), cells.T.double()).square() / (2 * 50.0**2)
    torch.testing.assert_close(products, distances, rtol=0.02, atol=1e-6)


SIZE = (16, 12)
CELLS = 4
QUARTER = 0.25


def random_frame(batch: int = 1) -> torch.Tensor:
    """Unit descriptors that no two cells share, a little smooth so that places between exist."""
    generator = torch.Generator().manual_seed(5)
    maps = torch.randn(batch, 32, SIZE[1] + 2, SIZE[0] + 2, generator=generator)
    smooth = torch.nn.functional.avg_pool2d(maps, 3, stride=1)
    return torch.nn.functional.normalize(smooth, dim=1)


def patch_at(frame: torch.Tensor, placement: torch.Tensor) -> torch.Tensor:
    found = sample_descriptors(frame, place(placement, cell_grid(CELLS, frame.device)))
    return torch.nn.functional.normalize(found, dim=2)


def test_a_patch_upright_on_whole_cells_is_those_cells() -> None:
    frame = random_frame()
    # Centre (5, 4) of 4x4 cells: columns 3 to 6, rows 2 to 5.
    patch = patch_at(frame, torch.tensor([[5.0, 4.0, 0.0]]))
    torch.testing.assert_close(patch[0], frame[0, :, 2:6, 3:7].flatten(1).T)


def test_a_quarter_turn_moves_the_patch_clockwise() -> None:
    """Its top-left cell comes to lie in the top right: u turns towards v."""
    corners = place(torch.tensor([[5.0, 4.0, math.pi / 2]]), cell_grid(CELLS, torch.device("cpu")))
    torch.testing.assert_close(corners[0, 0], torch.tensor([6.5, 2.5]))
    torch.testing.assert_close(corners[0, -1], torch.tensor([3.5, 5.5]))


def test_affinity_of_two_cells() -> None:
    """Products 1 and 0 at temperature 0.5: softmax(2, 0)."""
    frame = torch.tensor([[1.0, 0.0], [0.0, 1.0]]).reshape(1, 2, 1, 2)
    found = affinity(torch.tensor([[[1.0, 0.0]]]), frame, 0.5)
    expected = math.exp(2) / (math.exp(2) + 1)
    assert found.flatten().tolist() == pytest.approx([expected, 1 - expected])


def test_soft_inliers_of_one_cell() -> None:
    """Mass 0.6 where it belongs, 0.4 one cell beside: 0.6 + 0.4 exp(-1/2)."""
    affinities = torch.zeros(1, 1, 6)
    affinities[0, 0, 1], affinities[0, 0, 4] = 0.6, 0.4  # (1, 0) and (1, 1) of a grid 3 wide
    found = soft_inlier(affinities, torch.tensor([[[1.5, 0.5]]]), 3, 1.0)
    assert float(found) == pytest.approx(0.6 + 0.4 * math.exp(-0.5))


def test_the_grid_error_of_a_shift_and_of_a_turn() -> None:
    """A shift by one side counts 1. A turn by a moves a point at r by 2 r sin(a / 2)."""
    still = torch.tensor([[5.0, 4.0, 0.0]])
    shifted = torch.tensor([[5.0, 8.0, 0.0]])
    assert float(grid_error(still, shifted, CELLS)) == pytest.approx(1.0, rel=1e-6)
    turned = torch.tensor([[5.0, 4.0, 0.4]])
    square = cell_grid(CELLS, torch.device("cpu"), points=20).square().sum(dim=1).mean()
    expected = 4 * math.sin(0.2) ** 2 * float(square) / CELLS**2
    assert float(grid_error(still, turned, CELLS)) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    "placement",
    [[5.0, 4.0, 0.0], [9.0, 7.0, 0.0], [7.5, 6.25, 0.0], [8.0, 6.0, 0.5], [7.3, 5.6, -1.2]],
    ids=["shift", "another", "between cells", "turn", "turn and shift"],
)
def test_moments_find_a_shift_and_a_turn(placement: list[float]) -> None:
    """Within a quarter of a cell, at every corner of the patch."""
    frame, wanted = random_frame(), torch.tensor([placement])
    found = MomentLocaliser(SIZE, CELLS)(affinity(patch_at(frame, wanted), frame, 0.1))
    corners = cell_grid(CELLS, torch.device("cpu"), points=2) * 2
    gap = (place(found, corners) - place(wanted, corners)).norm(dim=2)
    assert float(gap.max()) < QUARTER


def test_patches_are_cut_in_pixels() -> None:
    """Upright on whole cells, a cut is a slice of the image; align_corners is off throughout."""
    image = torch.rand(1, 3, 96, 128)
    cut = cut_patches(image, torch.tensor([[5.0, 4.0, 0.0]]), CELLS)
    torch.testing.assert_close(cut, image[:, :, 16:48, 24:56], atol=1e-5, rtol=0)
