"""Point tracks in the form of TAP-Vid: where they come out, and what is refused."""

from __future__ import annotations

import io
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pliant.cli.main import run
from pliant.converters import read_source, tapvid
from pliant.evaluator import evaluate
from pliant.spec.errors import SpecError
from tests.converters.conftest import Rejected
from tests.converters.importing import asked_and_true, imported

WIDTH, HEIGHT = 40, 30


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


def jpeg(image: Any) -> bytes:
    """A picture as the bytes of a JPEG."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG")
    return buffer.getvalue()


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


def test_a_visible_position_slightly_outside_leaves_shares_shares(tmp_path: Path) -> None:
    points = tracks()["points"]
    points[1, 2] = [1.001, 0.5]  # interpolated past the border: still shown as visible
    imported(saved(tmp_path / "clips", points=points), tmp_path / "out")
    rows = asked_and_true(tmp_path / "out")
    approximately([row[:7] for row in rows[:2]], [row[:7] for row in EXPECTED[:2]])
    assert rows[2][4:7] == (pytest.approx(40.04), 15.0, "out_of_frame")


def test_the_code_of_the_page_converts_a_pickle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Raw and encoded frames, as TAP-Vid's files have them; the code is that of the page."""
    encoded = [jpeg(image) for image in tracks()["video"]]
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


def test_a_clip_is_read_by_one_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Path] = []

    def counted(task: Any, *, path: Path, **_: Any) -> Any:
        read.append(path)
        return task()

    monkeypatch.setattr(tapvid, "run_limited", counted)
    paths = [saved(tmp_path / "clips", name) for name in "ab"]
    imported(tmp_path / "clips", tmp_path / "out", warned="FRAME_REPEATED")
    assert read == paths


def test_clips_of_two_sizes_need_one(tmp_path: Path, rejected: Rejected) -> None:
    saved(tmp_path / "clips", "a")
    path = saved(tmp_path / "clips", "b", **tracks(60, 80)).parent
    steps: list[tuple[int, int]] = []  # each file takes a process
    read_source(path, progress=lambda done, total: steps.append((done, total)))
    assert steps == [(1, 2), (2, 2)]
    said = rejected(path, code=2)
    assert "found 40x30, 80x60" in said
    assert "Give --size WxH" in said
    dataset = imported(path, tmp_path / "out", "--size", "80x60", warned="COLOUR_LOST")
    assert dataset.size == (80, 60)
    rows = asked_and_true(tmp_path / "out")
    approximately([row[:7] for row in rows[:3]], [row[:7] for row in rows[3:]])
    assert rows[0][1:6] == (20.0, 30.0, 1, 40.0, 30.0)  # twice the pixels of 40 x 30
    # One pixel of the small clip is four of the large one, so corners stay corners.
    small, large = tracks()["video"][0], dataset.sequences[0].rgb(0)
    np.testing.assert_array_equal(large, small.repeat(2, axis=0).repeat(2, axis=1))


def test_indices_of_pixels_are_not_taken_for_positions(tmp_path: Path, rejected: Rejected) -> None:
    said = rejected(saved(tmp_path / "clips"), "--pixels", "index", code=2)
    assert "--pixels: tracks have positions, not indices of pixels" in said


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


BROKEN_TRACKS: dict[str, tuple[dict[str, Any], str]] = {
    "fewer frames": ({"points": tracks()["points"][:, :2]}, "do not belong together"),
    "no frames": ({"video": np.zeros((0, 4, 4, 3), np.uint8)}, "do not belong together"),
    "one number": ({"video": np.uint8(3)}, "do not belong together"),
    "floats": ({"video": tracks()["video"].astype(float)}, "a frame is not a colour image"),
    "no picture": ({"video": np.array([b"no picture"] * 3)}, "a frame cannot be read"),
    "nowhere": (
        {"points": tracks()["points"] * [[[1, 1]] * 3, [[1, 1], [1, np.nan], [1, 1]]]},
        "points[1, 1]: a visible point has no position; found [0.1, nan]",
    ),
    "sizes": (
        {"video": np.array([jpeg(tracks()["video"][0][:, :width]) for width in (40, 40, 38)])},
        "frame 2: the frames of a clip",
    ),
    "complex": ({"points": tracks()["points"] * 1j}, "these are not numbers; found complex"),
    "hidden how": ({"occluded": tracks()["occluded"] * 2}, "neither visible nor occluded; found 2"),
    "text": ({"points": np.array(["x"])}, "these are not numbers"),
    # Arrays of objects in an npz are pickles, and would be run.
    "objects": ({"video": np.array([b"jpeg", None], dtype=object)}, "Its arrays must be numbers"),
}


@pytest.mark.parametrize("case", BROKEN_TRACKS)
def test_broken_tracks_are_named(case: str, tmp_path: Path, rejected: Rejected) -> None:
    changes, said = BROKEN_TRACKS[case]
    assert said in rejected(saved(tmp_path / "clips", **changes))


def test_a_file_that_cannot_be_used_is_named(tmp_path: Path, rejected: Rejected) -> None:
    np.savez(tmp_path / "part.npz", video=tracks()["video"])
    (tmp_path / "cut.npz").write_bytes((tmp_path / "part.npz").read_bytes()[:300])
    saved(tmp_path / "clips").rename(tmp_path / "clips" / "x\udcff.npz")  # a byte 0xff
    (tmp_path / "film.mp4").write_bytes(b"film")
    assert "this kind of file is not imported" in rejected(tmp_path / "film.mp4", code=2)
    for name, said in (
        ("part.npz", "no points, occluded"),
        ("cut.npz", "the npz file cannot be read"),
        ("clips", "characters that cannot be printed; found 'x\\udcff'"),
    ):
        assert said in rejected(tmp_path / name)


def test_what_is_large_once_unpacked_is_refused_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tapvid, "_MAX_UNPACKED_BYTES", 10**6)
    path = saved(tmp_path, video=np.zeros((3, 700, 700, 3), np.uint8))
    assert path.stat().st_size < 10**5
    with pytest.raises(SpecError, match=r"4\.4 MB once unpacked; at most 1\.0 MB"):
        tapvid.read_npz(path)


@pytest.mark.usefixtures("child_process")
def test_a_size_that_lies_ends_at_the_limit_of_memory(tmp_path: Path, rejected: Rejected) -> None:
    """The archive declares little, the array's header 8 TB."""
    header = np.lib.format.header_data_from_array_1_0(np.zeros(0, np.uint8))
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {**header, "shape": (2**43,)})
    with zipfile.ZipFile(tmp_path / "lie.npz", "w") as archive:
        archive.writestr("video.npy", file.getvalue())
    assert "lie.npz" in rejected(tmp_path / "lie.npz")
