"""What frames say together: repeated, empty and grey pictures, and an order in time."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from pliant.spec.camera import Camera
from pliant.spec.io.exr import Surface
from pliant.spec.model import Tier
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.correspondences import FrameRows
from pliant.spec.validation.rules.episodes import unordered
from pliant.spec.validation.rules.evidence import Evidence
from pliant.spec.validation.rules.files import SequenceFiles
from pliant.spec.validation.rules.surfaces import ShownSurface
from tests.conformance.base import TIERS

RASTER: dict[str, Any] = {"noise": None, "style": "raster", "temporal": False}
SIZE = (64, 48)


def conclude(
    evidence: Evidence,
    cameras: list[Camera] | None = None,
    findings: Findings | None = None,
    **info: Any,
) -> dict[str, str]:
    """Return code -> message of what the evidence leads to."""
    findings = findings or Findings()
    files = SequenceFiles(Path(), "s", findings, set())
    evidence.conclude(Tier.from_document(TIERS["rope"]), RASTER | info, cameras, SIZE, files)
    return {issue.code: issue.message for issue in findings.listed()}


def rows(frame: int, centre: float, count: int = 2) -> FrameRows:
    """Return points 1 m to the left and right of a place on the x axis."""
    xyz = np.zeros((count, 3))
    xyz[:, 0] = centre + np.where(np.arange(count) % 2, 1, -1)
    point = np.arange(count, dtype=np.int32)
    return FrameRows(frame, point, xyz[:, :2], xyz[:, 2], 0 * point, xyz)


def order(*centres: float) -> str | None:
    return unordered([rows(frame, centre) for frame, centre in enumerate(centres)])


def test_a_step_in_time_is_small_next_to_the_object() -> None:
    assert order(0) is None
    assert order(0, 0.59) is None
    assert str(order(0, 0.61)).startswith("from one frame to the next the points move by 0.61 of")
    assert order(5, 5.2, 5.4, 5.6) is None  # 0.2, and 0.47 between other frames
    assert "by 0.20 of the object's radius, 3.00 of" in str(order(5, 5.2, 5, 5.2))
    assert order(5, 5.2, 5) is None  # too few frames
    assert order(5, 5.09, 5, 5.09) is None  # small whatever the others are
    assert order(0, 0.2, 0.1, 0.3) is not None  # steps of 1/6, 1/6 between others
    assert order(0, 0.2, 0.25, 0.45) is None  # 0.15, 0.32


def test_only_the_same_points_in_neighbouring_frames_are_compared() -> None:
    assert unordered([rows(0, 0), rows(2, 9)]) is None
    assert unordered([rows(0, 0), rows(2, 9), rows(3, 9.1)]) is None
    assert unordered([rows(0, 0), rows(1, 9, 4)]) is None
    assert unordered([rows(0, 0), rows(1, 9)]) is not None
    evidence = Evidence(2)
    evidence.rows.rows = [rows(0, 0), rows(1, 9)]
    assert conclude(evidence) == {}
    assert set(conclude(evidence, temporal=True)) == {"TEMPORAL_DOUBTFUL"}


def texture(seed: int) -> npt.NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (40, 50, 3), np.uint8)


def test_pictures_are_known_by_every_fourth_row() -> None:
    evidence = Evidence(4)
    first = texture(0)
    other, same = first.copy(), first.copy()
    other[4, 7, 1] ^= 1
    same[5, 7, 1] ^= 1
    for frame, rgb in enumerate((first, other, same, np.zeros_like(first))):
        evidence.add_picture(frame, rgb)
    keys = evidence.keys.pictures
    assert set(keys) == {0, 1, 2}
    assert keys[0] == keys[2] != keys[1]
    assert evidence.blank == [3]


def shown(count: int) -> ShownSurface:
    object_id = (np.arange(200) < count).astype(np.uint32).reshape(10, 20)
    empty = np.zeros((10, 20), np.float32)
    return ShownSurface.of(Surface(empty, empty, empty, object_id))


def test_pictures_in_which_little_is_seen_may_be_empty_or_equal() -> None:
    evidence = Evidence(3, blank=[0, 1, 2])
    evidence.keys.depths = {0: 7, 1: 7, 2: 7}
    for frame, count in enumerate((0, 49, 50)):
        evidence.add_shown(frame, shown(count))
    assert evidence.blank == [2]
    assert evidence.keys.depths == {1: 7, 2: 7}


def test_empty_pictures_are_an_error_where_the_renderer_is_known() -> None:
    evidence = Evidence(5, blank=[3, 4])
    assert set(conclude(evidence)) == {"COLOUR_DOUBTFUL"}  # held out: the points are not known
    evidence.keys.shapes[0] = np.zeros(6)
    assert set(conclude(evidence, style="external")) == {"COLOUR_DOUBTFUL"}
    message = conclude(evidence)["COLOUR_DISAGREES"]
    assert message.startswith("2 of 5 pictures are one colour")


def test_grey_pictures() -> None:
    grey = np.repeat(texture(1)[..., :1], 3, axis=2)
    evidence = Evidence(3)
    for frame, rgb in enumerate((np.zeros_like(grey), grey, grey, grey)):
        evidence.add_picture(frame, rgb)
    assert evidence.looked == 2
    assert list(evidence.coarse.values()) == [[1, 2]]
    evidence.blank = []
    assert conclude(evidence)["COLOUR_LOST"].startswith("the pictures are grey")
    assert conclude(evidence, style="external") == {}
    evidence = Evidence(2)
    for frame, rgb in enumerate((grey, texture(2))):
        evidence.add_picture(frame, rgb)
    assert conclude(evidence) == {}  # half of them
    half = np.repeat(np.repeat(texture(3)[:20, :25], 2, axis=0), 2, axis=1)
    evidence = Evidence(1)
    evidence.add_picture(0, half)
    assert "half the size" in conclude(evidence, style="external")["COLOUR_LOST"]


@pytest.mark.parametrize(("moved", "wrong"), [(0.039, False), (0.041, True)])
def test_a_picture_is_not_that_of_points_that_moved(moved: float, wrong: bool) -> None:
    """2 px of 100 px focal length at 2 m are 4 cm."""
    K = np.array([[100.0, 0, 32], [0, 150, 24], [0, 0, 1]])
    cameras = [Camera(K, np.eye(4), SIZE)] * 4
    evidence = Evidence(4)
    evidence.keys.pictures = {0: 5, 1: 6, 2: 5, 3: 5}
    evidence.keys.shapes = {frame: np.array([0, 0, 2, 0.1, 0.1, 0.1]) for frame in range(3)}
    evidence.keys.shapes[2] = evidence.keys.shapes[0] + [0, 0, 0, 0, moved, 0]
    found = conclude(evidence, cameras)
    assert ("COLOUR_DISAGREES" in found) is wrong
    if wrong:
        assert found["COLOUR_DISAGREES"].startswith("1 pictures repeat that of an earlier frame")
    assert conclude(evidence, None) == {}


@pytest.mark.parametrize(
    ("certain", "info", "code"),
    [
        (True, {}, "COLOUR_DISAGREES"),
        (False, {}, "COLOUR_DOUBTFUL"),
        (True, {"style": "external"}, "COLOUR_DOUBTFUL"),
        (True, {"noise": {}}, "COLOUR_DOUBTFUL"),
    ],
)
def test_an_outline_elsewhere(
    certain: bool, info: dict[str, Any], code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence = Evidence(2)
    monkeypatch.setattr(evidence.colours, "explain", lambda: (certain, "shifted"))
    assert conclude(evidence, **info) == {code: "shifted"}
    findings = Findings()
    findings.add("OFFSET_DISAGREES", "s/correspondences.parquet", "", "points are shifted")
    assert set(conclude(evidence, findings=findings, **info)) == {"OFFSET_DISAGREES"}


def test_pairs_of_frames_spread_over_a_long_sequence_are_measured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    evidence = Evidence(40, blank=[6])
    measured: list[int] = []
    fitting: list[int] = []
    others: list[int] = []
    monkeypatch.setattr(evidence.colours, "add", lambda frame, rgb, mask: measured.append(frame))
    monkeypatch.setattr(evidence.fitting, "add", lambda view: fitting.append(view.rows.frame))
    monkeypatch.setattr(evidence.others, "add", lambda view: others.append(view.rows.frame))
    for frame in range(40):
        view: Any = SimpleNamespace(
            rows=SimpleNamespace(frame=frame), surface=SimpleNamespace(mask=None)
        )
        rgb = None if frame == 12 else texture(0)
        evidence.add_surface(view, rgb, fits=frame != 13)
    assert measured == [0, 1, 7, 18, 19, 24, 25, 30, 31, 36, 37]
    assert others == [13]
    assert len(fitting) == 39
