"""Affinity and localisers on cases worked out by hand; positions in cells of 8 px."""

from __future__ import annotations

import math

import pytest
import torch

from pliant.models.networks.descriptor_network import sample_descriptors
from pliant.models.timecycle.affinity import affinity, soft_inlier
from pliant.models.timecycle.cycles import grid_error
from pliant.models.timecycle.network import MomentLocaliser
from pliant.models.timecycle.placement import cell_grid, cut_patches, place

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
