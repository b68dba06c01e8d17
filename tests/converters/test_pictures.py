"""Importing annotated pictures: known marks in small files must come out where they are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal
from unicodedata import normalize

import numpy as np
import pytest
from PIL import Image

from pliant.cli.main import run
from pliant.converters.marks_csv import collect_marks
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import read_table
from pliant.spec.io.photo import photo_size
from tests.conftest import Called
from tests.converters.conftest import Rejected
from tests.converters.importing import asked, asked_and_true, imported, marked
from tests.known import known

Spelling = Literal["NFC", "NFD"]

# Three pictures of three sizes and kinds. `b.tif` is stored lying on its side: EXIF orientation 6
# says that viewers turn it by 90 degrees to the right, so that it is shown as 20 x 30.
SIZES = {"a b.JPG": (40, 30), "b.tif": (30, 20), "ç.webp": (80, 20)}


def photographs(folder: Path) -> Path:
    folder.mkdir()
    for number, (name, (width, height)) in enumerate(SIZES.items()):
        rgb = np.full((height, width, 3), 60 * number + 40, np.uint8)
        rgb[:10, :10] = 250  # the upper left as stored
        exif = Image.Exif()
        if name == "b.tif":
            exif[0x0112] = 6
        Image.fromarray(rgb).save(folder / name, exif=exif)
    return folder


CSV = """picture,point,x,y,visible
a b.JPG,ball,4.5,6,1
a b.JPG,end,39.5,29.5,1
b.tif,ball,10,30,0
b.tif,end,2.25,8,1
ç.webp,end,80,4,yes
ç.webp,ball,60,10,true
ç.webp,middle,,,0
"""
# In pixels of its own picture: frame, u, v and the same of the target, in the order of the names.
ASKED = {
    (0, 4.5, 6.0, 1, 10.0, 30.0),  # b.tif's ball is on its border, and not on that of the canvas
    (0, 4.5, 6.0, 2, 60.0, 10.0),
    (0, 39.5, 29.5, 1, 2.25, 8.0),
    (0, 39.5, 29.5, 2, 80.0, 4.0),
    (1, 2.25, 8.0, 0, 39.5, 29.5),
    (1, 2.25, 8.0, 2, 80.0, 4.0),
    (2, 60.0, 10.0, 0, 4.5, 6.0),
    (2, 60.0, 10.0, 1, 10.0, 30.0),
}


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """The three pictures with the marks of `CSV`."""
    folder = photographs(tmp_path / "photos")
    (folder / "annotations.csv").write_text(CSV)
    return folder


def test_pictures_of_three_sizes_share_a_canvas(photos: Path, tmp_path: Path) -> None:
    dataset = imported(photos, tmp_path / "out", "--licence", "", "--title", "")  # as by default
    assert dataset.info["licence"] == "LicenseRef-unknown"
    assert dataset.size == (80, 30)
    rows = asked(tmp_path / "out")
    assert {row[:-1] for row in rows} == ASKED
    assert (0, 4.5, 6.0, 2, 60.0, 10.0, "visible") in rows
    frames = [dataset.sequences[0].rgb(frame).astype(int) for frame in range(3)]
    # The turned picture's white corner is at its upper right, columns 10 to 20; black follows.
    assert abs(frames[1][:9, 11:20] - 250).max() < 3
    assert abs(frames[1][:9, :9] - 100).max() < 3
    assert frames[1][:, 20:].max() == 0
    config = dataset.info["provenance"]["config"]
    assert config["points"] == ["ball", "end", "middle"]
    assert config["pictures"][1] == {"name": "b.tif", "size": [20, 30], "placed": [20, 30]}


def test_a_picture_that_is_small_on_the_canvas_is_named(
    photos: Path, tmp_path: Path, called: Called
) -> None:
    note = "b.tif covers 0.1% of the canvas of 800x600 px"
    _, said, _ = called("import", photos, "--out", tmp_path / "alike")
    assert "canvas" not in said
    Image.new("RGB", (800, 600)).save(photos / "ç.webp")
    _, said, _ = called("import", photos, "--out", tmp_path / "out")
    assert note in said
    assert "--size WxH fits them" in said
    _, said, _ = called("import", photos, "--out", tmp_path / "fitted", "--size", "80x60")
    assert "canvas" not in said
    _, said, _ = called("import", photos, "--out", tmp_path / "strip", "--size", "800x60")
    assert "of the canvas of 800x60 px, and the rest is black." in said
    assert "--size WxH fits them" not in said


def test_a_position_beyond_all_answers_is_not_known(photos: Path, tmp_path: Path) -> None:
    """As float32 it would be infinite."""
    far = CSV.replace("b.tif,ball,10,30,0", "b.tif,ball,-1e300,30,0")
    (photos / "annotations.csv").write_text(far)
    imported(photos, tmp_path / "out")
    known = {row for row in ASKED if (row[3], *row[4:]) != (1, 10.0, 30.0)}
    assert {row[:-1] for row in asked(tmp_path / "out")} == known


def test_a_picture_is_opened_for_its_size_once_and_not_for_each_mark(
    photos: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []

    def opened_size(path: Path) -> tuple[int, int]:
        opened.append(path.name)
        return photo_size(path)

    monkeypatch.setattr("pliant.converters.annotations.photo_size", opened_size)
    collect_marks(photos / "annotations.csv").annotations()
    assert sorted(opened) == sorted(SIZES)


def test_size_scales_marks_exactly(photos: Path, tmp_path: Path) -> None:
    """By hand at 20 x 15: factors 1/2; 1/2 (20 x 30 becomes 10 x 15); 1/4 (80 x 20 is 20 x 5)."""
    dataset = imported(photos, tmp_path / "out", "--size", "20x15")
    assert dataset.size == (20, 15)
    scale = (0.5, 0.5, 0.25)
    assert {row[:-1] for row in asked(tmp_path / "out")} == {
        (a, u * scale[a], v * scale[a], b, u_b * scale[b], v_b * scale[b])
        for a, u, v, b, u_b, v_b in ASKED
    }
    placed = [entry["placed"] for entry in dataset.info["provenance"]["config"]["pictures"]]
    assert placed == [[20, 15], [10, 15], [20, 5]]


def test_a_mask_that_could_be_of_another_picture_is_refused(
    photos: Path, tmp_path: Path, rejected: Rejected
) -> None:
    """A list of polygons next to a mask is not one; two masks of one name are in doubt."""
    shown = {"a b": (40, 30), "b": (20, 30), "ç": (80, 20)}
    masks = tmp_path / "masks"
    masks.mkdir()
    for stem, size in shown.items():
        mask = Image.new("L", size, 255)
        mask.putpixel((size[0] - 1, 0), 0)
        mask.save(masks / f"{stem}.png")
        (masks / f"{stem}.txt").write_text("0 0 1 1")
    option = ("--masks", str(masks))
    imported(photos, tmp_path / "out", *option)
    mask.save(masks / "b.tif")
    several = "b.tif: a picture has several files in the folder; found b.png, b.tif"
    assert several in rejected(photos, *option, code=2)
    (masks / "b.tif").unlink()
    (photos / "b.tif").rename(photos / "a b.tif")
    (photos / "annotations.csv").write_text(CSV.replace("b.tif", "a b.tif"))
    one = "a b.png: one file in the folder is for two pictures"
    assert one in rejected(photos, *option, code=2)


@pytest.mark.parametrize(("form", "other"), [("NFC", "NFD"), ("NFD", "NFC")])
def test_names_may_be_decomposed(tmp_path: Path, form: Spelling, other: Spelling) -> None:
    """ç is one character or two, in the name of a picture, its mask and the list of pairs."""
    folder, masks, pairs = tmp_path / "photos", tmp_path / "masks", tmp_path / "pairs.csv"
    marks = [f"{name}.png,{point},5,5,1" for name in "çd" for point in "ab"]
    table = "\n".join(["picture,point,x,y,visible", *marks])
    for made in (folder, masks):
        made.mkdir()
    for name in "çd":
        noise = np.random.default_rng(ord(name)).integers(0, 255, (30, 40, 3), np.uint8)
        Image.fromarray(noise).save(folder / normalize(form, f"{name}.png"))
        Image.new("L", (40, 30), 255).save(masks / normalize(other, f"{name}.png"))
    (folder / "annotations.csv").write_text(normalize(form, table))
    pairs.write_text(normalize(other, "source,target\nd.png,ç.png\n"))
    dataset = imported(folder, tmp_path / "out", "--masks", str(masks), "--pair-list", str(pairs))
    assert dataset.sequences[0][0].mask is not None


def test_names_of_pictures_keep_their_spaces(photos: Path, tmp_path: Path) -> None:
    """As `pliant annotate` writes them; a space that a person adds to a row does not count."""
    (photos / "a b.JPG").rename(photos / " a b.JPG")
    (photos / "annotations.csv").write_text(CSV.replace("a b.JPG", " a b.JPG").replace("ç", " ç"))
    imported(photos, tmp_path / "out")
    assert {row[:-1] for row in asked(tmp_path / "out")} == ASKED


@pytest.mark.parametrize(
    "text", [CSV.replace(",1\n", ",1.0\n"), CSV + ",,,,\n,,,,,\n", normalize("NFD", CSV)]
)
def test_what_pandas_spreadsheets_and_macos_write(text: str, photos: Path, tmp_path: Path) -> None:
    (photos / "annotations.csv").write_text(text)
    imported(photos, tmp_path / "out")
    assert {row[:-1] for row in asked(tmp_path / "out")} == ASKED


def test_the_current_folder_is_imported_into_and_published(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert run(["import", str(photos), "--out", "."]) == 0
    monkeypatch.chdir(tmp_path / "here")  # the new folder of this name
    assert Dataset.open(Path()).id == "here"
    assert (tmp_path / "here-truth" / "test.parquet").is_file()
    assert run(["publish", ".", "--out", str(tmp_path / "public"), "--hold-out", "test"]) == 0
    assert run(["import", str(photos), "--out", "/"]) == 2


def test_a_list_of_pairs_is_all_that_is_asked(
    photos: Path, tmp_path: Path, rejected: Rejected
) -> None:
    (tmp_path / "pairs.csv").write_text("source,target\nç.webp,a b.JPG\n")
    option = ("--pair-list", str(tmp_path / "pairs.csv"))
    imported(photos, tmp_path / "out", *option)
    assert asked(tmp_path / "out") == {(2, 60.0, 10.0, 0, 4.5, 6.0, "visible")}
    (tmp_path / "pairs.csv").write_text("source,target\n")
    assert "pairs.csv: the list has no pairs" in rejected(photos, *option)


def test_frames_of_an_episode_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    """By hand: the point is at 4, 8 and 40 px in frames 1, 2 and 10."""
    positions = {f"frame{k}.png": {"p": (4.0 * k, 10.0)} for k in (1, 2, 10)}
    source = marked(tmp_path / "photos", positions)
    imported(source, tmp_path / "out", "--episode", "--queries", "first")
    rows = asked_and_true(tmp_path / "out")
    assert [(row[3], row[4]) for row in rows] == [(1, 8.0), (2, 40.0)]


def test_pictures_of_one_name_are_told_apart_by_their_folders(
    tmp_path: Path, rejected: Rejected
) -> None:
    source = tmp_path / "photos"
    for camera in "ab":
        marked(
            source / camera, {f"{k}.png": {"p": (10.0 * k + (camera == "b"), 5.0)} for k in (1, 2)}
        )
    rows = [f"{camera}/{k}.png,p,{10 * k + (camera == 'b')},5,1" for camera in "ab" for k in (1, 2)]
    (source / "annotations.csv").write_text("\n".join(["picture,point,x,y,visible", *rows]))
    pairs = tmp_path / "pairs.csv"
    pairs.write_text("source,target\nb/1.png,a/2.png\n")
    dataset = imported(source, tmp_path / "out", "--pair-list", str(pairs), warned="FRAME_REPEATED")
    assert asked(tmp_path / "out") == {(2, 11.0, 5.0, 1, 20.0, 5.0, "visible")}
    names = [entry["name"] for entry in dataset.info["provenance"]["config"]["pictures"]]
    assert names == ["a/1.png", "a/2.png", "b/1.png", "b/2.png"]
    pairs.write_text("source,target\n1.png,2.png\n")
    assert "found '1.png'; required: one of a/1.png, a/2.png" in rejected(
        source, "--pair-list", str(pairs)
    )


SOURCES = """picture,point,x,y,visible,source
a b.JPG,ball,4,6,1,suggested
b.tif,ball,5,7,1,confirmed
a b.JPG,end,9,9,1,confirmed
b.tif,end,8,8,1,marked
"""


def test_suggestions_are_no_truth(
    photos: Path, tmp_path: Path, rejected: Rejected, capsys: pytest.CaptureFixture[str]
) -> None:
    """The ball of the first picture is a suggestion: nothing is known of it there."""
    (photos / "annotations.csv").write_text(SOURCES)
    imported(photos, tmp_path / "out")
    assert asked(tmp_path / "out") == {
        (0, 9.0, 9.0, 1, 8.0, 8.0, "visible"),
        (1, 8.0, 8.0, 0, 9.0, 9.0, "visible"),
    }
    assert "Left out: 1 mark that" in capsys.readouterr().out
    (photos / "annotations.csv").unlink()
    assert "`pliant annotate DIR`, which writes annotations.csv" in rejected(photos)


def test_the_cloth_scripts_of_the_paper(tmp_path: Path, rejected: Rejected) -> None:
    """They write bare pixels, and the vertices under a fold as if they were seen."""
    folder = tmp_path / "cloth"
    for name in ("images", "image_masks"):
        (folder / name).mkdir(parents=True)
    for frame in (1, 30):
        Image.effect_noise((40, 30), 60).save(folder / "images" / f"{frame:06d}_rgb.png")
        drawn = Image.new("L", (40, 30))
        drawn.putpixel((7, frame - 1), 255)
        drawn.save(folder / "image_masks" / f"{frame:06d}_visible_mask.png")
    knots: dict[str, Any] = {"1": [[5, 6], [10, 20]], "30": [[7, 6], [13, 20]]}
    path = folder / "images" / "knots_info.json"
    path.write_text(json.dumps(knots))
    dataset = imported(folder, tmp_path / "out")
    assert (0, 5.0, 6.0, 1, 7.0, 6.0, "visible") in asked(tmp_path / "out")
    config = dataset.info["provenance"]["config"]
    assert config["not_said"] == ["which points are hidden"]
    mask = known(dataset.sequences[0][1].mask)
    assert np.argwhere(mask).tolist() == [[29, 7]]
    path.write_text(json.dumps({"1234": [0.1, 0.2, 0.3]}))
    assert "from which the frames cannot be recovered" in rejected(folder)


def test_masks_and_depth_are_kept(photos: Path, tmp_path: Path, rejected: Rejected) -> None:
    """Each is of the size of its picture; a resized one takes the nearest value, by hand here."""
    masks, depths = tmp_path / "masks", tmp_path / "depth"
    masks.mkdir()
    depths.mkdir()
    shown = {"a b": (40, 30), "b": (20, 30), "ç": (80, 20)}
    for stem, (width, height) in shown.items():
        mask = np.zeros((height, width), np.uint8)
        mask[: height // 2, : width // 4] = 255
        Image.fromarray(mask).save(masks / f"{stem}.png")
        depth_m = np.full((height, width), 0.5, np.float32)
        depth_m[0, 0] = 0
        np.save(depths / f"{stem}.npy", depth_m)
    Image.fromarray(np.full((20, 80), 1500, np.uint16)).save(depths / "ç.png")
    (depths / "ç.npy").unlink()
    options = ["--masks", str(masks), "--depth", str(depths), "--size", "40x30", "--kind", "bag"]
    dataset = imported(photos, tmp_path / "out", *options)
    assert dataset.tiers["out"].kind == "bag"
    assert "depth" not in dataset.info["provenance"]["config"]["unknown"]
    first, wide = dataset.sequences[0][0], dataset.sequences[0][2]
    assert first.surface is None
    depth_m, wide_depth_m = (np.full((30, 40), far, np.float32) for far in (0.5, np.inf))
    depth_m[0, 0] = np.inf
    wide_depth_m[:10] = 1.5  # 80 x 20 becomes 40 x 10
    for frame, mask_rows, expected_m in ((first, 15, depth_m), (wide, 5, wide_depth_m)):
        expected = np.zeros((30, 40), bool)
        expected[:mask_rows, :10] = True
        np.testing.assert_array_equal(np.asarray(frame.mask), expected)
        np.testing.assert_array_equal(np.asarray(frame.depth_m), expected_m)
    done = tmp_path / "centroid.parquet"
    assert run(["predict", "centroid", "--data", str(tmp_path / "out"), "--out", str(done)]) == 0
    answer = read_table(done, "answers").to_pylist()[0]
    assert (answer["u"], answer["v"]) != (20.0, 15.0)  # the mask's middle, not the picture's
    (masks / "b.png").unlink()
    assert "a picture has no file in the folder" in rejected(photos, *options, code=2)


def test_the_ball_in_a_mask_is_not_the_rope(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A strand 6 px thick with a disc of radius 9 px at its end."""
    rows, columns = np.mgrid[:60, :160]
    strand = (abs(rows - 30) <= 3) & (columns > 20) & (columns < 150)
    ball = np.hypot(rows - 30, columns - 20) <= 9
    for name, mask in {"masks": strand | ball, "photos": strand}.items():
        (tmp_path / name).mkdir()
        for number, picture in enumerate(("a.png", "b.png")):
            grey = (mask * np.uint8(250 - number)).astype(np.uint8)
            Image.fromarray(grey).save(tmp_path / name / picture)
    marks = "".join(f"{name}.png,end,149,30,1\n" for name in "ab")
    (tmp_path / "photos/annotations.csv").write_text("picture,point,x,y,visible\n" + marks)
    options = ["--masks", str(tmp_path / "masks")]
    frame = imported(tmp_path / "photos", tmp_path / "out", *options).sequences[0][0]
    ids = frame.object_ids
    assert ids is not None
    rope = known(frame.mask)
    assert (ids > 0).sum() == (strand | ball).sum()
    assert (rope & ball).sum() <= 40  # the strand's own end in it
    assert (rope & ~ball).sum() >= 0.97 * (strand & ~ball).sum()
    assert "separated from the masks of 2 of 2 frames" in capsys.readouterr().out


def test_masks_that_miss_the_marks_are_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An inverted mask is a mask, so the marks tell: a pixel outside of its edge is still on it."""
    marks = {"a.png": {"end": (20.5, 30.5)}, "b.png": {"end": (50.5, 40.5)}}
    source = marked(tmp_path / "source", marks)
    for out, reach in (("near", 1), ("off", 2)):
        for name, points in marks.items():
            mask = np.full((60, 80), 255, np.uint8)
            u, v = map(int, points["end"])
            mask[v - reach + 1 : v + reach, u - reach + 1 : u + reach] = 0
            Image.fromarray(mask).save(source / "masks" / name)
        imported(source, tmp_path / out, "--masks", str(source / "masks"), "--kind", "cloth")
        said = "2 of 2 visible points are not on the masks" in capsys.readouterr().out
        assert said == (out == "off")
