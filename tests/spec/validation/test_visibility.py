"""States of points against a surface image that is made by hand.

A sheet faces the camera at 1 m, 100 px focal length: a pixel is 1 cm, and shows material (u, v) of
its centre in pixels, of which one is 1 cm as well. A rope of 12 cm diameter may cover a part of it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pliant.spec.camera import Camera
from pliant.spec.conventions import OCCLUDED, OUT_OF_FRAME, SELF_OCCLUDED
from pliant.spec.io.exr import Surface
from pliant.spec.model import Tier
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.visibility import _on_slope, check_visibility
from tests.dataset_files import coordinate, tier
from tests.spec.validation.world import view

WIDTH, HEIGHT = 60, 50
SHEET, ROPE = 1, 2
_SHEET = [coordinate("u", 0, 60, 0.01), coordinate("v", 0, 60, 0.01)]
_ROPE = [coordinate("s", 0, 60, 0.01), coordinate("theta", -np.pi, np.pi, 0.06, 2 * np.pi)]
CLOTH = Tier.from_document(tier("t", "cloth", {"sheet": _SHEET, "rope": _ROPE}))
NO_CLOTH = Tier.from_document(tier("t", "rope", {"sheet": _SHEET, "rope": _ROPE}))
U, V = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)


def image(**changes: Any) -> Surface:
    """Return what the sheet alone shows, with changed channels."""
    channels = {"depth_m": 0 * U + 1, "m0": U, "m1": V} | changes
    object_id = np.asarray(channels.pop("object_id", 0 * U + SHEET), np.uint32)
    depth_m, m0, m1 = (np.asarray(channels[name], np.float32) for name in ("depth_m", "m0", "m1"))
    return Surface(depth_m, m0, m1, object_id)


CAMERA = Camera(np.array([[100.0, 0, 30], [0, 100, 25], [0, 0, 1]]), np.eye(4), (WIDTH, HEIGHT))


KNOWN: list[dict[str, Any]] = [
    {"at": (-9.5, -9.5), "state": OUT_OF_FRAME, "object": each} for each in (SHEET, ROPE)
]
"""An object with a point has a known shape."""


def codes(
    shown: Surface, points: list[dict[str, Any]], of: Tier = CLOTH, *, known: bool = True
) -> dict[str, int]:
    findings = Findings()
    points = [*points, *KNOWN] if known else points
    check_visibility(view(of, CAMERA, shown, points), findings.at("table"))
    return findings.counts


def test_points_where_the_image_shows_them() -> None:
    places = [(u, v) for u in (2.0, 20.3, 41.75, 57.9) for v in (2.0, 17.6, 30.25, 47.9)]
    assert codes(image(), [{"at": at} for at in places]) == {}


AT = (30.5, 25.5)  # the centre of a pixel


@pytest.mark.parametrize(
    ("point", "code"),
    [
        ({"depth": 1.0309}, None),  # behind by less than 3 footprints of its own depth
        ({"depth": 1.0310}, "VISIBLE_DISAGREES"),
        ({"depth": 0.9709}, None),
        ({"material": (34.4, 25.5)}, None),  # 2.9 px of material from the pixel to the right
        ({"material": (34.6, 25.5)}, "MATERIAL_DISAGREES"),
        ({"material": (30.5, 21.4)}, "MATERIAL_DISAGREES"),
        ({"object": ROPE, "material": (0, 0)}, "VISIBLE_DISAGREES"),
        # A rope of 12 cm is thinner than two pixels from 6 m on, and not judged.
        ({"object": ROPE, "material": (7, 0), "depth": 5.9}, "VISIBLE_DISAGREES"),
        ({"object": ROPE, "material": (7, 0), "depth": 6.1}, None),
        ({"depth": 1.032, "state": OUT_OF_FRAME}, None),
        ({"state": SELF_OCCLUDED, "depth": 1.06}, None),
        ({"state": SELF_OCCLUDED, "depth": 1.01, "material": (33.1, 25.5)}, None),
        ({"state": SELF_OCCLUDED, "depth": 1.01, "material": (32.9, 25.5)}, "OCCLUDED_DISAGREES"),
        ({"state": SELF_OCCLUDED, "depth": 1.014}, "OCCLUDED_DISAGREES"),
        ({"state": SELF_OCCLUDED, "depth": 1.016}, None),
        ({"state": OCCLUDED, "depth": 1.06}, "OCCLUDED_DISAGREES"),  # by nothing else
    ],
)
def test_one_point_of_a_sheet(point: dict[str, Any], code: str | None) -> None:
    assert codes(image(), [{"at": AT} | point]) == ({code: 1} if code else {})


def test_what_is_seen_is_not_hidden_on_a_cloth_alone() -> None:
    point = {"at": AT, "state": SELF_OCCLUDED, "depth": 1.01}
    assert codes(image(), [point]) == {"OCCLUDED_DISAGREES": 1}
    assert codes(image(), [point], NO_CLOTH) == {}


def covered(nearest: float) -> Surface:
    """Return the sheet with a rope before it that begins some pixels to the right of AT."""
    on = 30 + nearest <= U - 0.5
    return image(
        object_id=np.where(on, ROPE, SHEET), depth_m=np.where(on, 0.9, 1),
        m0=np.where(on, 7, U), m1=np.where(on, 0, V),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("nearest", "point", "code"),
    [
        (16, {"state": OCCLUDED, "depth": 1.06}, "OCCLUDED_DISAGREES"),  # its own sheet covers it
        # In front of what its pixels show, which may be a part that no pixel shows.
        (16, {"object": ROPE, "depth": 0.95, "material": (7, 0)}, None),
        (17, {"object": ROPE, "depth": 0.95, "material": (7, 0)}, "VISIBLE_DISAGREES"),
        (16, {"object": ROPE, "depth": 1.05, "material": (7, 0)}, "VISIBLE_DISAGREES"),
        (-9, {"state": OCCLUDED}, None),
        (-9, {"state": SELF_OCCLUDED}, "OCCLUDED_DISAGREES"),  # the rope covers it
        (-9, {"state": SELF_OCCLUDED, "depth": 0.88}, None),  # in front: by a part not shown
        (-9, {"state": OCCLUDED, "object": ROPE, "material": (20, 0)}, "OCCLUDED_DISAGREES"),
        (-9, {"state": SELF_OCCLUDED, "object": ROPE, "material": (20, 0)}, None),
        # 20 cm in front of all that could hide it.
        (-50, {"state": OCCLUDED, "depth": 0.7}, None),
        (-9, {"object": ROPE, "depth": 0.9, "material": (7.2, 0.1)}, None),
        (-9, {"object": ROPE, "depth": 0.9, "material": (10.1, 0)}, "MATERIAL_DISAGREES"),
        # Round the rope the way back is shorter.
        (-9, {"object": ROPE, "depth": 0.9, "material": (7, 2 * np.pi - 0.4)}, None),
        (-9, {"object": ROPE, "depth": 0.9, "material": (7, np.pi)}, "MATERIAL_DISAGREES"),
        # A point of the centre line is up to 1.25 diameters below the surface, and along it.
        (-9, {"object": ROPE, "depth": 1.07, "material": (7, 0), "line": True}, None),
        (
            -9,
            {"object": ROPE, "depth": 1.09, "material": (7, 0), "line": True},
            "VISIBLE_DISAGREES",
        ),
        (-9, {"object": ROPE, "depth": 1.07, "material": (7, 0)}, "VISIBLE_DISAGREES"),
        (-9, {"object": ROPE, "depth": 0.96, "material": (24, 1), "line": True}, None),
        (
            -9,
            {"object": ROPE, "depth": 0.96, "material": (26, 1), "line": True},
            "MATERIAL_DISAGREES",
        ),
    ],
)
def test_one_point_near_a_rope(nearest: float, point: dict[str, Any], code: str | None) -> None:
    assert codes(covered(nearest), [{"at": AT} | point]) == ({code: 1} if code else {})


@pytest.mark.parametrize(("depth", "found"), [(0.9999, True), (0.9997, False)])
def test_a_tilted_surface_is_interpolated_between_pixel_centres(depth: float, found: bool) -> None:
    """At (30.9, 25.2) the plane is at 1 + 0.4 * 0.004 - 0.3 * 0.006 = 0.9998 m."""
    shown = covered(16)
    plane = np.where(shown.object_id == SHEET, 1 + 0.004 * (U - 30.5) + 0.006 * (V - 25.5), 0.9)
    shown = image(object_id=shown.object_id, m0=shown.m0, m1=shown.m1, depth_m=plane)
    point = {"at": (30.9, 25.2), "depth": depth, "state": OCCLUDED}
    assert codes(shown, [point], NO_CLOTH) == ({"OCCLUDED_DISAGREES": 1} if found else {})


ROUGH = image(depth_m=1 + 0.04 * ((U + V) % 2))  # nowhere smooth: only many points tell


def half(missed: list[dict[str, Any]], right: int, apart: float = 5.0) -> dict[str, int]:
    """Return the codes of missed and right points, in two rows some pixels apart."""
    points: list[dict[str, Any]] = [*missed, *({} for _ in range(right))]
    places = [(5.5 + 4 * (k // 2), 20.5 + apart * (k % 2)) for k in range(len(points))]
    return codes(ROUGH, [{"at": at} | each for at, each in zip(places, points, strict=True)])


DEEP: dict[str, Any] = {"depth": 1.2}
ELSEWHERE: dict[str, Any] = {"material": (59, 49)}


def test_half_of_the_points_may_miss_where_nothing_is_smooth() -> None:
    assert half([DEEP] * 5, 5) == {}
    assert half([DEEP] * 6, 5) == {"VISIBLE_DISAGREES": 1}
    assert half([ELSEWHERE] * 6, 5) == {"MATERIAL_DISAGREES": 1}
    assert half([*[ELSEWHERE] * 3, *[DEEP] * 3], 5) == {"MATERIAL_DISAGREES": 1}
    assert half([*[ELSEWHERE] * 3, *[DEEP] * 4], 5) == {"VISIBLE_DISAGREES": 1}
    assert half([DEEP] * 8, 0) == {"VISIBLE_DISAGREES": 1}
    assert half([DEEP] * 7, 0) == {}  # too few points to tell


def test_an_object_seen_edge_on_is_not_counted() -> None:
    """Two rows of points d apart are a strip of width d sqrt(3); below 2 px it is not counted."""
    assert half([DEEP] * 10, 0, apart=1.1) == {}
    assert half([DEEP] * 10, 0, apart=1.2) == {"VISIBLE_DISAGREES": 1}
    lower = V > 30
    shown = image(
        depth_m=ROUGH.depth_m, object_id=np.where(lower, ROPE, SHEET),
        m0=np.where(lower, 7, U), m1=np.where(lower, 0, V),
    )  # fmt: skip
    missed = [{"at": (5.5 + 5 * k, 20.5)} | DEEP for k in range(9)]
    rope = [
        {"at": (5.5 + 5 * k, 34.5 + 5 * (k % 2)), "object": ROPE, "material": (7, 0)}
        for k in range(9)
    ]
    assert codes(shown, [*missed, *rope]) == {}
    apart = [each | {"at": (each["at"][0], 15.5 + 5 * (k % 2))} for k, each in enumerate(missed)]
    assert codes(shown, [*apart, *rope]) == {}  # 9 of 18
    assert codes(shown, [*apart, *rope[:-1]]) == {"VISIBLE_DISAGREES": 1}


@pytest.mark.parametrize(
    ("lower", "away", "found"),
    [
        ((1.0, 4.0), (1.0, 2.0), True),  # 3 m between the pixels, 1 m on the material
        ((4.4, 7.4), (1.0, 2.0), True),
        ((4.6, 7.6), (1.0, 2.0), False),
        ((-6.2, -3.2), (1.0, 2.0), True),
        ((-6.4, -3.4), (1.0, 2.0), False),
        ((1.0, 4.0), (2.4, 3.4), True),
        ((1.0, 4.0), (2.6, 3.6), False),
    ],
)
def test_a_point_no_farther_from_pixels_than_they_are_from_each_other(
    lower: tuple[float, float], away: tuple[float, float], found: bool
) -> None:
    """It may be 0.25 m in front in any case, 1.5 m behind or away."""
    same = np.zeros((1, 3, 3), bool)
    same[0, 0, 1] = same[0, 2, 0] = True
    behind, beside = np.zeros((1, 3, 3)), np.zeros((1, 3, 3))
    behind[same], beside[same] = lower, away
    limits = np.array([0.25]), np.array([1.5])
    assert _on_slope(same, behind, beside, *limits).tolist() == [found]
    assert not _on_slope(np.zeros_like(same), behind, beside, *limits).any()
