"""Pixels around points: which are smooth, what is behind them, and which points they settle.

As in test_visibility.py: a sheet faces the camera at 1 m, a pixel is 1 cm.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from pliant.spec.io.exr import Surface
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules import visibility
from pliant.spec.validation.rules.correspondences import OCCLUDED, SELF_OCCLUDED, VISIBLE
from pliant.spec.validation.rules.visibility import _edge_on, _in_doubt, check_visibility
from pliant.spec.validation.rules.windows import FrameView, Windows, _is_behind, is_thin
from tests.spec.validation.test_visibility import (
    AT,
    CLOTH,
    HEIGHT,
    NO_CLOTH,
    ROPE,
    SHEET,
    WIDTH,
    U,
    V,
    codes,
    image,
    view,
)

ON_ROPE = image(object_id=0 * U + ROPE, depth_m=0 * U + 0.9, m0=0 * U + 7, m1=0 * U)
EMPTY = image(object_id=0 * U, depth_m=0 * U + np.inf, m0=0 * U, m1=0 * U)
LINE = {"object": ROPE, "line": True, "material": (7, 3), "depth": 0.9}
HIDDEN = {"state": SELF_OCCLUDED, "material": (50, 40)}


@pytest.mark.parametrize(
    ("shown", "point", "doubtful"),
    [
        # Visible: within three footprints, 3 % of its own depth, of its own pixel.
        (image(), {"depth": 1.0309}, False),
        (image(), {"depth": 1.0310}, True),
        (image(), {"depth": 0.9709}, False),
        (image(), {"depth": 0.9708}, True),
        (image(), {"material": (33.49, 25.5)}, False),
        (image(), {"material": (33.51, 25.5)}, True),
        (image(), {"material": (30.5, 22.49)}, True),
        (image(), {"object": ROPE, "material": (0, 0)}, True),
        (image(), {"object": ROPE, "material": (0, 0), "depth": 6.1}, False),  # thinner than 2 px
        (EMPTY, {}, True),
        # On the centre line also 1.25 diameters of 12 cm below, and along it; m1 does not count.
        (ON_ROPE, LINE | {"depth": 1.082}, False),
        (ON_ROPE, LINE | {"depth": 1.083}, True),
        (ON_ROPE, LINE | {"material": (24.6, 3)}, False),
        (ON_ROPE, LINE | {"material": (24.8, 3)}, True),
        (ON_ROPE, LINE | {"line": False}, True),
        # Hidden: not nearer than its pixel, by the object that the pixel shows.
        (image(), HIDDEN | {"depth": 0.9709}, False),
        (image(), HIDDEN | {"depth": 0.9708}, True),
        (ON_ROPE, HIDDEN, True),
        (EMPTY, HIDDEN | {"depth": 3.0}, True),  # in front of nothing
        (image(), HIDDEN | {"state": OCCLUDED, "depth": 3.0}, True),
        (ON_ROPE, HIDDEN | {"state": OCCLUDED}, False),
        (ON_ROPE, HIDDEN | {"state": OCCLUDED, "depth": 0.87}, True),
        (EMPTY, HIDDEN | {"state": OCCLUDED}, True),
        # On a cloth also not near what it shows: 1.5 footprints, and 2 steps of 3 of the pixel's.
        (image(), {"state": SELF_OCCLUDED, "depth": 1.0760}, True),
        (image(), {"state": SELF_OCCLUDED, "depth": 1.0780}, False),
        (image(), {"state": SELF_OCCLUDED, "material": (30.5, 32.9)}, True),
        (image(), {"state": SELF_OCCLUDED, "material": (30.5, 33.2)}, False),
    ],
)
def test_which_points_their_own_pixel_does_not_settle(
    shown: Surface, point: dict[str, Any], doubtful: bool
) -> None:
    chosen, pixel = np.array([0]), np.array([[30, 25]])
    assert _in_doubt(view(shown, [{"at": AT} | point]), chosen, pixel).tolist() == [doubtful]
    if point.get("state") == SELF_OCCLUDED and "material" not in point:
        other = view(shown, [{"at": AT} | point], NO_CLOTH)
        assert _in_doubt(other, chosen, pixel).tolist() == [False]


def around(seen: FrameView) -> Windows:
    chosen = np.arange(len(seen.rows.point))
    return Windows.around(seen, chosen, np.floor(seen.rows.uv_px).astype(np.int64))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(
    ("shown", "smooth"),
    [
        # Between pixels 31 and 32 along u (26 and 27 along v), which are both in the window.
        (lambda x, m: {"depth_m": 1 + 0.0299 * (x > 2)}, True),
        (lambda x, m: {"depth_m": 1 + 0.0301 * (x > 2)}, False),
        (lambda x, m: {"depth_m": 1 - 0.0301 * (x > 2)}, False),
        (lambda x, m: {"depth_m": 1 + 0.0301 * (x < -1)}, False),
        (lambda x, m: {"depth_m": 1 + 0.5 * (x > 3)}, True),
        (lambda x, m: {"depth_m": 1 + 0.5 * (x < -2)}, True),
        # The footprint is that of the surface that is shown, twice as far away.
        (lambda x, m: {"depth_m": 2 + 0.0599 * (x > 2)}, True),
        (lambda x, m: {"depth_m": 2 + 0.0601 * (x > 2)}, False),
        # The material makes a step of 1 cm from pixel to pixel, and of 2 cm more here.
        (lambda x, m: {m: 1.99 * (x > 2)}, True),
        (lambda x, m: {m: 2.01 * (x > 2)}, False),
        (lambda x, m: {"object_id": SHEET + (x > 2)}, False),
        (lambda x, m: {"object_id": SHEET + (x > 3)}, True),
        (lambda x, m: {"object_id": SHEET * (x < -1)}, False),
    ],
)
def test_where_a_surface_is_smooth(axis: int, shown: Any, smooth: bool) -> None:
    """The 5x5 pixels around (30, 25) have one object and steps of at most three footprints."""
    x = (U - 30.5 if axis == 0 else V - 25.5) + 0.5
    channels = shown(x, "m0" if axis == 0 else "m1")
    channels |= {name: channels[name] + base for name, base in (("m0", U), ("m1", V))
                 if name in channels}  # fmt: skip
    found = around(view(image(**channels), [{"at": AT}]))
    assert found.smooth.tolist() == [smooth]
    assert found.uniform.tolist() == [smooth or "object_id" not in channels]


@pytest.mark.parametrize(("second", "smooth"), [(2.02, True), (2.06, False)])
def test_both_coordinates_make_one_step(second: float, smooth: bool) -> None:
    """2.2 cm of one and 2.04 cm of the other are 3 cm."""
    shown = image(m0=U + 1.2 * (U > 32), m1=V + second * (U > 32))
    assert around(view(shown, [{"at": AT}])).smooth.tolist() == [smooth]


def test_what_a_window_holds() -> None:
    ids = np.where(U > 32, ROPE, SHEET)
    depth = 1 + 0.001 * U + 0.01 * V
    seen = view(
        image(object_id=ids, depth_m=depth),
        [{"at": (30.9, 25.1), "material": (30, 25), "depth": 2.0},
         {"at": (34.2, 20.3), "object": ROPE, "material": (34, 3), "depth": 4.0}],
    )  # fmt: skip
    found = around(seen)
    assert found.pixel.tolist() == [[30, 25], [34, 20]]
    assert found.own.tolist() == [SHEET, ROPE]
    assert found.footprint_m.tolist() == [0.02, 0.04]
    assert found.point_depth_m.tolist() == [2, 4]
    first, second = np.s_[23:28, 28:33], np.s_[18:23, 32:37]
    np.testing.assert_array_equal(found.object_id, [ids[first], ids[second]])
    np.testing.assert_array_equal(
        found.depth_m, np.array([depth[first], depth[second]], np.float32)
    )
    np.testing.assert_array_equal(found.near_m, found.depth_m[:, 1:4, 1:4])
    np.testing.assert_array_equal(found.near_id, found.object_id[:, 1:4, 1:4])
    expected = [np.hypot(dx, dy) / 100 for dy in (-0.5, 0.5, 1.5) for dx in (-0.5, 0.5, 1.5)]
    np.testing.assert_allclose(found.away_m[0].ravel(), expected, rtol=1e-4)
    # Round the rope the way back is shorter: from 3 to 19.5 radians are -2.07 with full turns.
    turn = [(v - 3 + np.pi) % (2 * np.pi) - np.pi for v in (19.5, 20.5, 21.5)]
    along = np.array([-0.5, 0.5, 1.5]) / 100
    np.testing.assert_allclose(
        found.away_m[1], np.hypot(along[None], 0.06 * np.array(turn)[:, None]), rtol=1e-4
    )
    assert np.isinf(view(image(), [{"at": AT, "object": ROPE}]).steps_m(
        np.array([0]), np.array([0]))).all()  # fmt: skip
    diameters = seen.diameter_m(np.array([SHEET, ROPE, 0], np.int32))
    np.testing.assert_allclose(diameters, [0, 0.12, 0])
    assert is_thin(diameters[[0, 1, 1]], np.array([9, 0.0599, 0.0601])).tolist() == [
        False, False, True,
    ]  # fmt: skip


def behind(z: npt.NDArray[Any], inside: tuple[float, float], *, smooth: bool = True) -> float:
    """Return the depth from which on a point is behind a surface, by bisection."""
    low, high = 0.0, 4.0
    for _ in range(40):
        middle = (low + high) / 2
        found = _is_behind(
            z[None].astype(np.float32), np.array([inside]), np.array([middle]), np.array([smooth])
        )
        low, high = (low, middle) if found[0] else (middle, high)
    return high


def test_from_which_depth_a_point_is_behind_its_pixels() -> None:
    """Pixel centres are at -2 to 2; a point at (0.7, 0.4) of its pixel is at (0.2, -0.1)."""
    x, y = np.meshgrid(np.arange(-2.0, 3), np.arange(-2.0, 3))
    plane = 2 + 0.03 * x + 0.05 * y
    for inside in ((0.7, 0.4), (0.2, 0.9), (0.5, 0.5), (0.0, 0.0), (0.99, 0.01)):
        u, v = inside[0] - 0.5, inside[1] - 0.5
        limit = 2 + 0.03 * u + 0.05 * v
        assert behind(plane, inside) == pytest.approx(limit * (1 - 1e-6), abs=3e-7)
    # Elsewhere it must be behind all of the nearest nine.
    assert behind(plane, (0.7, 0.4), smooth=False) == pytest.approx(2.08, abs=1e-6)
    # The largest second difference is the error: 2 cm, and half of 1 cm by interpolation.
    for bent in (x, y):
        found = behind(2 + 0.01 * bent**2, (0.0, 0.0))
        assert found == pytest.approx(2 + 0.005 - 0.02 - 2e-6, abs=1e-6)
    both = 2 + 0.01 * x**2 + 0.03 * y**2
    assert behind(both, (0.5, 0.5)) == pytest.approx(2 - 0.06 - 2e-6, abs=1e-6)


def test_behind_an_object_alone() -> None:
    """Nothing is behind the background, or said where two objects are seen."""
    for shown, expected in (
        (image(), [True, False]),
        (EMPTY, [False, False]),
        (image(object_id=np.where(U > 32, ROPE, SHEET)), [False, False]),
    ):
        seen = view(shown, [{"at": AT, "depth": 1.1}, {"at": (30.5, 26.5), "depth": 0.9}])
        found = around(seen)
        assert found.behind(np.array([True, True])).tolist() == expected
        assert found.behind(np.array([False, False])).tolist() == [False, False]


@pytest.mark.parametrize(
    ("at", "pixel"),
    [
        # Within 16 pixels, up to the first and the last row and column.
        ((5.5, 6.5), (0, 6)),
        ((5.5, 6.5), (5, 0)),
        ((5.5, 6.5), (21, 22)),
        ((54.5, 45.5), (59, 45)),
        ((54.5, 45.5), (54, 49)),
        ((54.5, 45.5), (38, 29)),
    ],
)
def test_a_part_is_looked_for_up_to_the_border(
    at: tuple[float, float], pixel: tuple[int, int]
) -> None:
    ids = np.full((HEIGHT, WIDTH), SHEET)
    ids[pixel[1], pixel[0]] = ROPE
    seen = view(image(object_id=ids), [{"at": at, "object": ROPE}, {"at": at}, {"at": at}])
    found = around(seen)
    all_ = np.array([True, True, False])
    assert found.seen_nearby(all_).tolist() == [True, True, False]
    assert found.seen_nearby(all_, others=True).tolist() == [True, True, False]
    assert found.seen_nearby(~all_, others=True).tolist() == [False, False, True]
    assert found.seen_nearby(np.zeros(3, bool)).tolist() == [False] * 3
    ids[pixel[1], pixel[0]] = 0
    found = around(view(image(object_id=ids), [{"at": at, "object": ROPE}, {"at": at}]))
    assert found.seen_nearby(np.array([True, True])).tolist() == [False, True]
    assert found.seen_nearby(np.array([True, True]), others=True).tolist() == [True, False]


def test_a_rope_too_thin_to_be_seen_may_hide_anything_else() -> None:
    points: list[dict[str, Any]] = [
        {"at": AT, "depth": depth, "object": each} for depth in (5.9, 6.1) for each in (SHEET, ROPE)
    ]
    found = around(view(image(), points))
    assert found.seen_nearby(np.ones(4, bool), others=True).tolist() == [False, True, True, True]
    nowhere = around(view(EMPTY, points))
    assert nowhere.seen_nearby(np.ones(4, bool), others=True).tolist() == [
        False,
        False,
        True,
        False,
    ]


def bent(slope: float, along: Any, where: Any = 1) -> Surface:
    """Return a sheet with a fold under AT: second differences of twice its slope."""
    return image(depth_m=1 + slope * np.abs(along - (30.5 if along is U else 25.5)) * where)


def with_rope_at(u: int, v: int, *, of: Surface) -> Surface:
    """Return an image in which one pixel more is of the rope, 10 cm nearer than the sheet."""
    here = (u + 0.5 == U) & (v + 0.5 == V)
    return image(
        object_id=np.where(here, ROPE, of.object_id), depth_m=np.where(here, 0.9, of.depth_m),
        m0=np.where(here, 7, of.m0), m1=np.where(here, 0, of.m1),
    )  # fmt: skip


EDGE = image(
    object_id=SHEET * (U < 32),
    depth_m=np.where(U < 32, 1, np.inf),
    m0=U * (U < 32),
    m1=V * (U < 32),
)
"""The sheet ends two pixels to the right of AT."""

SELF: dict[str, Any] = {"state": SELF_OCCLUDED}
OTHER: dict[str, Any] = {"state": OCCLUDED}
FAR_ROPE: dict[str, Any] = {"object": ROPE, "material": (20, 0)}


@pytest.mark.parametrize(
    ("shown", "point", "wrong"),
    [
        # Nearer than all that its pixels show, by more than three footprints.
        (ON_ROPE, SELF | {"depth": 0.870}, True),
        (ON_ROPE, SELF | {"depth": 0.876}, False),
        (ON_ROPE, SELF | {"depth": 0.95}, True),  # behind another object than its own
        (ON_ROPE, OTHER | {"depth": 0.5}, False),
        (ON_ROPE, OTHER | FAR_ROPE | {"depth": 0.5}, True),
        (image(), OTHER | {"depth": 0.5}, True),
        (with_rope_at(46, 25, of=image()), OTHER | {"depth": 0.5}, False),
        (with_rope_at(47, 25, of=image()), OTHER | {"depth": 0.5}, True),
        (with_rope_at(30, 41, of=image()), SELF | FAR_ROPE | {"depth": 0.5}, False),
        (with_rope_at(30, 42, of=image()), SELF | FAR_ROPE | {"depth": 0.5}, True),
        # In front of the background: what hides it is nearby.
        (EMPTY, SELF, True),
        (EMPTY, OTHER, True),
        (with_rope_at(46, 25, of=EMPTY), OTHER, False),
        (with_rope_at(46, 25, of=EMPTY), SELF, True),
        (with_rope_at(46, 25, of=EMPTY), SELF | FAR_ROPE, False),
        (with_rope_at(46, 25, of=EMPTY), OTHER | FAR_ROPE, True),
        # A rope of 12 cm is thinner than two pixels from 6 m on.
        (image(), SELF | FAR_ROPE | {"depth": 5.9}, True),
        (image(), SELF | FAR_ROPE | {"depth": 6.1}, False),
        # Another object among the 5x5 pixels may hide it; beyond it does not lie behind its own.
        (with_rope_at(32, 27, of=image()), OTHER | {"depth": 1.06}, False),
        (with_rope_at(33, 27, of=image()), OTHER | {"depth": 1.06}, True),
        (with_rope_at(28, 23, of=image()), OTHER | {"depth": 1.06}, False),
        (EDGE, OTHER | {"depth": 1.06}, True),
        (with_rope_at(46, 25, of=EDGE), OTHER | {"depth": 1.06}, False),
        # What is seen is not hidden, unless it is in a fold of more than a footprint.
        (bent(0.00504, U), SELF | {"depth": 1.01}, True),
        (bent(0.00510, U), SELF | {"depth": 1.01}, False),
        (bent(0.00504, V), SELF | {"depth": 1.01}, True),
        (bent(0.00510, V), SELF | {"depth": 1.01}, False),
        (bent(0.00510, U, (V == 25.5)), SELF | {"depth": 1.01}, False),  # in its own row alone
        (bent(0.00510, V, (U == 30.5)), SELF | {"depth": 1.01}, False),
        (bent(0.00510, U, (V == 26.5)), SELF | {"depth": 1.01}, True),
        (bent(0.00510, V, (U == 31.5)), SELF | {"depth": 1.01}, True),
        (image(depth_m=1 + 0.5 * (U > 32)), SELF | {"depth": 1.01}, False),  # not smooth
        (image(depth_m=1 + 0.5 * (U > 33)), SELF | {"depth": 1.01}, True),
    ],
)
def test_what_hides_a_point(shown: Surface, point: dict[str, Any], wrong: bool) -> None:
    assert codes(shown, [{"at": AT} | point]) == ({"OCCLUDED_DISAGREES": 1} if wrong else {})


def checked(
    points: list[dict[str, Any]], good: list[bool] | None = None
) -> tuple[bool, list[tuple[str, str]]]:
    seen = view(image(), points)
    if good is not None:
        seen.good[:] = good
    findings = Findings()
    fits = check_visibility(seen, findings.at("table"))
    return fits, [(issue.code, issue.where) for issue in findings.issues]


def test_rows_that_do_not_project_are_left_out() -> None:
    deep = {"depth": 1.2}
    points = [{"at": (10.5 + 5 * k, 20.5)} | deep for k in range(3)]
    assert checked(points, [True, False, True])[1] == [
        ("VISIBLE_DISAGREES", "frame 3, point 0"), ("VISIBLE_DISAGREES", "frame 3, point 2"),
    ]  # fmt: skip
    assert checked(points, [False] * 3) == (True, [])


def test_points_are_looked_at_in_portions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every point of a frame in which all are too deep, whatever the size of a portion."""
    points = [{"at": (5.5 + 5 * (k % 10), 10.5 + 5 * (k // 10)), "depth": 1.2} for k in range(20)]
    expected = [("VISIBLE_DISAGREES", f"frame 3, point {k}") for k in range(20)]
    for size in (1, 7, 20, 100):
        monkeypatch.setattr(visibility, "_CHUNK", size)
        fits, found = checked(points)
        assert not fits
        assert found == expected


def test_points_at_any_border_and_far_outside() -> None:
    deep = {"depth": 1.2}
    for at, looked in (
        ((2.0, 20.5), True), ((1.9, 20.5), False), ((57.9, 20.5), True), ((58.0, 20.5), False),
        ((20.5, 2.0), True), ((20.5, 1.9), False), ((20.5, 47.9), True), ((20.5, 48.0), False),
        ((-1e30, 20.5), False), ((20.5, 1e30), False), ((-7.5, 20.5), False), ((9e5, 3), False),
    ):  # fmt: skip
        assert bool(checked([{"at": at} | deep])[1]) is looked, at


def test_a_strip_of_points_is_edge_on() -> None:
    """Two rows d apart are a strip of width d times the square root of 3."""
    strip = np.array([(k, 0.0) for k in range(9)] + [(k, 1.15) for k in range(9)])
    own = np.array([SHEET] * 18 + [ROPE] * 18, np.int32)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    wide = strip * [1, 1.16 / 1.15]
    assert _edge_on(own, np.concatenate([strip, wide]) @ turn) == [SHEET]
    assert _edge_on(own, np.concatenate([wide, strip]) @ turn) == [ROPE]
    assert _edge_on(own, np.concatenate([wide, wide])) == []
    assert CLOTH.kind == "cloth"
    assert codes(image(), [{"at": AT, "state": VISIBLE}]) == {}
