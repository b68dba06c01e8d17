"""Pixels around points: which are smooth, what is behind them, and what hides a point.

As in test_visibility.py: a sheet faces the camera at 1 m, a pixel is 1 cm.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from pliant.spec.conventions import OCCLUDED, SELF_OCCLUDED
from pliant.spec.io.exr import Surface
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules import visibility
from pliant.spec.validation.rules.visibility import check_visibility
from pliant.spec.validation.rules.windows import _is_behind, edge_on
from tests.spec.validation.test_visibility import (
    AT,
    CAMERA,
    CLOTH,
    ROPE,
    SHEET,
    U,
    V,
    codes,
    image,
)
from tests.spec.validation.world import Found, found, view

ON_ROPE = image(object_id=0 * U + ROPE, depth_m=0 * U + 0.9, m0=0 * U + 7, m1=0 * U)
EMPTY = image(object_id=0 * U, depth_m=0 * U + np.inf, m0=0 * U, m1=0 * U)


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


def bent(slope: float, along: Any, where: Any = 1, beside: float = 0) -> Surface:
    """Return a sheet with a fold under or beside AT: second differences of twice its slope."""
    fold = (30.5 if along is U else 25.5) + beside
    return image(depth_m=1 + slope * np.abs(along - fold) * where)


def rising(last: float, along: Any, near_m: float = 1) -> Surface:
    """Return a sheet that bends by 0.98 footprints a pixel, up to the last step of AT's 5x5."""
    x = along - (30.5 if along is U else 25.5)
    return image(depth_m=near_m * (1 + np.sign(last) * ((abs(last) - 0.0147) * x + 0.0049 * x**2)))


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
        (with_rope_at(46, 25, of=image()), OTHER | {"depth": 0.5}, False),
        (with_rope_at(47, 25, of=image()), OTHER | {"depth": 0.5}, True),
        (with_rope_at(13, 25, of=image()), OTHER | {"depth": 0.5}, True),
        (with_rope_at(30, 8, of=image()), OTHER | {"depth": 0.5}, True),
        (with_rope_at(30, 41, of=image()), SELF | FAR_ROPE | {"depth": 0.5}, False),
        (with_rope_at(30, 42, of=image()), SELF | FAR_ROPE | {"depth": 0.5}, True),
        # In front of the background: what hides it is nearby.
        (EMPTY, SELF, True),
        (EMPTY, OTHER, True),
        (with_rope_at(46, 25, of=EMPTY), OTHER, False),
        (with_rope_at(46, 25, of=EMPTY), SELF, True),
        # A rope of 12 cm is thinner than two pixels from 6 m on.
        (image(), SELF | FAR_ROPE | {"depth": 5.9}, True),
        (image(), SELF | FAR_ROPE | {"depth": 6.1}, False),
        (EMPTY, OTHER | {"depth": 6.1}, False),
        (EMPTY, OTHER | FAR_ROPE | {"depth": 6.1}, True),
        # Another object among the 5x5 pixels may hide it; beyond it does not lie behind its own.
        (with_rope_at(32, 27, of=image()), OTHER | {"depth": 1.06}, False),
        (with_rope_at(33, 27, of=image()), OTHER | {"depth": 1.06}, True),
        (with_rope_at(28, 23, of=image()), OTHER | {"depth": 1.06}, False),
        (EDGE, OTHER | {"depth": 1.06}, True),
        # What is seen is not hidden, unless it is in a fold of more than a footprint.
        (bent(0.00504, U), SELF | {"depth": 1.01}, True),
        (bent(0.00510, U), SELF | {"depth": 1.01}, False),
        (bent(0.00510, U, (V == 25.5)), SELF | {"depth": 1.01}, False),  # in its own row alone
        (bent(0.00510, V, (U == 30.5)), SELF | {"depth": 1.01}, False),
        *[
            (bent(0.00510, along, beside=by), SELF | {"depth": 1.01}, wrong)
            for along in (U, V)
            for by, wrong in ((1, False), (-1, False), (2, True), (-2, True))
        ],
        (bent(0.00510, U, (V == 26.5)), SELF | {"depth": 1.01}, True),
        (bent(0.00510, V, (U == 31.5)), SELF | {"depth": 1.01}, True),
        # Not where the 5x5 pixels have a step of more than three footprints of depth, ...
        *[
            (rising(last, along), SELF | {"depth": 1.01}, wrong)
            for along in (U, V)
            for last, wrong in ((0.0299, True), (0.0301, False), (-0.0299, True), (-0.0301, False))
        ],
        (image(depth_m=1 + 0.0301 * (U < 29)), SELF | {"depth": 1.01}, False),
        (image(depth_m=1 + 0.5 * ((U > 33) | (U < 28))), SELF | {"depth": 1.01}, True),
        # which are those of the surface that is shown, here twice as far away, ...
        (rising(0.0299, U, 2), SELF | {"depth": 2.01}, True),
        (rising(0.0301, U, 2), SELF | {"depth": 2.01}, False),
        # or another object, ...
        (image(object_id=SHEET * (U < 32)), SELF | {"depth": 1.01}, False),
        (image(object_id=SHEET * (U < 33)), SELF | {"depth": 1.01}, True),
        # or where their material bends by more than half a footprint.
        (image(m0=U + 0.49 * (U > 32)), SELF | {"depth": 1.01}, True),
        (image(m0=U + 0.51 * (U > 32)), SELF | {"depth": 1.01}, False),
        (image(m1=V + 0.51 * (V < 24)), SELF | {"depth": 1.01}, False),
        (image(m1=V + 0.51 * (U < 29)), SELF | {"depth": 1.01}, False),
        (image(m0=U + 0.51 * (U > 33)), SELF | {"depth": 1.01}, True),
        (image(m0=U + 0.3 * (U > 32), m1=V + 0.39 * (U > 32)), SELF | {"depth": 1.01}, True),
        (image(m0=U + 0.3 * (U > 32), m1=V + 0.41 * (U > 32)), SELF | {"depth": 1.01}, False),
    ],
)
def test_what_hides_a_point(shown: Surface, point: dict[str, Any], wrong: bool) -> None:
    found = codes(shown, [{"at": AT} | point])
    assert found == ({"OCCLUDED_DISAGREES": 1} if wrong else {})


