"""Tables with a pattern, which networks that were trained on plain ones are not shown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pliant.models.don.table import on_plain_table
from pliant.spec.frame import Frame, Pair
from tests.known import known
from tests.models.shipped_models import shipped_don


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
