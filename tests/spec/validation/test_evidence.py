"""What frames say together: repeated, empty and grey pictures, and an order in time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from pliant.spec.camera import Camera
from pliant.spec.model import Tier
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.correspondences import FrameRows
from pliant.spec.validation.rules.episodes import unordered
from pliant.spec.validation.rules.evidence import Evidence
from pliant.spec.validation.rules.files import SequenceFiles
from pliant.spec.validation.rules.precision import JPEG
from tests.conformance.base import TIERS
from tests.spec.validation.world import SIZE, rows_at, shown

RASTER: dict[str, Any] = {"noise": None, "style": "raster", "temporal": False}


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
    return rows_at(frame, xyz, xyz)


@pytest.mark.parametrize(
    ("centres", "says"),
    [
        ((0,), None),
        # The radius of two points 1 m from their middle is 1 m.
        ((0, 0.5999), None),
        ((0, 0.6001), "by 0.60 of the object's radius: independent"),
        ((5, 5.2, 5.4, 5.6), None),  # 0.2, and 0.47 between other frames
        ((5, 5.2, 5, 5.2), "by 0.20 of the object's radius, 3.00 of"),
        ((5, 5.2, 5), None),  # too few frames
        # Small whatever the others are.
        ((0, 0.0999, 0, 0.0999), None),
        ((0, 0.1001, 0, 0.1001), "by 0.10 of"),
        # Steps 0.2, 0.2 - x, 0.2 are 0.75 of the others, x, x, x + 0.2, for x = 0.45 / 3.25.
        ((0, 0.2, 0.138, 0.338), "by 0.20 of"),
        ((0, 0.2, 0.139, 0.339), None),
    ],
)
def test_a_step_in_time_is_small_next_to_the_object(
    centres: tuple[float, ...], says: str | None
) -> None:
    found = unordered([rows(frame, centre) for frame, centre in enumerate(centres)])
    assert found is None if says is None else says in str(found)


def test_only_the_same_points_in_neighbouring_frames_are_compared() -> None:
    assert unordered([rows(0, 0), rows(2, 9)]) is None
    assert unordered([rows(0, 0), rows(2, 9), rows(3, 9.1)]) is None
    assert unordered([rows(0, 0), rows(1, 9, 4)]) is None
    assert unordered([rows(0, 0), rows(1, 9)]) is not None
    # Points of a frame that is left out have no neighbour there.
    assert unordered([rows(k, at) for k, at in ((0, 0), (1, 0.2), (3, 0), (4, 0.2))]) is not None
    still = [replace(rows(k, 0), xyz_m=np.zeros((2, 3))) for k in range(4)]
    assert unordered(still) is None
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


def test_pictures_in_which_little_is_seen_may_be_empty_or_equal() -> None:
    evidence = Evidence(3, blank=[0, 1, 2])
    evidence.keys.depths = {0: 7, 1: 7, 2: 7}
    evidence.keys.pictures = {0: 5, 1: 5, 2: 5}
    for frame, count in enumerate((0, 49, 50)):
        evidence.add_shown(frame, shown(np.arange(200) < count))
    assert evidence.keys.pictures == {2: 5}
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


def test_compression_that_the_noise_states_is_no_fault() -> None:
    evidence = Evidence(2, coarse={JPEG: [0, 1]}, looked=2)
    for noise in (None, {"gaussian": [0, 3]}, {"jpeg_quality": None}):
        assert "JPEG" in conclude(evidence, noise=noise)["COLOUR_LOST"]
    assert conclude(evidence, noise={"jpeg_quality": [85, 95]}) == {}


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
    evidence.blank, findings = [0], Findings()  # blank pictures are reported as well
    conclude(evidence, findings=findings, **info)
    assert len(findings.listed()) == 2
    assert {issue.message[:6] for issue in findings.listed()} == {"1 of 2", "shifte"}


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


def test_a_step_is_the_root_mean_square_of_its_points() -> None:
    """One of four points moves by 1 m, the others do not: a step of half a metre."""
    first = rows(0, 0, 4)
    xyz = first.xyz_m.copy()
    xyz[0, 1] += 1.0
    second = replace(first, frame=1, xyz_m=xyz)
    radius = np.sqrt((1.0 + xyz.var(axis=0).sum()) / 2)
    assert unordered([first, second]) is None
    far = replace(first, frame=1, xyz_m=first.xyz_m + (xyz - first.xyz_m) * 1.6)
    radius = np.sqrt((1.0 + far.xyz_m.var(axis=0).sum()) / 2)
    assert f"move by {0.8 / radius:.2f} of" in str(unordered([first, far]))


CAMERA = Camera(np.array([[100.0, 0, 32], [0, 100, 24], [0, 0, 1]]), np.eye(4), SIZE)


def test_rows_are_kept_for_their_cause_and_their_shape() -> None:
    evidence = Evidence(2)
    evidence.add_rows(CAMERA, rows(1, 3))
    assert evidence.rows.checked == 2
    assert evidence.keys.shapes[1][:6].tolist() == [3, 0, 0, 1, 0, 0]


@pytest.mark.parametrize("wrong", [True, False])
def test_what_follows_from_wrong_depth_images(wrong: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """More than one problem of the visibility becomes one that says so."""
    agreement = "pliant.spec.validation.rules.evidence.check_agreement"
    monkeypatch.setattr(agreement, lambda *_: wrong)
    findings = Findings()
    for code in ("VISIBLE_DISAGREES", "OCCLUDED_DISAGREES", "VISIBLE_DISAGREES"):
        findings.add(code, "s/correspondences.parquet", "", "x")
    follows = "all 2 rows follow from DEPTH_IMAGE_DISAGREES" if wrong else "x"
    assert conclude(Evidence(2), [CAMERA] * 2, findings) == {
        "VISIBLE_DISAGREES": follows, "OCCLUDED_DISAGREES": "x",
    }  # fmt: skip


def test_repeated_pictures_are_counted_and_explain_a_doubt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    evidence = Evidence(5)
    evidence.keys.pictures = {0: 5, 1: 6, 2: 5, 3: 6, 4: 7}
    evidence.keys.shapes = {frame: np.array([0, 0, 2, 0.1, 0.1, 0.1 * frame]) for frame in range(5)}
    cameras = [CAMERA] * 5
    found = conclude(evidence, cameras)
    assert found["COLOUR_DISAGREES"].startswith(
        "2 pictures repeat that of an earlier frame, here 0, though"
    )
    assert conclude(evidence, None) == {}
    unknown = evidence.keys.shapes.pop(3)  # of frames without rows nothing is known
    assert conclude(evidence, cameras)["COLOUR_DISAGREES"].startswith("1 pictures repeat")
    evidence.keys.shapes[3] = unknown
    for certain, messages in ((False, 1), (True, 2)):
        monkeypatch.setattr(evidence.colours, "explain", lambda c=certain: (c, "shifted"))
        findings = Findings()
        conclude(evidence, cameras, findings)
        assert [issue.code for issue in findings.listed()] == ["COLOUR_DISAGREES"] * messages
        assert findings.issues[0].where == "frame 2"
    evidence.keys.pictures = {0: 5, 1: 6}
    monkeypatch.setattr(evidence.colours, "explain", lambda: (False, "shifted"))
    assert conclude(evidence, cameras) == {"COLOUR_DOUBTFUL": "shifted"}


def test_depth_decides_how_far_a_move_is_seen() -> None:
    """At 1 mm or in the camera's plane any move is one; the smaller focal length counts."""
    for depth, focal, moved, wrong in (
        (2.0, 100.0, 0.0401, True), (2.0, 100.0, 0.0399, False), (4.0, 100.0, 0.0799, False),
        (2.0, 50.0, 0.0799, False), (2.0, 50.0, 0.0801, True), (0.0, 100.0, 3e-8, True),
        (2.0, 150.0, 0.0399, False), (2.0, 150.0, 0.0401, True), (0.0, 100.0, 1e-9, False),
    ):  # fmt: skip
        K = np.array([[focal, 0, 32], [0, 100, 24], [0, 0, 1]])
        evidence = Evidence(2)
        evidence.keys.pictures = {0: 5, 1: 5}
        shape = np.array([0, 0, depth, 0.1, 0.1, 0.1])
        evidence.keys.shapes = {0: shape, 1: shape - [moved, 0, 0, 0, 0, 0]}
        found = conclude(evidence, [Camera(K, np.eye(4), SIZE)] * 2)
        assert ("COLOUR_DISAGREES" in found) is wrong, (depth, focal, moved)