def test_a_few_pixels_show_no_object_of_unknown_shape() -> None:
    """A cable far away may pass between pixel centres wherever it is."""
    for count, code in ((0, None), (15, None), (16, "OCCLUDED_DISAGREES")):
        rope = (V == 0.5) & (count > U)
        shown = image(object_id=SHEET * ~rope + ROPE * rope)
        points = [OTHER | {"at": (40.5, 30.5), "depth": 0.9}]
        assert set(codes(shown, points, known=False)) == ({code} if code else set())
        assert set(codes(shown, points)) == {"OCCLUDED_DISAGREES"}


def test_a_cable_may_be_thinner_than_a_pixel() -> None:
    """It hides points of a sheet between pixels that show the sheet, and is seen nearby."""
    on_sheet = [OTHER | {"at": AT, "depth": 1.001}]
    far = image(object_id=np.where(V < 1, ROPE, SHEET))  # enough pixels to be seen
    for u, wrong in ((46, set()), (47, {"OCCLUDED_DISAGREES"})):
        shown = with_rope_at(u, 25, of=far)
        assert set(codes(shown, on_sheet, known=False)) == wrong
        assert set(codes(shown, on_sheet)) == {"OCCLUDED_DISAGREES"}


@pytest.mark.parametrize(
    ("shown", "smooth"),
    [
        (image(m0=U + 1.99 * (U > 32)), True),
        (image(m0=U + 2.01 * (U > 32)), False),
        (image(m1=V + 2.01 * (V > 27)), False),
        (image(m0=U + 1.2 * (U > 32), m1=V + 2.02 * (U > 32)), True),
        (image(m0=U + 1.2 * (U > 32), m1=V + 2.06 * (U > 32)), False),
    ],
)
def test_a_step_of_material_of_three_footprints_is_not_smooth(shown: Surface, smooth: bool) -> None:
    """The two coordinates make one step."""
    found = codes(shown, [{"at": AT, "depth": 1.2}])
    assert found == ({"VISIBLE_DISAGREES": 1} if smooth else {})


def test_a_sheet_that_no_pixel_centre_meets() -> None:
    """Two rows of points d apart are a strip of width d sqrt(3); below 2 px it may be unseen."""
    for apart, points, code in (
        (1.1, 4, None), (1.2, 4, "VISIBLE_DISAGREES"), (1.1, 3, "VISIBLE_DISAGREES"),
    ):  # fmt: skip
        strip = [{"at": (20.5 + 3 * k, v)} for k in range(points) for v in (20.5, 20.5 + apart)]
        assert set(codes(EMPTY, strip)) == ({code} if code else set())
        hidden = [each | SELF for each in strip]
        assert set(codes(EMPTY, hidden)) == ({"OCCLUDED_DISAGREES"} if code else set())
        covered = [each | OTHER for each in strip]
        assert set(codes(EMPTY, covered)) == {"OCCLUDED_DISAGREES"}


@pytest.mark.parametrize(
    ("at", "pixel"),
    [
        ((5.5, 6.5), (0, 6)),
        ((5.5, 6.5), (5, 0)),
        ((54.5, 45.5), (59, 45)),
        ((54.5, 45.5), (54, 49)),
        ((54.5, 45.5), (38, 29)),
    ],
)
def test_a_part_is_looked_for_up_to_the_border(
    at: tuple[float, float], pixel: tuple[int, int]
) -> None:
    """Within 16 pixels, up to the first and the last row and column."""
    point = OTHER | {"at": at, "depth": 0.9}
    assert codes(image(), [point]) == {"OCCLUDED_DISAGREES": 1}
    assert codes(with_rope_at(*pixel, of=image()), [point]) == {}


def checked(points: list[dict[str, Any]]) -> tuple[bool, Found]:
    findings = Findings()
    fits = check_visibility(view(CLOTH, CAMERA, image(), points), findings.at("table"))
    return fits, found(findings)


def test_rows_that_do_not_project_are_left_out() -> None:
    points = [{"at": (10.5 + 5 * k, 20.5), "depth": 1.2, "good": k != 1} for k in range(3)]
    wrong = [("VISIBLE_DISAGREES", "table", f"frame 3, point {k}") for k in (2, 0)]
    assert checked(points)[1] == wrong
    assert checked([each | {"good": False} for each in points]) == (True, [])


def test_points_are_looked_at_in_portions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every point of a frame in which all are too deep, whatever the size of a portion."""
    points = [{"at": (5.5 + 5 * (k % 10), 10.5 + 5 * (k // 10)), "depth": 1.2} for k in range(19)]
    wrong = [("VISIBLE_DISAGREES", "table", f"frame 3, point {k}") for k in range(19)][::-1]
    for size in (1, 7, 20, 100):
        monkeypatch.setattr(visibility, "_CHUNK", size)
        assert checked(points) == (False, [*wrong, ("VISIBLE_DISAGREES", "table", "frame 3")])


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
    assert edge_on(own, np.concatenate([strip, wide]) @ turn) == [SHEET]
    assert edge_on(own, np.concatenate([wide, strip]) @ turn) == [ROPE]
    assert edge_on(own, np.concatenate([wide, wide])) == []
