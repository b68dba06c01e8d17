"""Surface images: the box of an object, and pixels that no object has."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pliant.spec.io.exr import Surface
from pliant.spec.model import Tier
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.surfaces import ShownSurface, _check_values
from tests.conformance.base import TIERS
from tests.dataset_files import coordinate, tier
from tests.spec.validation.world import shown

ROPE_TIER = Tier.from_document(TIERS["rope"])


def box(*pixels: tuple[int, int]) -> float:
    object_id = np.zeros((10, 20), np.uint32)
    for row, column in pixels:
        object_id[row, column] = 1
    object_id[5, 19] = 2
    return shown(object_id).box_px(1)


def test_the_longer_side_of_the_box() -> None:
    assert box() == 1
    assert box((3, 4)) == 1
    assert box((3, 4), (3, 9)) == 6
    assert box((1, 4), (8, 9)) == 8
    assert box((9, 0), (0, 2), (4, 17)) == 18


@pytest.mark.parametrize(
    ("changes", "problems"),
    [
        ({}, {}),
        ({"m0": {(0, 0): 1.00001}}, {}),
        ({"m0": {(0, 0): 1.00002}}, {"SURFACE_INVALID": "row 0, column 0"}),
        ({"m1": {(0, 1): 1.00002}}, {}),  # of the rope it may be up to pi
        ({"m1": {(1, 1): 1.0001}}, {"SURFACE_INVALID": "row 1, column 1"}),
        ({"m1": {(1, 1): -1.0001}}, {"SURFACE_INVALID": "row 1, column 1"}),
        ({"m0": {(2, 0): 1e-30}}, {"SURFACE_INVALID": "row 2, column 0"}),
        ({"m1": {(2, 3): -1e-30}}, {"SURFACE_INVALID": "row 2, column 3"}),
        ({"object_id": {(1, 2): 3}}, {"SURFACE_INVALID": "row 1, column 2"}),
        ({"depth_m": {(2, 1): -1.0}}, {"DEPTH_INVALID": "row 2, column 1"}),
        ({"depth_m": {(0, 1): np.nan, (1, 3): 0.0}}, {"DEPTH_INVALID": "row 0, column 1"}),
        ({"object_id": {(2, 2): 1}}, {"DEPTH_INVALID": "row 2, column 2"}),
        ({"depth_m": {(0, 2): 1e-9}}, {}),
        ({"depth_m": {(2, 0): -np.inf}}, {"DEPTH_INVALID": "row 2, column 0"}),
        ({"m1": {(0, 3): np.nan}}, {"SURFACE_INVALID": "row 0, column 3"}),
        ({"m0": {(2, 1): -0.0}}, {}),
        ({"object_id": {(0, 0): 0}, "m0": {(0, 0): 0}, "m1": {(0, 0): 0}},
         {"DEPTH_INVALID": "row 0, column 0"}),
        ({"object_id": dict.fromkeys([(0, k) for k in range(4)] + [(1, k) for k in range(4)], 9)},
         {"SURFACE_INVALID": "row 0, column 0"}),
    ],
)  # fmt: skip
def test_pixels_of_two_objects(
    changes: dict[str, dict[tuple[int, int], float]], problems: dict[str, str]
) -> None:
    """A row of the rope, one of the ball, one of the background."""
    on = np.array([[1] * 4, [2] * 4, [0] * 4])
    channels: dict[str, Any] = {
        "depth_m": np.where(on > 0, 1, np.inf).astype(np.float32),
        "m0": np.where(on > 0, 0.5, 0).astype(np.float32),
        "m1": np.where(on > 0, 0.5, 0).astype(np.float32),
        "object_id": on.astype(np.uint32),
    }
    for name, values in changes.items():
        for at, value in values.items():
            channels[name][at] = value
    findings = Findings()
    _check_values(ShownSurface(Surface(**channels)), ROPE_TIER, findings.at("depth"))
    assert {issue.code: issue.where for issue in findings.issues} == problems
    assert findings.total == len(problems)


def test_pixels_of_one_object_whose_range_does_not_contain_0() -> None:
    """The zeros of the background are not its material."""
    material = [coordinate("u", 1, 2, 0.1), coordinate("v", 1, 2, 0.1)]
    described = Tier.from_document(tier("t", "cloth", {"sheet": material}))
    second = np.array([[0, 1], [0, 0]])
    for ids in (np.ones((2, 2)), np.array([[1, 1], [0, 0]]), np.zeros((2, 2))):
        seen = ids > 0
        m = np.where(seen, 1.5, 0).astype(np.float32)
        depth = np.where(seen, 1, np.inf).astype(np.float32)
        for value, wrong in ((1.5, False), (0.9, True), (2.1, True)):
            changed = np.where(seen & (second == 1), value, m).astype(np.float32)
            for m0, m1 in ((changed, m), (m, changed)):
                findings = Findings()
                surface = Surface(depth, m0, m1, ids.astype(np.uint32))
                _check_values(ShownSurface(surface), described, findings.at("depth"))
                expected = {"SURFACE_INVALID": 1} if wrong and seen.any() else {}
                assert findings.counts == expected
