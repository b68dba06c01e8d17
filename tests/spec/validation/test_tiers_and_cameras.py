"""Tiers and cameras of a dataset: exactly these problems."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
import pytest

from pliant.spec.model import Tier
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.cameras import check_cameras
from pliant.spec.validation.rules.tiers import check_tiers
from tests.conformance.base import DIHEDRAL
from tests.dataset_files import coordinate, tier
from tests.spec.validation.world import DOCUMENT, TUBE, context, places

OPEN, CLOSED = coordinate("a", 0, 1, 2), coordinate("b", -2, 2, 0.5, 4)

Found = list[tuple[str, str]]
Change = Callable[[dict[str, Any]], Any]


def checked(*documents: dict[str, Any]) -> Findings:
    """Return the problems of a dataset of these tiers."""
    findings = Findings()
    check_tiers([Tier.from_document(each) for each in documents], findings.at("dataset.json"))
    return findings


def matrix(number: int, value: Any, offset: Any = None) -> Change:
    def change(document: dict[str, Any]) -> None:
        document["symmetries"][number].update(
            {"matrix": value} | ({} if offset is None else {"offset": offset})
        )

    return change


def material(which: int, **values: Any) -> Change:
    return lambda document: document["objects"][0]["material"][which].update(values)


ONE = [[1, 0], [0, 1]]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda d: None, []),
        (lambda d: d["objects"][1].update(id=1), [("TIER_INVALID", "tiers[1]")]),
        (lambda d: d.update(queried_object=3), [("TIER_INVALID", "tiers[1]")]),
        (lambda d: d.update(queried_object=2), [("SYMMETRY_INVALID", f"tiers[1].symmetries[{k}]")
                                                for k in range(3)]),
        (material(0, min=2), [("TIER_INVALID", "tiers[1]")]),
        (material(0, min=3), [("TIER_INVALID", "tiers[1]")]),
        (material(1, period=4 / (1 + 0.9e-6)), []),
        (material(1, period=4 / (1 + 1.1e-6)), [("TIER_INVALID", "tiers[1]")]),
        # Each of the three coordinates that are wrong, in both objects.
        (lambda d: [c.update(max=-9) for o in d["objects"] for c in o["material"][:2]],
         [("TIER_INVALID", "tiers[1]")] * 4),
        (lambda d: d["symmetries"][2].update(name="turn"),
         [("SYMMETRY_INVALID", "tiers[1].symmetries[2]")]),
        (matrix(1, ONE, [0, 0]), [("SYMMETRY_INVALID", "tiers[1].symmetries[1]")]),
        (matrix(2, ONE, [0, 2]), [("SYMMETRY_INVALID", "tiers[1].symmetries[2]")]),
        (matrix(2, ONE, [0, -2]), [("SYMMETRY_INVALID", "tiers[1].symmetries[2]")]),
        (lambda d: d["symmetries"].pop(), [("SYMMETRY_INVALID", f"tiers[1].symmetries[{k}]")
                                          for k in range(2)]),
        (lambda d: d["symmetries"].clear(), []),
        # A corner may be off by 1e-6 of the range along s.
        (matrix(1, [[-1, 0], [0, -1]], [2 + 1.9e-6, 0]), []),
        (matrix(1, [[-1, 0], [0, -1]], [2 + 2.1e-6, 0]),
         [("SYMMETRY_INVALID", "tiers[1].symmetries[1]")]),
        (matrix(1, [[-1, 0.9e-6], [0, -1]]), []),
        (matrix(1, [[-1, 1.1e-6], [0, -1]]), [("SYMMETRY_INVALID", "tiers[1].symmetries[1]")]),
        (matrix(1, [[-1, 0], [0, -1 - 0.9e-6]]), []),
        (matrix(1, [[-1, 0], [0, -1 - 1.1e-6]]), [("SYMMETRY_INVALID", "tiers[1].symmetries[1]")]),
        (matrix(1, [[-1, 0], [0, -3]]), [("SYMMETRY_INVALID", "tiers[1].symmetries[1]")]),
        (matrix(1, [[-1, 0], [0, 0]]), [("SYMMETRY_INVALID", "tiers[1].symmetries[1]")]),
    ],
)  # fmt: skip
def test_tiers(change: Change, expected: Found) -> None:
    document = deepcopy(DOCUMENT)
    change(document)
    findings = checked(DOCUMENT | {"name": "other"}, document)
    assert sorted(places(findings)) == sorted(expected)


def test_maps_are_the_same_to_a_hundred_thousandth_of_the_range() -> None:
    """A range of 2 along s, 4 around: a second turn may differ by 2e-5 or 4e-5."""
    for off, again in ((0.9, True), (1.1, False)):
        for matrix_, offset in (
            ([[1, 0], [0, 1]], [0, 2 + off * 4e-5]),
            ([[-1, 0], [0, 1]], [2, 2 + off * 4e-5]),
        ):
            maps = [("first", matrix_, [offset[0], 2]), ("second", matrix_, offset)]
            findings = checked(tier("t", "rope", {"tube": TUBE}, maps))
            twice = [i.where for i in findings.issues if "listed twice" in i.message]
            assert twice == (["tiers[0].symmetries[1]"] if again else [])


def test_two_closed_coordinates() -> None:
    """A torus of periods 4 and 2 may be turned twice round one way for once the other."""
    torus = [coordinate("a", 0, 4, 0.1, 4), coordinate("b", 0, 2, 0.1, 2)]
    for matrix_, good in (
        ([[1, 0], [0, -1]], True),
        ([[1, 2], [0, 1]], False),  # of infinite order, no group; still a bijection
        ([[0, 2], [0.5, 0]], True),
        ([[0, 1], [1, 0]], False),
        ([[2, 0], [0, 1]], False),
    ):
        findings = checked(tier("t", "rope", {"torus": torus}, [("map", matrix_, [0, 0])]))
        assert (findings.counts == {}) is good, matrix_
        bijection = [i for i in findings.issues if "bijection" in i.message]
        assert bool(bijection) is (matrix_ in ([[0, 1], [1, 0]], [[2, 0], [0, 1]]))


def test_names_of_tiers() -> None:
    findings = checked(*(DOCUMENT | {"name": name} for name in "babcb"))
    assert [(i.where, i.message[-3:]) for i in findings.issues] == [("tiers", "'b'")]


def symmetry_issues(material: list[dict[str, Any]], *maps: tuple[Any, Any]) -> int:
    symmetries = [(f"s{i}", *each) for i, each in enumerate(maps)]
    described = tier("t", "rope", {"x": material}, symmetries)
    findings = checked(described)
    assert set(findings.counts) <= {"SYMMETRY_INVALID"}
    return findings.total


REVERSE = ([[-1, 0], [0, -1]], [1, 0])
MIRROR = ([[1, 0], [0, -1]], [0, 0])
TURN_HALF = ([[1, 0], [0, 1]], [0, 2])


@pytest.mark.parametrize(
    "maps",
    [
        (),
        (REVERSE,),
        (MIRROR,),
        (TURN_HALF,),
        (([[1, 0], [0, -1]], [0, 0.7]),),  # a mirror in any axial plane
        (([[-1, 0], [0, 1]], [1, 0]),),
        (REVERSE, MIRROR, ([[-1, 0], [0, 1]], [1, 0])),
        (([[1, 0], [0, 1]], [0, 1]), TURN_HALF, ([[1, 0], [0, 1]], [0, 3])),
    ],
)
def test_symmetries_of_a_tube(maps: tuple[Any, ...]) -> None:
    assert symmetry_issues([OPEN, CLOSED], *maps) == 0


@pytest.mark.parametrize(
    "maps",
    [
        (([[1, 0], [0, 1]], [0, 4]),),  # the identity, once round
        (([[1, 0], [0, 1]], [0, 1]),),  # a quarter turn alone is not a group
        (([[-1, 0], [0, -1]], [0, 0]),),  # leaves the range of s
        (([[-2, 0], [0, 1]], [1, 0]),),
        (([[1, 0.5], [0, 1]], [0, 0]),),  # s would jump at the seam of theta
        (([[0, 1], [1, 0]], [0, 0]),),
    ],
)
def test_what_is_no_symmetry_of_a_tube(maps: tuple[Any, ...]) -> None:
    assert symmetry_issues([OPEN, CLOSED], *maps) > 0


def test_a_helix_may_shift_theta_along_s() -> None:
    screw = ([[-1, 0], [0.5, -1]], [1, -0.25])
    # Twice the map: s comes back; theta gains 0.5 (1 - s) - 0.25 + 0.25 - 0.5 s = 0.5 - s: no.
    assert symmetry_issues([OPEN, CLOSED], screw) > 0
    screw = ([[-1, 0], [0.5, 1]], [1, -0.25])
    # theta + 0.5 s - 0.25, then + 0.5 (1 - s) - 0.25: comes back.
    assert symmetry_issues([OPEN, CLOSED], screw) == 0


def test_the_square_has_eight_symmetries() -> None:
    maps = [(matrix, offset) for _, matrix, offset in DIHEDRAL]
    assert symmetry_issues([OPEN, OPEN], *maps) == 0
    assert symmetry_issues([OPEN, OPEN], *maps[:2]) > 0


def turned(angle: float) -> list[list[float]]:
    c, s = np.cos(angle), np.sin(angle)
    return [[c, -s, 0, 1], [s, c, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]


def put(frame: int, name: str, row: int, column: int, value: float) -> Change:
    return lambda document: document["frames"][frame][name][row].__setitem__(column, value)


K, POSE = "K", "world_to_camera"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda d: None, []),
        (lambda d: d.update(width=65), [("IDENTITY_DIFFERS", "width, height")]),
        (lambda d: d.update(height=49), [("IDENTITY_DIFFERS", "width, height")]),
        (lambda d: d["frames"].pop(), [("CAMERA_INVALID", "frames")]),
        (lambda d: d["frames"].reverse(), [("CAMERA_INVALID", "frames")]),
        (lambda d: d["frames"][0].update(frame=1), [("CAMERA_INVALID", "frames")]),
        *[
            (put(1, K, row, column, value), [("CAMERA_INVALID", "frames[1].K")])
            for row, column, value in (
                (0, 1, 1), (1, 0, 1), (2, 0, 1), (2, 1, 1), (2, 2, 2), (2, 2, 0), (0, 0, 0),
                (1, 1, 0), (0, 0, -1), (1, 1, -1),
            )
        ],
        (put(1, K, 0, 0, 1e-9), []),
        (put(1, K, 1, 1, 1e-9), []),
        (put(1, K, 0, 2, -5), []),
        *[
            (put(0, POSE, 3, column, 2), [("CAMERA_INVALID", "frames[0].world_to_camera")])
            for column in range(4)
        ],
        (put(0, POSE, 2, 2, -1), [("CAMERA_INVALID", "frames[0].world_to_camera")]),
        (put(0, POSE, 2, 2, 1 + 0.49e-6), []),
        (put(0, POSE, 2, 2, 1 + 0.51e-6), [("CAMERA_INVALID", "frames[0].world_to_camera")]),
        (put(0, POSE, 2, 2, 1 - 0.51e-6), [("CAMERA_INVALID", "frames[0].world_to_camera")]),
        (put(0, POSE, 2, 0, 1.1e-6), [("CAMERA_INVALID", "frames[0].world_to_camera")]),
        (put(0, POSE, 0, 0, 1e300), [("CAMERA_INVALID", "frames[0].world_to_camera")]),
        (put(0, POSE, 0, 3, 1e300), []),
    ],
)  # fmt: skip
def test_cameras(change: Change, expected: Found) -> None:
    document: dict[str, Any] = {
        "width": 64,
        "height": 48,
        "frames": [
            {"frame": k, K: [[80, 0, 30], [0, 90, 20], [0, 0, 1]], POSE: turned(0.3 + k)}
            for k in range(2)
        ],
    }
    change(document)
    findings = Findings()
    cameras = check_cameras(context(), document, 2, findings.at("x"))
    assert places(findings) == expected
    assert (cameras is None) is bool(expected)
    if cameras is not None:
        assert [each.size for each in cameras] == [(64, 48)] * 2
        for number, each in enumerate(cameras):
            np.testing.assert_array_equal(each.K, document["frames"][number][K])
            np.testing.assert_array_equal(each.world_to_camera, document["frames"][number][POSE])
