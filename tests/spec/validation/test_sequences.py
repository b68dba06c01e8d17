"""One sequence: what its documents, its row and its tables say of each other, exactly."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from pliant.spec.io.exr import read_surface
from pliant.spec.model import Tier
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.result import SequenceResult
from pliant.spec.validation.rules.sequences import check_sequence
from tests.conformance.base import relist
from tests.conformance.edits import (
    change_exr,
    change_footer,
    change_json,
    change_rows,
    change_table,
    write_png,
)
from tests.conformance.publications import record
from tests.spec.conftest import DATASETS
from tests.spec.validation import world

NAME = "rope-train-000000"
FOLDER = f"sequences/rope/{NAME}"
TABLE = f"{FOLDER}/correspondences.parquet"
DOCUMENT = f"{FOLDER}/sequence.json"
ROWS: dict[str, dict[str, Any]] = {
    row["id"]: row for row in pq.read_table(DATASETS / "full/sequences.parquet").to_pylist()
}
ROW = ROWS[NAME]
Edit = Callable[[Path], Any]


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """One sequence of `full` without its neighbours."""
    shutil.copytree(DATASETS / "full" / FOLDER, tmp_path / FOLDER)
    shutil.copy(DATASETS / "full" / "dataset.json", tmp_path)
    return tmp_path


def checked(
    root: Path,
    *edits: Edit,
    row: dict[str, Any] | None = ROW,
    tier: str = "rope",
    name: str = NAME,
    quick: bool = False,
    facts: dict[str, Any] | None = None,
) -> SequenceResult:
    """Make edits, bring the checksums up to date, and check."""
    for edit in edits:
        edit(root)
    for path in root.rglob("sequence.json"):
        if edits and not path.is_symlink():
            relist(path.parent, json.loads(path.read_text()))
    info = json.loads((root / "dataset.json").read_text()) | (facts or {})
    context = Context.of(root, info, map(Tier.from_document, info["tiers"]), quick)
    return check_sequence(context, tier, name, row)


def found(result: SequenceResult) -> list[tuple[str, str, str]]:
    return [(c, path.removeprefix(f"{FOLDER}/"), w) for c, path, w in world.found(result.findings)]


def document(**changes: Any) -> Edit:
    return change_json(DOCUMENT, lambda each: each.update(changes))


def test_what_a_sequence_gives_to_the_rules_above(root: Path) -> None:
    result = checked(root)
    assert found(result) == []
    assert (result.split, result.frames, result.temporal) == ("train", 2, False)
    assert result.tables_sound
    assert result.points_digest is not None
    boxes = []
    for frame in range(2):
        shown = read_surface(root / FOLDER / f"depth/{frame:06d}.exr").object_id == 1
        v, u = np.nonzero(shown)
        boxes.append(max(np.ptp(u), np.ptp(v)) + 1)
    assert result.boxes_px.tolist() == boxes
    listed = {e["path"]: e["sha256"] for e in json.loads((root / DOCUMENT).read_text())["files"]}
    assert result.keys.depths == {
        frame: int(listed[f"depth/{frame:06d}.exr"][:15], 16) for frame in range(2)
    }
    assert set(result.keys.pictures) == set(result.keys.shapes) == {0, 1}


@pytest.mark.parametrize("name", ["points.parquet", "correspondences.parquet"])
@pytest.mark.parametrize(
    ("footer", "places"),
    [
        ({"sequence": NAME, "tier": "rope"}, []),
        ({"sequence": "rope-train-000001"}, ["footer sequence"]),
        ({"sequence": "", "tier": "cloth-1"}, ["footer sequence", "footer tier"]),
    ],
)
def test_footers_name_the_folders_of_their_table(
    name: str, footer: dict[str, str], places: list[str], root: Path
) -> None:
    result = checked(root, change_footer(f"{FOLDER}/{name}", lambda f: f.update(footer)))
    assert found(result) == [("IDENTITY_DIFFERS", name, place) for place in places]


INFO = "sequence.json"
OTHER_ROW: dict[str, Any] = {
    "split": "test", "shape": None, "frames": 3, "temporal": True, "seed": 8, "style": "photo",
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "in_row", "expected"),
    [
        ({"id": "other"}, {}, [("IDENTITY_DIFFERS", "id")]),
        ({"tier": "rope-bare"}, {"tier": "cloth-1"}, [("IDENTITY_DIFFERS", "tier")]),
        ({}, OTHER_ROW, [("IDENTITY_DIFFERS", name) for name in OTHER_ROW]),
        ({}, {"coverage": 0.5}, []),
        ({}, None, []),
        ({"frame_info": [{}, {}, {}]}, {}, [("SCHEMA_INVALID", "frame_info")]),
        ({"split": "val"}, None, [("SPLIT_UNKNOWN", "split")]),
        ({"split": "val"}, {"split": "val"}, []),  # reported of the row
        ({"seed": -1}, {"seed": -1}, [("SCHEMA_INVALID", "seed")]),
    ],
)
def test_a_document_agrees_with_folder_and_row(
    changes: dict[str, Any],
    in_row: dict[str, Any] | None,
    expected: list[tuple[str, str]],
    root: Path,
) -> None:
    row = None if in_row is None else ROW | in_row
    result = checked(root, document(**changes), row=row, quick=True)
    problems = [(i.code, INFO, i.where) for i in result.findings.issues if i.path.endswith(INFO)]
    assert problems == [(code, INFO, where) for code, where in expected]
    assert (result.split is None) is (changes.get("seed") == -1)


def test_a_tier_that_is_not_described(root: Path) -> None:
    (root / "sequences/cable").mkdir()
    (root / FOLDER).rename(root / "sequences/cable" / NAME)
    edit = change_json(f"sequences/cable/{NAME}/sequence.json", lambda d: d.update(tier="cable"))
    for row, expected in ((None, ["TIER_UNKNOWN"]), (ROW | {"tier": "cable"}, [])):
        result = checked(root, edit, row=row, tier="cable", quick=True)
        assert list(result.findings.counts) == expected
        assert (result.points_digest, result.tables_sound) == (None, False)


def test_an_unfinished_sequence(root: Path) -> None:
    (root / DOCUMENT).rename(root / "elsewhere.json")
    result = checked(root)
    assert found(result) == [("FILE_MISSING", INFO, "")]
    assert (result.split, result.frames) == (None, 0)
    (root / DOCUMENT).symlink_to(root / "elsewhere.json")
    assert found(checked(root)) == [("PATH_UNSAFE", INFO, "")]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, []),
        ({"seed": 1}, ["seed"]),
        ({"frame_info": [{}, {"pose": 1}]}, ["frame_info"]),
        ({"frame_info": [{"pose": 1}, {}], "parameters": {"a": 1}}, ["parameters", "frame_info"]),
    ],
)
def test_a_held_out_sequence_says_nothing(
    changes: dict[str, Any], expected: list[str], root: Path
) -> None:
    for name in ("points.parquet", "correspondences.parquet", "depth"):
        path = root / FOLDER / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    seed = changes.get("seed", 0)
    result = checked(
        root, document(**{"seed": 0, "parameters": {}} | changes),
        row=ROW | {"seed": seed}, facts={"held_out": ["train"]},
    )  # fmt: skip
    assert found(result) == [("HELD_OUT_LEAKS", INFO, where) for where in expected]
    assert set(result.keys.pictures) == {0, 1}
    assert np.isnan(result.boxes_px).all()
    assert not result.tables_sound
    black = [write_png(f"{FOLDER}/rgb/00000{k}.png", "RGB") for k in range(2)]
    result = checked(root, *black, row=ROW | {"seed": seed}, facts={"held_out": ["train"]})
    assert ("COLOUR_DOUBTFUL", "rgb", "frame 0") in found(result)


@pytest.mark.parametrize(
    ("off", "wrong"), [(0.9e-5, False), (-0.9e-5, False), (1.1e-5, True), (-1.1e-5, True)]
)
def test_the_share_of_hidden_points(off: float, wrong: bool, root: Path) -> None:
    row = ROW | {"self_occluded": ROW["self_occluded"] + off}
    expected = ("SUMMARY_DISAGREES", "sequences.parquet", f"{NAME}, self_occluded")
    assert found(checked(root, row=row)) == ([expected] if wrong else [])


def test_the_share_is_that_of_surface_points_in_whole_tables(root: Path) -> None:
    """Centre-line points do not count; of a table with a row less the share is not known."""

    def hide(rows: list[dict[str, Any]]) -> None:
        for row in rows:
            if row["point"] in range(72, 81) and row["visibility"] == "visible":
                row["visibility"] = "self_occluded"

    row = ROW | {"self_occluded": 0.9}
    for edits, changed, wrong in (
        ([change_rows(TABLE, hide)], ROW, False),
        ([], row, True),
        ([], row | {"self_occluded": np.nan}, False),
    ):
        counts = checked(root, *edits, row=changed).findings.counts
        assert ("SUMMARY_DISAGREES" in counts) is wrong
    result = checked(root, change_rows(TABLE, lambda rows: rows[:-1]), row=row)
    assert result.findings.counts == {"ROW_MISSING": 1}


@pytest.mark.parametrize(
    ("edit", "sound"),
    [
        (change_rows(TABLE, lambda rows: rows[3].update(u_px=9.0)), True),
        (change_rows(TABLE, lambda rows: rows[:-1]), False),
        (change_rows(TABLE, lambda rows: rows[3].update(x_m=np.nan)), False),
        (change_rows(f"{FOLDER}/points.parquet", lambda rows: rows[3].update(m0=7.0)), False),
        (change_json(f"{FOLDER}/cameras.json", lambda d: d["frames"].pop()), True),
        (change_table(f"{FOLDER}/points.parquet", lambda table: table.slice(0, 0)), False),
    ],
)
def test_whether_queries_can_be_compared_with_the_tables(
    edit: Edit, sound: bool, root: Path
) -> None:
    assert checked(root, edit).tables_sound is sound


def test_tables_that_are_not_verified_are_not_sound(root: Path) -> None:
    edit = change_json(
        DOCUMENT,
        lambda d: d.update(files=[e for e in d["files"] if "correspondences" not in e["path"]]),
    )
    edit(root)
    result = checked(root)
    assert found(result) == [("FILE_UNLISTED", INFO, "files")]
    assert not result.tables_sound


def test_every_frame_is_looked_at(root: Path) -> None:
    """A wrong row of the last frame, a value after it, and images of both frames."""

    def change(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
        rows[-1]["v_px"] += 3
        return [*rows, rows[-1] | {"frame": 7, "x_m": np.nan}]

    result = checked(root, change_rows(TABLE, change))
    assert sorted(found(result)) == [
        ("REPROJECTION_DISAGREES", "correspondences.parquet", "frame 1, point 92"),
        ("ROW_UNKNOWN", "correspondences.parquet", "row 186"),
        ("VALUE_NOT_FINITE", "correspondences.parquet", "row 186, x_m"),
    ]


def half(channels: dict[str, Any]) -> None:
    channels["Z"][:] = channels["Z"].astype(np.float16)


def test_the_precision_of_two_frames_is_looked_at(root: Path) -> None:
    edits = [change_exr(f"{FOLDER}/depth/{frame:06d}.exr", half) for frame in range(2)]
    problems = [each for each in found(checked(root, *edits)) if each[0] == "PRECISION_LOST"]
    assert problems == [("PRECISION_LOST", f"depth/{frame:06d}.exr", "Z") for frame in range(2)]


def behind_the_camera(channels: dict[str, Any]) -> None:
    channels["Z"][channels["surface.object"] == 1] *= -1


def test_an_image_that_breaks_a_rule_is_not_compared(root: Path) -> None:
    result = checked(root, change_exr(f"{FOLDER}/depth/000000.exr", behind_the_camera))
    assert [(code, path) for code, path, _ in found(result)] == [
        ("DEPTH_INVALID", "depth/000000.exr")
    ]
    assert np.isnan(result.boxes_px).tolist() == [True, False]


def test_without_cameras_images_are_still_checked(root: Path) -> None:
    (root / FOLDER / "cameras.json").unlink()
    (root / FOLDER / "rgb/000001.png").write_bytes(b"x")
    (root / FOLDER / "depth/000001.exr").write_bytes(b"x")
    result = checked(root, document())
    assert sorted(found(result)) == [
        ("FILE_MISSING", "cameras.json", ""),
        ("FILE_UNREADABLE", "depth/000001.exr", ""),
        ("FILE_UNREADABLE", "rgb/000001.png", ""),
    ]
    assert np.isnan(result.boxes_px).tolist() == [False, True]


def test_recorded_frames(tmp_path: Path) -> None:
    """Masks and camera depth of a held-out sequence, each with a fault in its second frame."""
    root = Path(shutil.copytree(DATASETS / "full", tmp_path / "full"))
    record(root)
    name, folder = "rope-test-000000", "sequences/rope/rope-test-000000"
    row = ROWS[name] | {"seed": 0}
    assert checked(root, lambda _: None, row=row, name=name).findings.counts == {}
    from pliant.spec.io.exr import write_camera_depth
    from pliant.spec.io.png import write_mask

    ids = np.zeros((48, 64), np.uint8)
    ids[3, 4:7] = 1, 2, 9
    write_mask(root / folder / "masks/000001.png", ids)
    for value, codes in ((np.inf, 0), (1e-9, 0), (0.0, 1), (-1.0, 1), (np.nan, 1)):
        depth_m = np.full((48, 64), 2, np.float32)
        depth_m[5, 6] = value
        write_camera_depth(root / folder / "camera_depth/000001.exr", depth_m)
        result = checked(root, lambda _: None, row=row, name=name)
        expected = {"SURFACE_INVALID": 1} | ({"DEPTH_INVALID": 1} if codes else {})
        assert result.findings.counts == expected
        assert {issue.path for issue in result.findings.issues} <= {
            f"{folder}/masks/000001.png", f"{folder}/camera_depth/000001.exr",
        }  # fmt: skip
