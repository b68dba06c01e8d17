"""Where a picture shows the table: by its colour, which most of the picture has."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from pliant.models.don.table import VisibleTable
from pliant.spec.arrays import FloatArray, Rgb

SHAPE = 240, 320
CLOTH = np.s_[60:140, 150:260]
ROPE = np.s_[180:192, 20:300]
PLACES = {"table": (40.0, 30.0), "cloth": (200.0, 100.0), "rope": (100.0, 186.0)}


def pictured(table: tuple[int, ...], cloth: tuple[int, ...], mottled: float = 0.0) -> Rgb:
    """Return a rope and a cloth on a table, whose light varies by a standard deviation."""
    noise = ndimage.gaussian_filter(np.random.default_rng(3).standard_normal(SHAPE), 6)
    light: FloatArray = 1 + mottled * noise / noise.std()
    rgb = np.array(table) * light[..., None]
    rgb[CLOTH], rgb[ROPE] = cloth, (200, 60, 40)
    return np.asarray(rgb.clip(1, 255).astype(np.uint8))


@pytest.mark.parametrize("mottled", [0.0, 0.06])
@pytest.mark.parametrize(
    ("table", "cloth"), [((120, 110, 90), (120, 60, 90)), ((60, 60, 60), (100, 100, 100))]
)
def test_a_cloth_is_not_the_table(
    table: tuple[int, ...], cloth: tuple[int, ...], mottled: float
) -> None:
    rgb = pictured(table, cloth, mottled)
    objects = np.zeros(SHAPE, np.bool_)
    objects[ROPE] = True
    seen = VisibleTable(rgb, objects)
    assert seen(np.array([*PLACES.values(), (-3.0, 30.0), (40.0, 240.0)])).tolist() == [
        True,
        False,
        False,
        False,
        False,
    ]
    rows, columns = np.nonzero(~objects)
    everywhere = seen(np.stack([columns, rows], axis=1) + 0.5)
    on_cloth = np.zeros(SHAPE, np.bool_)
    on_cloth[CLOTH] = True
    assert everywhere[~on_cloth[rows, columns]].mean() > 0.9
    assert everywhere[on_cloth[rows, columns]].mean() < 0.02


def test_a_picture_of_nothing_but_objects_shows_no_table() -> None:
    rgb = pictured((120, 110, 90), (120, 60, 90))
    assert not VisibleTable(rgb, np.ones(SHAPE, np.bool_))(np.array([[40.0, 30.0]])).any()
    assert not VisibleTable(np.zeros_like(rgb), np.zeros(SHAPE, np.bool_))(
        np.array([[4.0, 3.0]])
    ).any()
