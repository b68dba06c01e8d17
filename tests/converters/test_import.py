"""Outside data by hand: where its points must come out, and that it validates and scores."""

from __future__ import annotations

import io
import json
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pliant.cli.main import run
from pliant.converters import tapvid
from pliant.evaluator import evaluate
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.parquet import read_table
from pliant.spec.validation.validate import validate

WIDTH, HEIGHT = 40, 30

# Three frames, three points; a point is a list of pixels, empty where hidden. By hand: point 1
# has two pixels in frame 0, whose mean is (11, 21); point 2 was rounded up to the right border
# (u = width) in frame 1, so it is not seen there; point 0 is hidden in frame 2.
KNOTS = {
    "0": [[[5, 6]], [[10, 20], [12, 22]], [[39, 29]]],
    "1": [[[7, 6]], [[13, 20]], [[40, 12]]],
    "2": [[], [[0, 0]], [[20, 15]]],
}


def knots_folder(folder: Path, document: Any = KNOTS) -> Path:
    folder.mkdir()
    (folder / "knots_info.json").write_text(json.dumps(document))
    for frame in range(3):
        rgb = np.full((HEIGHT, WIDTH, 3), 40 * frame, np.uint8)
        rgb[:, 1::2, 2] += 9  # a picture of one colour would be reported
        Image.fromarray(rgb).save(folder / f"{frame:06d}_rgb.png")
    return folder


def rows_of(path: Path, name: str) -> dict[tuple[int, ...], dict[str, Any]]:
    """Rows of a table by what they ask: source frame, target frame and the like are in it."""
    return {(row["pair_id"], row["query_id"]): row for row in read_table(path, name).to_pylist()}


def asked_and_true(out: Path) -> list[tuple[Any, ...]]:
    """(frame a, u, v, frame b, u, v, state, box) of every query, by pair and u in frame a."""
    queries = rows_of(out / "queries" / "test.parquet", "queries")
    truth = rows_of(out.with_name(f"{out.name}-truth") / "test.parquet", "truth")
    return [
        (
            *(queries[key][name] for name in ("frame_a", "u_a", "v_a", "frame_b")),
            *(truth[key][name] for name in ("u_b", "v_b", "visibility_b", "box_px")),
        )
        for key in sorted(queries, key=lambda key: (key[0], queries[key]["u_a"]))
    ]


def imported(source: Path, out: Path, *options: str) -> Dataset:
    assert run(["import", str(source), "--out", str(out), *options]) == 0
    result = validate(out)
    assert [str(issue) for issue in result.issues] == []
    return Dataset.open(out)


def test_knots_come_out_where_they_are(tmp_path: Path) -> None:
    dataset = imported(knots_folder(tmp_path / "knots"), tmp_path / "out")
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


def test_pixel_indices_are_half_a_pixel_further(tmp_path: Path) -> None:
    imported(knots_folder(tmp_path / "knots"), tmp_path / "out", "--pixels", "index")
    first = asked_and_true(tmp_path / "out")[0]
    assert first == (0, 5.5, 6.5, 1, 7.5, 6.5, "visible", 15.0)


