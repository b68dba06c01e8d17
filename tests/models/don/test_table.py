"""Where a picture shows the table: by its colour, which most of the picture has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from pliant.models.don.table import VisibleTable, on_plain_table
from pliant.spec.arrays import FloatArray, Rgb
from pliant.spec.frame import Frame, Pair
from tests.known import known
from tests.models.shipped_models import shipped_don

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


def on_chequers(frame: Frame) -> Frame:
    """The object on a table of grey squares of 40 px."""
    rows, columns = np.indices(known(frame.mask).shape) // 40
    chequers = np.where((rows + columns) % 2, 60, 200)[..., None]
    rgb = np.where(known(frame.mask)[..., None], frame.rgb, chequers).astype(np.uint8)
    return frame.replace(rgb=rgb, key=f"{frame.key}/chequers")


def test_a_pattern_of_the_table_does_not_move_the_answers(blank_cloths: list[Pair]) -> None:
    moved = {}
    for plain in (True, False):
        matcher = shipped_don("don-cloth", plain_table=plain)
        gaps = []
        for pair in blank_cloths:
            other = replace(pair, source=on_chequers(pair.source), target=on_chequers(pair.target))
            gaps.append(matcher.answer(other).uv_px - matcher.answer(pair).uv_px)
        moved[plain] = np.median(np.linalg.norm(np.concatenate(gaps), axis=1))
    assert moved[True] < 2.5
    assert moved[False] > 3 * moved[True]


def test_light_from_one_side_stays_and_the_objects_are_not_changed() -> None:
    across = np.linspace(80, 220, 240).astype(np.uint8)
    rgb = np.broadcast_to(across[:, None], (180, 240, 3)).copy()
    rgb[::2] += 20
    objects = np.zeros((180, 240), dtype=np.bool_)
    objects[60:120, 90:150] = True
    rgb[objects] = (10, 200, 30)
    plain = on_plain_table(rgb, objects).astype(int)
    assert (plain[objects] == (10, 200, 30)).all()
    assert np.abs(np.diff(plain[:40, :, 0], axis=0)).max() <= 1  # the stripes are gone
    assert plain[20, 200, 0] - plain[20, 40, 0] > 40
    nothing = np.zeros_like(objects)
    assert (on_plain_table(rgb, nothing) == rgb).all()
    assert (on_plain_table(rgb, ~nothing) == rgb).all()
