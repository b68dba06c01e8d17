"""What the measured points of a sequence say together: every limit, just inside and outside.

Points without any spread of their own have a median without doubt, so that a limit is exact.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.spec.arrays import FloatArray
from pliant.spec.model import Tier
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.agreement import check_agreement
from pliant.spec.validation.rules.alignment import Alignment, Measured
from tests.conformance.base import TIERS

CLOTH = Tier.from_document(TIERS["cloth-1"])


class Fixed(Alignment):
    """Points already measured."""

    def __init__(self, *parts: Measured) -> None:
        super().__init__()
        self.parts = list(parts)

    def frames(self) -> list[Measured]:
        return self.parts


def points(count: int = 12, frame: int = 0, **changes: Any) -> Measured:
    """Points of one kind, all without an error, at depths from 1 m to 4 m."""
    depth = np.linspace(1, 4, count)
    values: dict[str, Any] = {
        "frame": frame, "offset_px": 0.0, "error_px": 0.0, "depth_m": depth,
        "shown_m": depth, "ray": 1.1, "footprint_m": depth / 100, "bend_px": 0.0, "noise_px": 0.0,
        "bend_depth": 0.0, "noise_depth": 0.0, "metres": 0.5,
    }  # fmt: skip
    shapes = dict.fromkeys(("offset_px", "metres"), (count, 2))
    return Measured(
        **{
            name: np.broadcast_to(value, shapes.get(name, count))
            for name, value in (values | changes).items()
        }
    )


def issues(*fitting: Measured, others: tuple[Measured, ...] = ()) -> list[tuple[str, str, str]]:
    """Return (code, where, message) of every issue."""
    findings = Findings()
    deep = check_agreement(CLOTH, Fixed(*fitting), Fixed(*others), findings.at("table"))
    assert deep is ("DEPTH_IMAGE_DISAGREES" in findings.counts)
    return [(issue.code, issue.where, issue.message) for issue in findings.listed()]


def found(*fitting: Measured, **others: Any) -> set[str]:
    return {code for code, _, _ in issues(*fitting, **others)}


ALTERNATING = np.tile([1.0, -1.0], 6)


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"offset_px": (0.0999, -0.0999)}, None),
        ({"offset_px": (0.1001, 0)}, "OFFSET_DISAGREES"),
        ({"offset_px": (0, -0.1001)}, "OFFSET_DISAGREES"),
        ({"noise_px": 0.0999}, None),
        ({"noise_px": 0.1001}, "SURFACE_NOISY"),
        # Two standard errors of the median, 1.2533 * 1.4826 * 0.05 / sqrt(12) each, are added.
        ({"noise_px": 0.1535 + 0.05 * ALTERNATING}, None),
        ({"noise_px": 0.1537 + 0.05 * ALTERNATING}, "SURFACE_NOISY"),
        ({"noise_px": 0.1399, "bend_px": 0.02}, None),
        ({"noise_px": 0.1401, "bend_px": 0.02}, "SURFACE_NOISY"),
        ({"noise_depth": 0.0999}, None),
        ({"noise_depth": 0.1001}, "DEPTH_IMAGE_SCATTERS"),
        ({"noise_depth": 0.1799, "bend_depth": 0.02}, None),
        ({"noise_depth": 0.1801, "bend_depth": 0.02}, "DEPTH_IMAGE_SCATTERS"),
        ({"noise_depth": 0.1299, "error_px": 0.02}, None),
        ({"noise_depth": 0.1301, "error_px": 0.02}, "DEPTH_IMAGE_SCATTERS"),
        ({"metres": (1.499, 0.5 / 2.999)}, None),
        ({"metres": (1.501, 0.5)}, "SCALE_DISAGREES"),
        ({"metres": (0.5, 0.5 / 3.001)}, "SCALE_DISAGREES"),
        ({"metres": (50, 50), "error_px": 0.499}, "SCALE_DISAGREES"),
        ({"metres": (50, 50), "error_px": 0.501}, None),
    ],
)
def test_limits(changes: dict[str, Any], code: str | None) -> None:
    assert found(points(**changes)) == ({code} if code else set())


@pytest.mark.parametrize(
    ("size", "error", "wrong"),
    [(0.0999, 0.0, False), (0.1001, 0.0, True), (0.1299, 0.03, False), (0.1301, 0.03, True)],
)
def test_scatter_of_the_positions(size: float, error: float, wrong: bool) -> None:
    """Half of the points are this far from the median along u, v or both; it explains all else."""
    for u, v in ((1, 0), (0, 1), (1, 1)):
        offset = size * np.stack([u * ALTERNATING, v * ALTERNATING], axis=1)
        part = points(offset_px=offset, error_px=error, noise_px=9.0)
        assert found(part) == ({"OFFSET_SCATTERS"} if wrong else {"SURFACE_NOISY"})


@pytest.mark.parametrize(
    ("footprints", "error", "code"),
    [
        (0.1499, 0.0, None),
        (0.1501, 0.0, "DEPTH_IMAGE_DISAGREES"),
        (-0.1501, 0.0, "DEPTH_IMAGE_DISAGREES"),
        (0.3699, 0.1, None),
        (0.3701, 0.1, "DEPTH_IMAGE_DISAGREES"),
    ],
)
def test_depth_that_differs(footprints: float, error: float, code: str | None) -> None:
    part = points()
    shown = part.depth_m + footprints * part.footprint_m
    assert found(replace(part, shown_m=shown, error_px=part.error_px + error)) == (
        {code} if code else set()
    )


@pytest.mark.parametrize(
    ("size", "error", "bend", "wrong"),
    [
        (0.0499, 0.0, 0.0, False),
        (0.0501, 0.0, 0.0, True),
        (0.1249, 0.1, 0.0, False),
        (0.1251, 0.1, 0.0, True),
        (0.0649, 0.0, 0.03, False),
        (0.0651, 0.0, 0.03, True),
    ],
)
def test_depth_that_scatters(size: float, error: float, bend: float, wrong: bool) -> None:
    """Twice the median distance from the median of 0.1, in footprints."""
    part = points(error_px=error, bend_depth=bend)
    shown = part.depth_m + (0.1 + size * ALTERNATING) * part.footprint_m
    said = issues(replace(part, shown_m=shown))
    assert [code for code, _, _ in said] == ["DEPTH_IMAGE_SCATTERS"] * wrong
    if wrong:
        residual = shown - part.depth_m
        middle = np.median(np.abs(residual - np.median(residual)))
        assert f"differ from depth_m by {1e3 * middle:.2f} mm (median)" in said[0][2]


def test_few_points_say_nothing() -> None:
    noisy: dict[str, Any] = {"noise_px": 9.0, "noise_depth": 9.0}
    assert found(points(11, offset_px=2.0, **noisy)) == set()
    assert found(points(6, offset_px=2.0), points(5, offset_px=2.0)) == set()
    assert found(points(6, offset_px=2.0), points(6, offset_px=2.0)) == {"OFFSET_DISAGREES"}
    assert found(points(12, **noisy)) == {"SURFACE_NOISY", "DEPTH_IMAGE_SCATTERS"}
    metres = np.full((14, 2), 50.0)
    metres[:2, 0] = np.nan
    assert found(points(14, metres=metres)) == {"SCALE_DISAGREES"}
    metres[2, 1] = np.inf
    assert found(points(14, metres=metres)) == set()
    assert found() == set()


@pytest.mark.parametrize(
    ("count", "offset", "counts"),
    [(12, 0.49, True), (12, -0.49, True), (12, 0.51, False), (11, 0.0, False)],
)
def test_a_frame_that_does_not_fit_may_still_be_in_place(
    count: int, offset: float, counts: bool
) -> None:
    """Its points are measured with the others if half of them are less than half a pixel away."""
    other = points(count, frame=1, offset_px=offset, noise_px=9.0)
    assert found(points(1), others=(other,)) == ({"SURFACE_NOISY"} if counts else set())
    assert found(others=(other,)) == ({"SURFACE_NOISY"} if counts else set())


def test_frames_that_are_shifted_are_named() -> None:
    right = [points(frame=frame) for frame in range(8, 24)]
    shifted = [points(frame=frame, offset_px=(0.5, 0.3), noise_px=9.0) for frame in (4, 6, 7)]
    few = points(11, frame=5, offset_px=(3.0, 3.0))
    ((code, where, message),) = issues(*right, few, *shifted)
    assert (code, where) == ("OFFSET_DISAGREES", "frames 4, 6, 7")
    assert message.startswith("u_px, v_px differ by about (-0.5, -0.3) px from")
    many = [points(frame=frame, offset_px=0.5) for frame in range(30, 37)]
    ((_, where, _),) = issues(*right, *many)
    assert where == "frames 30, 31, 32, 33, 34 and 2 more"
    ((_, where, _),) = issues(*right, *many[:5])
    assert where == "frames 30, 31, 32, 33, 34"


def test_a_frame_is_shifted_beyond_its_doubt() -> None:
    """Five standard errors of its median are added to the limit."""
    spread = np.stack([0.1 * ALTERNATING, 0 * ALTERNATING], axis=1)
    doubt = 5 * 1.2533 * 1.4826 * 0.1 / np.sqrt(12)
    right = [points(frame=frame) for frame in range(1, 20)]
    for shift, wrong in ((0.1 + doubt - 1e-4, False), (0.1 + doubt + 1e-4, True)):
        part = points(offset_px=spread + np.array([shift, 0]))
        assert found(part, *right) == ({"OFFSET_DISAGREES"} if wrong else set())
        assert found(part) == ({"OFFSET_DISAGREES"} if wrong else set())


OPENCV = "pixel centres at whole numbers in one of them (OpenCV convention)?"
WHOLE = "the depth images are shifted by whole pixels?"
OTHER = "the images are shifted, or of another camera?"


@pytest.mark.parametrize(
    ("offset", "says"),
    [
        ((0.5, 0.5), OPENCV),
        ((-0.5, 0), OPENCV),
        ((0.6, 0), OTHER),
        ((1, 0), WHOLE),
        ((-2.04, 2.96), WHOLE),
        ((1, 0.2), OTHER),
    ],
)
def test_the_cause_of_a_shift(offset: tuple[float, float], says: str) -> None:
    ((_, _, message),) = issues(points(offset_px=offset))
    assert message.endswith(says)


def differing(shown: FloatArray) -> str:
    """Return what is said about depth images that show other depths, at four points of each."""
    columns = {"depth_m": D, "shown_m": shown, "ray": RAY, "footprint_m": D / 100}
    many: dict[str, Any] = {name: np.tile(value, 4) for name, value in columns.items()}
    ((_, _, message),) = issues(points(48, **many))
    return message


D = points().depth_m
RAY = np.linspace(1.2, 1.3, 12)[[3, 7, 0, 10, 5, 8, 1, 11, 4, 9, 2, 6]]
THEY = "the depth images hold other depths than the tables: "


@pytest.mark.parametrize(
    ("shown", "says"),
    [
        (951 * D, "the depth images are 1000 times depth_m: millimetres?"),
        (949 * D, f"{THEY}they are about 949 times depth_m"),
        (104.9 * D, "the depth images are 100 times depth_m: centimetres?"),
        (105.1 * D, f"{THEY}they are about 105 times depth_m"),
        (1.04e-3 * D, "the depth images are 0.001 times depth_m: kilometres?"),
        (D * RAY, "the depth images have the length of the ray; required: planar z"),
        # Half of the points are 0.29 or 0.31 of their error away from the ray's length.
        (D * RAY * (1 + 0.45 * (RAY - 1)), "the depth images have the length of the ray; "),
        (D * RAY * (1 + 0.51 * (RAY - 1)), f"{THEY}they are about 1.4"),
        # Of a shift of 0.1 m half is 1.9 cm or 2.1 cm off.
        (D - 0.1 + 0.019 * ALTERNATING, f"{THEY}they differ by about -100.0 mm"),
        (D + 0.1 + 0.021 * ALTERNATING, f"{THEY}of another frame or another camera?"),
        (D * (1.5 + 0.099 * ALTERNATING), f"{THEY}they are about 1.5 times depth_m"),
        (D * (1.5 + 0.101 * ALTERNATING), f"{THEY}of another frame or another camera?"),
    ],
)
def test_what_other_depths_are(shown: FloatArray, says: str) -> None:
    assert differing(shown).startswith(says)


def test_depths_that_are_alike_fit_a_shift_and_a_factor() -> None:
    """From 1 to 1.1 m, 0.2 m more and 1.19 times as much differ by a tenth of the difference."""
    near = np.linspace(1, 1.1, 12)
    for shown, says in ((near + 0.2, "differ by about +200.0 mm"), (1.19 * near, "are about 1.19")):
        ((_, _, message),) = issues(points(depth_m=near, shown_m=shown))
        assert f"{THEY}they {says}" in message


def test_a_wrong_scale_is_named_with_its_power_of_ten() -> None:
    ((_, where, message),) = issues(points(metres=(500.0, 0.005)))
    assert where == "cloth-1, cloth"
    says = "metres_per_unit of u is 0.5, the images show 500; of v is 0.5, the images show 0.005:"
    assert message.startswith(says)
    # Depth that is known to be wrong says nothing about the scale.
    part = points(metres=(500.0, 0.005))
    assert found(replace(part, shown_m=part.depth_m + 1)) == {"DEPTH_IMAGE_DISAGREES"}