def test_what_is_unknown_is_marked(tmp_path: Path) -> None:
    dataset = imported(knots_folder(tmp_path / "knots"), tmp_path / "out", "--licence", "CC0-1.0")
    provenance = dataset.info["provenance"]
    assert provenance["seed"] is None
    assert {"depth", "cameras", "scale"} <= set(provenance["config"]["unknown"])
    assert dataset.held_out == ["test"]
    assert dataset.tiers["out"].variant == "unknown"
    assert dataset.info["licence"] == "CC0-1.0"
    files = {path.name for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert not {"cameras.json", "points.parquet", "correspondences.parquet"} & files
    assert not [name for name in files if name.endswith(".exr")]


def test_rows_of_a_pair_are_in_random_order(tmp_path: Path) -> None:
    """Knots are numbered along the rope: sorted rows would say which one a pixel is."""
    knots = {str(k): [[[u + k, 5]] for u in range(2, 38)] for k in range(3)}
    imported(knots_folder(tmp_path / "knots", knots), tmp_path / "out")
    rows = read_table(tmp_path / "out" / "queries" / "test.parquet", "queries").to_pylist()
    orders = [
        tuple(row["u_a"] - row["frame_a"] for row in rows if row["pair_id"] == pair)
        for pair in (0, 1)
    ]
    assert set(orders[0]) == set(orders[1]) == {float(u) for u in range(2, 38)}
    assert orders[0] != orders[1]
    assert tuple(sorted(orders[0])) not in orders


def tracks(height: int = HEIGHT, width: int = WIDTH) -> dict[str, Any]:
    """Two points in three frames, as shares; by hand in pixels from the corner of 40 x 30.

    Point 0: (10, 15), (20, 15), hidden at (30, 15).
    Point 1: hidden, (4, 3), (0.5, 29.5), which is the centre of the pixel at the lower left.
    """
    points = [
        [[0.25, 0.5], [0.5, 0.5], [0.75, 0.5]],
        [[1.25, 0.5], [0.1, 0.1], [0.5 / WIDTH, 29.5 / HEIGHT]],
    ]
    rng = np.random.default_rng(1)
    return {
        "video": rng.integers(0, 256, (3, height, width, 3)).astype(np.uint8),
        "points": np.array(points, np.float32),
        "occluded": np.array([[False, False, True], [True, False, False]]),
    }


EXPECTED = [
    (0, 10.0, 15.0, 1, 20.0, 15.0, "visible", 17.0),  # box of (20, 15) and (4, 3)
    (0, 10.0, 15.0, 2, 30.0, 15.0, "occluded", 1.0),  # box of (0.5, 29.5) alone
    (1, 4.0, 3.0, 2, 0.5, 29.5, "visible", 1.0),
]


def approximately(rows: list[tuple[Any, ...]], expected: list[tuple[Any, ...]]) -> None:
    assert len(rows) == len(expected)
    for row, wanted in zip(rows, expected, strict=True):
        for found, value in zip(row, wanted, strict=True):
            assert found == (value if isinstance(value, str) else pytest.approx(value, abs=2e-6))


def saved(folder: Path, name: str = "tracks", **changes: Any) -> Path:
    """Write `tracks` with other arrays as an npz file."""
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.npz"
    np.savez_compressed(path, **{**tracks(), **changes})
    return path


@pytest.mark.parametrize("form", ["file", "folder", "pixels"])
def test_tracks_come_out_where_they_are(form: str, tmp_path: Path) -> None:
    record = tracks()
    if form == "pixels":
        record["points"] = record["points"] * np.array([WIDTH, HEIGHT], np.float32)
    path = saved(tmp_path / "clips", **record)
    dataset = imported(path.parent if form == "folder" else path, tmp_path / "out")
    approximately(asked_and_true(tmp_path / "out"), EXPECTED)
    (sequence,) = dataset.sequences
    assert sequence.temporal
    for frame in range(3):
        np.testing.assert_array_equal(sequence.rgb(frame), record["video"][frame])
    assert dataset.info["provenance"]["config"]["sources"] == {sequence.id: "tracks"}


def test_the_code_of_the_page_converts_a_pickle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Raw and encoded frames, as TAP-Vid's files have them; the code is that of the page."""
    encoded = []
    for image in tracks()["video"]:
        buffer = io.BytesIO()
        Image.fromarray(image).save(buffer, "JPEG")
        encoded.append(buffer.getvalue())
    pickled = {"goat": tracks(), "jpeg": {**tracks(), "video": encoded}}
    (tmp_path / "tracks.pkl").write_bytes(pickle.dumps(pickled))
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs" / "import.md").read_text()
    code = page.split("```python\n")[1].split("```")[0]
    exec(code, {})
    dataset = imported(tmp_path / "clips", tmp_path / "out")
    np.testing.assert_array_equal(dataset.sequences[0].rgb(1), tracks()["video"][1])
    with Image.open(io.BytesIO(encoded[1])) as picture:
        np.testing.assert_array_equal(dataset.sequences[1].rgb(1), np.asarray(picture))
    approximately(asked_and_true(tmp_path / "out")[3:], EXPECTED)


def test_clips_of_two_sizes_need_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    saved(tmp_path / "clips", "a")
    path = saved(tmp_path / "clips", "b", **tracks(60, 80)).parent
    assert run(["import", str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "found 40x30, 80x60" in said
    assert "Give --size WxH" in said
    dataset = imported(path, tmp_path / "out", "--size", "80x60")
    assert dataset.size == (80, 60)
    rows = asked_and_true(tmp_path / "out")
    approximately([row[:7] for row in rows[:3]], [row[:7] for row in rows[3:]])
    assert rows[0][1:6] == (20.0, 30.0, 1, 40.0, 30.0)  # twice the pixels of 40 x 30
    # One pixel of the small clip is four of the large one, so corners stay corners.
    small, large = tracks()["video"][0], dataset.sequences[0].rgb(0)
    np.testing.assert_array_equal(large, small.repeat(2, axis=0).repeat(2, axis=1))


def test_imported_set_is_answered_and_scored(tmp_path: Path) -> None:
    """By hand: staying where it was errs by 10 px on point 0 and by (3.5, 26.5) on point 1."""
    out, answers = tmp_path / "out", tmp_path / "identity.parquet"
    imported(saved(tmp_path / "clips"), out)
    command = ["predict", "identity", "--data", str(out), "--out", str(answers)]
    assert run(command) == 0
    scores = evaluate(answers, out, truth=tmp_path / "out-truth" / "test.parquet")
    expected = np.sqrt((10**2 + 3.5**2 + 26.5**2) / 2)
    assert scores.overall["rmse_px"] == pytest.approx(expected, rel=1e-6)
    assert scores.document["counts"]["queries"] == 3
    assert scores.document["counts"]["counted"] == 2
    assert scores.overall.get("geodesic_mean_m") is None  # no surface, so no such score


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
    for kind in ("out", "out-truth"):
        files = sorted(p for p in (tmp_path / "a" / kind).rglob("*") if p.is_file())
        for path in files:
            other = tmp_path / "b" / path.relative_to(tmp_path / "a")
            assert path.read_bytes() == other.read_bytes(), path
    assert len(set(read_table(files[0], "truth")["pair_id"].to_pylist())) == 3


BROKEN_KNOTS: dict[str, tuple[Any, str]] = {
    "frame missing": ({k: KNOTS[k] for k in "01"}, "frame 2 has only one of them"),
    "points differ": ({**KNOTS, "1": KNOTS["1"][:2]}, "do not list the same points"),
    "no pixels": ({**KNOTS, "1": [[7], [[1, 2]], []]}, "frame 1, point 0: a point is not a list"),
    "no frames": ({}, "these are not annotations"),
    "no number": ({**KNOTS, "x": KNOTS["1"]}, "a frame has no number"),
}


@pytest.mark.parametrize("case", BROKEN_KNOTS)
def test_broken_annotations_are_named(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document, said = BROKEN_KNOTS[case]
    source = knots_folder(tmp_path / "knots", document)
    assert run(["import", str(source), "--out", str(tmp_path / "out")]) == 1
    assert said in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"knots"}


BROKEN_TRACKS: dict[str, tuple[dict[str, Any], str]] = {
    "fewer frames": ({"points": tracks()["points"][:, :2]}, "do not belong together"),
    "no frames": ({"video": np.zeros((0, 4, 4, 3), np.uint8)}, "do not belong together"),
    "one number": ({"video": np.uint8(3)}, "do not belong together"),
    "floats": ({"video": tracks()["video"].astype(float)}, "a frame is not a colour image"),
    "no picture": ({"video": np.array([b"no picture"] * 3)}, "a frame cannot be read"),
    "nowhere": ({"points": tracks()["points"] * np.nan}, "a visible point has no position"),
    "text": ({"points": np.array(["x"])}, "these are not numbers"),
    # Arrays of objects in an npz are pickles, and would be run.
    "objects": ({"video": np.array([b"jpeg", None], dtype=object)}, "Its arrays must be numbers"),
}


@pytest.mark.parametrize("case", BROKEN_TRACKS)
def test_broken_tracks_are_named(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes, said = BROKEN_TRACKS[case]
    path = saved(tmp_path / "clips", **changes)
    assert run(["import", str(path), "--out", str(tmp_path / "out")]) == 1
    assert said in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"clips"}


def test_an_incomplete_or_damaged_file_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.savez(tmp_path / "part.npz", video=tracks()["video"])
    (tmp_path / "cut.npz").write_bytes((tmp_path / "part.npz").read_bytes()[:300])
    for name, said in (("part", "no points, occluded"), ("cut", "the npz file cannot be read")):
        assert run(["import", str(tmp_path / f"{name}.npz"), "--out", str(tmp_path / "out")]) == 1
        assert said in capsys.readouterr().err


def test_what_is_large_once_unpacked_is_refused_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tapvid, "_MAX_UNPACKED_BYTES", 10**6)
    path = saved(tmp_path, video=np.zeros((3, 700, 700, 3), np.uint8))
    assert path.stat().st_size < 10**5
    with pytest.raises(SpecError, match=r"4\.4 MB once unpacked; at most 1\.0 MB"):
        tapvid.read_npz(path)


def test_a_size_that_lies_ends_at_the_limit_of_memory(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The archive declares little, the array's header 8 TB."""
    header = np.lib.format.header_data_from_array_1_0(np.zeros(0, np.uint8))
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {**header, "shape": (2**43,)})
    with zipfile.ZipFile(tmp_path / "lie.npz", "w") as archive:
        archive.writestr("video.npy", file.getvalue())
    assert run(["import", str(tmp_path / "lie.npz"), "--out", str(tmp_path / "out")]) == 1
    assert "lie.npz" in capsys.readouterr().err


def test_size_beyond_the_limit_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = knots_folder(tmp_path / "knots")
    command = ["import", str(source), "--out", str(tmp_path / "out"), "--size"]
    assert run([*command, "9000x100"]) == 2
    assert "found 9000x100; required: sides of at most 8,192 px" in capsys.readouterr().err
    assert run([*command, "8000x8000"]) == 2
    assert "16,777,216 pixels in all" in capsys.readouterr().err
    for size in ("0x5", "5", "5x5x5", "-5x5"):
        assert run([*command, size]) == 2
        assert "--size: the size" in capsys.readouterr().err


def test_folder_that_is_there_is_not_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = knots_folder(tmp_path / "knots")
    (tmp_path / "out-truth").mkdir()
    assert run(["import", str(source), "--out", str(tmp_path / "out")]) == 2
    assert "the folder is there already" in capsys.readouterr().err
