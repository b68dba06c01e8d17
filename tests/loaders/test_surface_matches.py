from __future__ import annotations

import numpy as np

from pliant.spec.dataset import Dataset
from pliant.spec.io.exr import Surface
from pliant.spec.model import MaterialCoordinate, MaterialObject
from pliant.spec.surface_search import SurfaceSearch
from tests.loaders.sheet_dataset import sheet_map


def test_matches_are_exact_to_a_fraction_of_a_pixel(sheet_dataset: Dataset) -> None:
    sheet = sheet_dataset.tiers["sheet"].queried
    a, b = sheet_dataset.sequences[0], sheet_dataset.sequences[1]
    surface = a.surface(0)
    rows, columns = (axis[::40] for axis in np.nonzero(surface.object_id == 1))
    uv_a = np.stack([columns, rows], axis=1) + 0.5
    material = np.stack([surface.m0[rows, columns], surface.m1[rows, columns]], axis=1)
    uv_b, found = SurfaceSearch(sheet, b.surface(0)).find(material)
    to_a = sheet_map(1000 * 0, 0, a.size, 0.0)
    to_b = sheet_map(1000 * 0 + 1, 0, b.size, 0.0)
    # The pixels' own material is exact, and so is the way to B: an affine map.
    np.testing.assert_allclose(material @ to_a[:, :2].T + to_a[:, 2], uv_a, atol=1e-4)
    truth = material @ to_b[:, :2].T + to_b[:, 2]
    np.testing.assert_allclose(uv_b[found], truth[found], atol=1e-3)
    assert found.mean() > 0.98


def test_hidden_points_are_not_found(sheet_dataset: Dataset) -> None:
    """Under the strip there is no sheet to be seen, at any distance more than a pixel."""
    sequence = sheet_dataset.sequences[1]
    hidden = np.array([[0.95, 0.25], [0.96, 0.4]])
    sheet = sheet_dataset.tiers["sheet"].queried
    uv, found = SurfaceSearch(sheet, sequence.surface(0)).find(hidden)
    assert not found.any()
    assert np.isnan(uv).all()


def test_an_unseen_object_gives_nothing() -> None:
    zero = np.zeros((4, 4), np.float32)
    empty = Surface(zero + np.inf, zero, zero, np.zeros((4, 4), np.uint32))
    _, found = SurfaceSearch(SHEET, empty).find(np.array([[0.5, 0.5]]))
    assert found.tolist() == [False]


SIDE = MaterialCoordinate("u", 0.0, 1.0, 1.0)
SHEET = MaterialObject(1, "sheet", (SIDE, SIDE))


def test_a_fold_is_not_bridged() -> None:
    """Two strips of one sheet lie side by side: across the seam the material jumps."""
    u = np.concatenate([np.linspace(0.0, 0.19, 20), np.linspace(0.6, 0.79, 20)])
    m0 = np.tile(u, (10, 1)).astype(np.float32)
    m1 = np.tile(np.linspace(0.2, 0.29, 10)[:, None], (1, 40)).astype(np.float32)
    surface = Surface(np.ones((10, 40), np.float32), m0, m1, np.ones((10, 40), np.uint32))
    wanted = np.array([[0.193, 0.25], [0.4, 0.25], [0.605, 0.2551]])
    uv, found = SurfaceSearch(SHEET, surface).find(wanted)
    assert found.tolist() == [True, False, True]
    np.testing.assert_allclose(uv[[0, 2]], [[19.8, 5.5], [21.0, 6.01]], atol=0.02)
