"""Outside data by hand: where its points must come out, and that it validates and scores."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pliant.cli.main import run
from pliant.spec.io.parquet import read_table
from tests.converters.conftest import Rejected
from tests.converters.importing import asked_and_true, imported
from tests.folders import files_of

WIDTH, HEIGHT = 40, 30

# Three frames, three points; a point is a list of pixels, empty where hidden. By hand: point 1
# has two pixels in frame 0, whose mean is (11, 21); point 2 was rounded up to the right border
# (u = width) in frame 1, so it is not seen there; point 0 is hidden in frame 2.
KNOTS = {
    "0": [[[5, 6]], [[10, 20], [12, 22]], [[39, 29]]],
    "1": [[[7, 6]], [[13, 20]], [[40, 12]]],
    "2": [[], [[0, 0]], [[20, 15]]],
}


def knots_folder(folder: Path, document: Any = KNOTS, frames: int = 3) -> Path:
    folder.mkdir(parents=True)
    (folder / "knots_info.json").write_text(json.dumps(document))
    for frame in range(frames):
        rgb = np.full((HEIGHT, WIDTH, 3), 40 * frame, np.uint8)
        rgb[:, 1::2, 2] += 9  # a picture of one colour would be reported
        Image.fromarray(rgb).save(folder / f"{frame:06d}_rgb.png")
    return folder


def test_knots_come_out_where_they_are(tmp_path: Path) -> None:
    options = ("--licence", "CC0-1.0", "--version", "1.10.0")
    dataset = imported(knots_folder(tmp_path / "knots"), tmp_path / "out", *options)
    assert asked_and_true(tmp_path / "out") == [
        # Box of the points seen in frame 1: u 7 to 13, v 6 to 20, so 15 rows are the longer side.
        (0, 5.0, 6.0, 1, 7.0, 6.0, "visible", 15.0),
        (0, 11.0, 21.0, 1, 13.0, 20.0, "visible", 15.0),
        (0, 39.0, 29.0, 1, 40.0, 12.0, "out_of_frame", 15.0),
        # Frame 2: (0, 0) and (20, 15). Point 0 is hidden and nobody says where: not asked.
        (0, 11.0, 21.0, 2, 0.0, 0.0, "visible", 21.0),
        (0, 39.0, 29.0, 2, 20.0, 15.0, "visible", 21.0),
        # Frame 0: u 5 to 39, so 35 columns.
        (1, 7.0, 6.0, 0, 5.0, 6.0, "visible", 35.0),
        (1, 13.0, 20.0, 0, 11.0, 21.0, "visible", 35.0),
        (1, 13.0, 20.0, 2, 0.0, 0.0, "visible", 21.0),
        (2, 0.0, 0.0, 0, 11.0, 21.0, "visible", 35.0),
        (2, 20.0, 15.0, 0, 39.0, 29.0, "visible", 35.0),
        (2, 0.0, 0.0, 1, 13.0, 20.0, "visible", 15.0),
        (2, 20.0, 15.0, 1, 40.0, 12.0, "out_of_frame", 15.0),
    ]
    (sequence,) = dataset.sequences
    assert (sequence.frames, sequence.temporal, dataset.size) == (3, False, (WIDTH, HEIGHT))
    assert [int(sequence.rgb(frame)[0, 0, 0]) for frame in range(3)] == [0, 40, 80]
    provenance = dataset.info["provenance"]
    assert provenance["seed"] is None
    assert {"depth", "cameras", "scale"} <= set(provenance["config"]["unknown"])
    assert dataset.held_out == ["test"]
    assert dataset.tiers["out"].variant == "unknown"
    assert (dataset.info["licence"], dataset.version) == ("CC0-1.0", "1.10.0")
    files = {path.name for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert not {"cameras.json", "points.parquet", "correspondences.parquet"} & files
    assert not [name for name in files if name.endswith(".exr")]


def test_rows_of_a_pair_are_in_random_order(tmp_path: Path) -> None:
    """Knots are numbered along the rope: sorted rows would say which one a pixel is.

    An order that follows from the public code alone, whatever the answers, would say so as well.
    """
    orders = []
    for v in (5, 6):  # of the targets, which are the answers
        knots = {str(k): [[[u + k, v if k else 5]] for u in range(2, 38)] for k in range(3)}
        imported(knots_folder(tmp_path / f"knots{v}", knots), tmp_path / f"out{v}")
        table = read_table(tmp_path / f"out{v}" / "queries" / "test.parquet", "queries")
        rows = table.to_pylist()
        orders += [
            tuple(row["u_a"] - row["frame_a"] for row in rows if row["pair_id"] == pair)
            for pair in (0, 1)
        ]
    assert all(set(order) == {float(u) for u in range(2, 38)} for order in orders)
    assert len({*orders, tuple(sorted(orders[0]))}) == 5


def test_imported_set_is_shown(tmp_path: Path) -> None:
    """A sheet of colour alone, where nobody knows depth or index colours."""
    imported(knots_folder(tmp_path / "knots"), tmp_path / "out")
    picture = tmp_path / "sheet.png"
    assert run(["view", str(tmp_path / "out"), "--out", str(picture)]) == 0
    with Image.open(picture) as sheet:
        # Three frames of 240 x 180 px (4:3, as 40 x 30) in a row, 6 px apart, under lines of text;
        # index colours and depth would be 90 px more.
        assert sheet.width == 3 * 240 + 4 * 6
        assert 180 < sheet.height < 180 + 90
        colours = sheet.convert("RGB").getcolors(2**20)
    assert colours is not None
    assert {(0, 0, 0), (40, 40, 40), (80, 80, 80)} <= {colour for _, colour in colours}


def test_same_source_gives_the_same_bytes(tmp_path: Path) -> None:
    source = knots_folder(tmp_path / "knots")
    for name in ("a", "b"):
        imported(source, tmp_path / name / "out", "--pairs", "3")
    first, second = files_of(tmp_path / "a"), files_of(tmp_path / "b")
    assert [name for name in first if first[name] != second.get(name)] == []
    truth = read_table(tmp_path / "a" / "out-truth" / "test.parquet", "truth")
    assert len(set(truth["pair_id"].to_pylist())) == 3


def test_wrong_calls_are_one_sentence(tmp_path: Path, rejected: Rejected) -> None:
    source = knots_folder(tmp_path / "knots")
    sizes = {
        "9000x100": "found 9000x100; required: sides of at most 8,192 px",
        "8000x8000": "16,777,216 pixels in all",
        **dict.fromkeys(("0x5", "5", "5x5x5", "-5x5"), "--size: "),
    }
    for size, said in sizes.items():
        assert said in rejected(source, "--size", size, code=2)
    said = r"--title: the text has a control or bidirectional character; found \u202e"
    assert said in rejected(source, "--title", "a\u202eb", code=2)
    assert r"--licence: the text has a control" in rejected(source, "--licence", "a\nb", code=2)
    assert "invalid version" in rejected(source, "--version", "1.0", code=2)
    assert "file or folder not found" in rejected(tmp_path / "nowhere", code=2)
    (tmp_path / "no-truth").mkdir()
    (tmp_path / "no-truth" / "mine").touch()
    assert "the output exists already" in rejected(source, code=2)
