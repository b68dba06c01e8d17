from __future__ import annotations

import math

import numpy as np
import pytest

from pliant.loaders import AugmentSettings, FrameStore, PairDataset, PairSettings
from pliant.loaders.orientation import Orientation
from pliant.spec.dataset import Dataset
from pliant.spec.model import MaterialCoordinate, MaterialObject

PLAIN = MaterialCoordinate("u", 0.0, 1.0, 1.0)
FLAT = MaterialObject(1, "sheet", (PLAIN, PLAIN))
RADIUS_M = 0.01
ANGLE = MaterialCoordinate("theta", -math.pi, math.pi, RADIUS_M, 2 * math.pi)
ROUND = MaterialObject(1, "rope", (PLAIN, ANGLE))


def test_a_flat_sheet_runs_one_way_everywhere() -> None:
    """An affine map has one derivative, at scattered points and on the rim as well."""
    rng = np.random.default_rng(0)
    material = rng.uniform(0, 0.3, (200, 2))
    linear = np.array([[300.0, -50.0], [400.0, 80.0]])  # first column (300, 400): (0.6, 0.8)
    uv = (material @ linear.T + [20, 30]).astype(np.float32)
    found = Orientation(FLAT, material).of(uv, np.arange(200))
    np.testing.assert_allclose(found[:, :2], np.tile([[0.6, 0.8]], (200, 1)), atol=1e-3)
    assert np.isnan(found[:, 2]).all()  # nothing goes round


def rope(length_m: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    s, phi = np.meshgrid(np.linspace(0, length_m, 101), np.arange(8) * math.pi / 4, indexing="ij")
    return np.column_stack([s.ravel(), phi.ravel()]), s.ravel(), phi.ravel()


def test_a_bent_rope_runs_along_its_centre_line() -> None:
    """A rope along a circle of 0.3 m, seen from above at 400 px/m: the circle's own tangent."""
    material, s, phi = rope()
    angle = s / 0.3
    reach = 0.3 + RADIUS_M * np.cos(phi)  # the side towards the middle lies further in
    uv = 400 * np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1) + 200
    found = Orientation(ROUND, material).of(uv.astype(np.float32), np.arange(len(s)))
    expected = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    cosine = (found[:, :2] * expected).sum(axis=1)
    inner = (s > 0.02) & (s < 0.98)
    assert cosine[inner].min() > 0.999
    assert cosine.min() > 0.98  # one-sided at the ends
    np.testing.assert_allclose(found[:, 2], np.sin(phi), atol=1e-6)


def test_no_direction_where_none_is_known() -> None:
    rng = np.random.default_rng(1)
    material = rng.uniform(0, 1, (50, 2))
    orientation = Orientation(FLAT, material)
    behind = np.full((50, 2), np.nan, dtype=np.float32)
    assert np.isnan(orientation.of(behind, np.arange(50))).all()
    end_on = np.tile(np.array([7.0, 9.0], np.float32), (50, 1))
    assert np.isnan(orientation.of(end_on, np.arange(50))).all()


@pytest.mark.parametrize("turned", [False, True])
def test_samples_carry_them_through_augmentation(sheet_dataset: Dataset, turned: bool) -> None:
    """What turns the points from one view into the other turns the tangents as well."""
    augmentation = AugmentSettings(rotate_deg=180, scale=0.2) if turned else None
    pairs = PairDataset(
        FrameStore(sheet_dataset, "sheet", "train"),
        PairSettings(queries=40),
        augmentation=augmentation,
        orientation=True,
    )
    angles = []
    for index in range(4):
        sample = pairs[index]
        a, b = sample["uv_px"][:, :, 0].numpy().astype(np.float64)
        known = (sample["uv_px"][:, :, 0] > 0).all(dim=2).all(dim=0).numpy()
        terms = np.column_stack([a, np.ones(len(a))])[known]
        linear = np.linalg.lstsq(terms, b[known], rcond=None)[0][:2].T
        before, after = sample["orientation"].numpy()[:, known, :2]
        np.testing.assert_allclose(np.linalg.norm(before, axis=1), 1.0, atol=1e-5)
        expected = before @ linear.T
        expected /= np.linalg.norm(expected, axis=1, keepdims=True)
        np.testing.assert_allclose(after, expected, atol=5e-3)
        angles.append(math.degrees(math.atan2(linear[1, 0], linear[0, 0])))
    assert max(angles) - min(angles) > (90 if turned else 5)
