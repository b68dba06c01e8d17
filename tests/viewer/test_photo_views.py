"""Photographs, their masks and depth, as methods see them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pliant.baselines.views import read_frame
from pliant.spec.errors import PliantError
from pliant.spec.io.photo import read_mask, read_photo
from pliant.viewer.photo_views import PhotoFiles, object_on_one_colour, read_photo_view
from tests.known import known


def test_pictures_of_many_kinds_are_read(tmp_path: Path) -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (6, 9, 3)).astype(np.uint8)
    grey16 = (rgb[..., 0].astype(np.uint16) << 8) + 7
    alpha = np.dstack([rgb, np.where(np.arange(9) < 4, 0, 255)[None].repeat(6, 0)])
    grey, exif = np.repeat(rgb[..., :1], 3, axis=2), Image.Exif()
    exif[0x0112] = 6  # to be turned by 90 degrees
    for name, stored, shown in (
        ("plain.png", rgb, rgb),
        ("turned.png", rgb, np.rot90(rgb, -1, axes=(0, 1))),
        ("grey.png", rgb[..., 0], grey),
        ("grey16.png", grey16, grey),
        ("grey32.tif", rgb[..., 0].astype(np.int32), grey),
        ("alpha.png", alpha.astype(np.uint8), np.where(np.arange(9)[:, None] < 4, 0, rgb)),
    ):
        own = exif if name == "turned.png" else Image.Exif()
        Image.fromarray(stored).save(tmp_path / name, exif=own)
        np.testing.assert_array_equal(read_photo(tmp_path / name), shown, name)
    Image.fromarray(rgb).quantize(256).save(tmp_path / "colours.gif")
    assert read_photo(tmp_path / "colours.gif").shape == (6, 9, 3)
    damaged = tmp_path / "damaged.jpg"  # the EXIF data says more than there is: Pillow warns
    Image.fromarray(rgb).save(damaged, exif=b"Exif\0\0II*\0\x08\0\0\0\x07\0")
    assert read_photo(damaged).shape == rgb.shape
    areas = rgb.repeat(2, 0).repeat(2, 1).reshape(4, 3, 6, 3, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(read_photo(tmp_path / "plain.png", 6), areas, atol=0.5)


@pytest.mark.parametrize(("dtype", "said"), [("f4", "floating-point"), ("i4", "exceed 16 bits")])
def test_numbers_that_no_picture_has_are_refused(dtype: str, said: str, tmp_path: Path) -> None:
    values = np.linspace(0, 1 if dtype == "f4" else 70000, 54).reshape(6, 9).astype(dtype)
    Image.fromarray(values).save(tmp_path / "values.tif")
    with pytest.raises(PliantError, match=rf"values\.tif.*{said}.*8 or 16 bits"):
        read_photo(tmp_path / "values.tif")


def drawn(
    path: Path, pixels: dict[tuple[int, int], Any], ground: Any = 0, dtype: Any = "u1"
) -> Any:
    """Write a picture of 9x6 px, `ground` but for some (row, column), and return its values."""
    values = np.full((6, 9), ground, "u1" if dtype == "RGB" else dtype)
    for at, value in pixels.items():
        values[at] = value
    picture = Image.fromarray(values)
    (picture.convert("RGB") if dtype == "RGB" else picture).save(path)
    return values


DARK = {(2, 1): 1, (2, 2): 2, (2, 3): 64}
NOISE = {(4, column): 1 + column for column in range(9)}
MASKS: dict[str, tuple[Any, dict[tuple[int, int], Any], list[list[int]]]] = {
    **{f"of labels, {dtype}": (dtype, {(2, 3): 1, (3, 3): 2}, [[2, 3], [3, 3]])
       for dtype in ("u1", "u2", "i4", "f4")},
    "of truth values": ("?", {(2, 3): True, (3, 3): True}, [[2, 3], [3, 3]]),
    "10 is still black in a drawing": ("RGB", {(2, 3): 10, (3, 3): 11}, [[3, 3]]),
    # Labels beyond 10 do not make the smaller ones black; a brighter drawing has black noise.
    **{f"labels to {most}": ("u1", DARK | {(2, 3): most}, [[2, 1], [2, 2], [2, 3]])
       for most in (3, 12, 64)},
    "brighter than labels": ("u1", DARK | NOISE | {(2, 3): 65}, [[2, 3]]),
    "labels of 16 bits": ("u2", {(2, 1): 1, (2, 2): 300, (2, 3): 26001}, [[2, 1], [2, 2], [2, 3]]),
    "NaN is outside": ("f4", {(0, 0): np.nan, (2, 3): 0.5}, [[2, 3]]),
}  # fmt: skip


@pytest.mark.parametrize("name", MASKS)
def test_masks(name: str, tmp_path: Path) -> None:
    dtype, pixels, on = MASKS[name]
    drawn(tmp_path / "mask.tif", pixels, dtype=dtype)
    assert np.argwhere(read_mask(tmp_path / "mask.tif", (9, 6))).tolist() == on


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float32])
def test_a_mask_without_black_is_of_one_value(dtype: Any, tmp_path: Path) -> None:
    """An object may fill its picture; two labels without 0 do not say what is outside."""
    path = tmp_path / "mask.tif"
    for value in (255, 1):
        drawn(path, {}, value, dtype)
        assert read_mask(path, (9, 6)).all()
    drawn(path, {(2, 3): 2, (3, 3): 2}, 1, dtype)
    with pytest.raises(PliantError, match="no black pixel"):
        read_mask(path, (9, 6))


def test_masks_that_are_refused(tmp_path: Path) -> None:
    """With exit code 1: the data is wrong, not the call."""
    Image.new("RGB", (9, 6), "red").save(tmp_path / "picture.png")
    mask = tmp_path / "mask.png"
    for write, said in (
        (lambda: Image.new("L", (9, 7), 255).save(mask), "found 9x7; required: 9x6"),
        (lambda: drawn(mask, {}), "black everywhere"),
        (lambda: drawn(mask, {(2, 3): 255}, 90), "no black pixel"),
        (lambda: Image.new("RGB", (9, 6), (2, 2, 2)).save(mask), "black everywhere"),  # no labels
    ):
        write()
        with pytest.raises(PliantError, match=said) as refused:
            read_frame(tmp_path / "picture.png", mask)
        assert refused.value.exit_code == 1


@pytest.mark.parametrize("values", [(1, 255), (5, 255), (1, 2, 200), (1, 65535)])
def test_dark_labels_next_to_bright_values_are_refused(
    values: tuple[int, ...], tmp_path: Path
) -> None:
    """A void rim of 255 would be the object, and the object of label 1 would be outside."""
    path, dtype = tmp_path / "mask.png", np.uint8 if max(values) < 256 else np.uint16
    pixels = {(1, k): values[0] for k in range(9)} | {(2, k): each for k, each in enumerate(values)}
    drawn(path, pixels, dtype=dtype)
    with pytest.raises(PliantError, match=r"found the values 0, .*required: 0 outside") as refused:
        read_mask(path, (9, 6))
    assert refused.value.exit_code == 1
    # More than the dark pixels, which are then traces of an edge.
    wide = pixels | {(row, k): max(values) for row in (3, 4) for k in range(9)}
    bright = drawn(path, wide, dtype=dtype) == max(values)
    found = read_mask(path, (9, 6))
    assert (found >= bright).all()
    assert not found[0].any()


def test_every_label_of_a_grey_palette_counts(tmp_path: Path) -> None:
    """As Pillow writes labels of mode `P`; in a palette of colours, black is outside."""
    labels = np.zeros((6, 9), np.uint8)
    labels[2, 1:3] = 1, 30
    for palette, found in (("grey", [[2, 1], [2, 2]]), ("colours", [[2, 2]])):
        picture = Image.fromarray(labels)
        third = 1 if palette == "grey" else 3
        picture.putpalette([i for k in range(256) for i in (k, k, min(third * k, 255))])
        picture.save(tmp_path / "mask.png")
        assert np.argwhere(read_mask(tmp_path / "mask.png", (9, 6))).tolist() == found


def test_the_rings_of_a_jpeg_are_not_in_its_mask(tmp_path: Path) -> None:
    rows, columns = np.mgrid[:60, :90]
    strand = np.abs(rows - 30 - 12 * np.sin(columns / 9)) < 3
    options: dict[str, dict[str, Any]] = {
        "mask.jpg": {"quality": 40},
        "mask.webp": {"quality": 40},
        "mask.jp2": {"irreversible": True, "quality_layers": [6]},
    }
    for name, each in options.items():
        Image.fromarray(strand).convert("L").save(tmp_path / name, **each)
        assert np.count_nonzero(read_mask(tmp_path / name, (90, 60)) != strand) <= 2
    shaded = np.where(strand, 40 + columns, 0).astype(np.uint8)  # a picture on black: no mask
    Image.fromarray(shaded).save(tmp_path / "shaded.jpg", quality=95)
    assert (read_mask(tmp_path / "shaded.jpg", (90, 60)) >= strand).all()


def test_what_a_method_caches_is_of_the_contents_of_the_files(tmp_path: Path) -> None:
    """Of a camera's last picture, which is always the same file, or of one with another mask."""
    paths = [tmp_path / name for name in ("picture.png", "mask.png", "depth.png")]

    def key(path: Path | None = None, values: Any = 9) -> str:
        for each, value in zip(paths, (9, 255, 500), strict=True):
            kept = np.full(
                (6, 9), values if each == path else value, np.uint16 if value > 255 else np.uint8
            )
            Image.fromarray(kept).save(each)
        return read_frame(paths[0], paths[1], paths[2]).cache_key

    assert key() == key()
    assert len({key(), key(paths[0], 8), key(paths[2], 501)}) == 3
    assert read_frame(paths[0]).cache_key != read_frame(paths[0], paths[1]).cache_key
    shapes = set()  # of pictures whose pixels are the same in another shape
    for size in ((6, 9), (9, 6)):
        Image.new("RGB", size).save(paths[0])
        shapes.add(read_frame(paths[0]).cache_key)
    assert len(shapes) == 2


def test_an_inverted_mask_is_reported(tmp_path: Path) -> None:
    Image.new("RGB", (40, 30), "red").save(tmp_path / "picture.png")
    mask = np.zeros((30, 40), np.uint8)
    mask[5:, 15:25] = 255  # leaves the picture on one side
    for values, notes in ((mask, 0), (255 - mask, 1)):
        Image.fromarray(values).save(tmp_path / "mask.png")
        files = PhotoFiles(tmp_path / "picture.png", tmp_path / "mask.png")
        assert len(read_photo_view(files).notes) == notes


def rope_on(colour: tuple[int, int, int], noise: int = 0) -> tuple[Any, Any, Any]:
    """Return a picture of a blue strand with a red disc at its end, and where both are."""
    rows, columns = np.mgrid[:120, :240]
    strand = (abs(rows - 60 - 20 * np.sin(columns / 30)) <= 4) & (abs(columns - 120) < 90)
    ball = np.hypot(rows - 60 - 20 * np.sin(1), columns - 30) <= 11
    rgb = np.empty((120, 240, 3), np.int16)
    rgb[:] = colour
    rgb += np.random.default_rng(0).integers(-noise, noise + 1, rgb.shape, np.int16)
    rgb[strand], rgb[ball] = (60, 90, 200), (200, 60, 60)
    return rgb.clip(0, 255).astype(np.uint8), strand & ~ball, ball


@pytest.mark.parametrize("colour", [(0, 0, 0), (255, 255, 255), (30, 120, 60)])
def test_a_background_of_one_colour_is_a_mask(colour: tuple[int, int, int], tmp_path: Path) -> None:
    rgb, strand, ball = rope_on(colour)
    path = tmp_path / "rope.jpg"
    Image.fromarray(rgb).save(path, quality=95)
    photo = read_photo_view(PhotoFiles(path), asked_px=[(150.5, 60.5 + 20 * np.sin(5))])
    rope = known(photo.view.mask)
    assert np.mean(known(photo.view.objects) != (strand | ball)) < 0.02
    assert (rope & strand).sum() > 0.97 * strand.sum()
    assert (rope & ball).sum() < 0.1 * ball.sum()
    assert ["one colour" in photo.notes[0], "ball" in photo.notes[1]] == [True, True]
    bare, _, disc = rope_on(colour)
    bare[disc] = colour
    Image.fromarray(bare).save(tmp_path / "bare.png")
    alone = read_photo_view(PhotoFiles(tmp_path / "bare.png")).view
    np.testing.assert_array_equal(known(alone.objects), known(alone.mask))  # only the rope
    missed = read_photo_view(PhotoFiles(path), asked_px=[(3, 3)]).view
    assert missed.mask is None  # what is asked about is no part of it


@pytest.mark.parametrize("quality", [95, 60])
def test_the_background_in_a_loop_is_no_object(quality: int, tmp_path: Path) -> None:
    """JPEG changes its colour near the rope; a dark place of the rope has another colour."""
    rows, columns = np.mgrid[:120, :240]
    away = np.hypot(rows - 60, columns - 120)
    rope = abs(away - 30) <= 6
    rgb = np.full((120, 240, 3), 255, np.uint8)
    rgb[rope] = (60, 90, 200)
    path = tmp_path / "loop.jpg"
    Image.fromarray(rgb).save(path, quality=quality)
    found = known(object_on_one_colour(np.asarray(Image.open(path))))
    assert (found & (away < 20)).sum() < 0.01 * found.sum()
    rgb[away < 3 * 6] = (60, 90, 200)
    rgb[away < 2 * 6] = (245, 245, 245)  # a bright place in the middle of a disc
    whole = known(object_on_one_colour(rgb))
    assert whole[away < 2 * 6].all()


def test_other_backgrounds_give_no_mask(tmp_path: Path) -> None:
    rgb, *_ = rope_on((120, 120, 120), noise=4)  # a table: its shadows would be taken for rope
    empty = np.full((60, 80, 3), 200, np.uint8)
    halves = empty.copy()
    halves[:30] = 90
    for number, picture in enumerate((rgb, empty, halves)):
        path = tmp_path / f"{number}.png"
        Image.fromarray(picture).save(path)
        assert read_photo_view(PhotoFiles(path)).view.mask is None


def test_depth_reaches_the_method(tmp_path: Path) -> None:
    Image.new("RGB", (40, 20), "red").save(tmp_path / "a.png")
    depth_mm = np.full((20, 40), 1250, np.uint16)
    depth_mm[0] = 0
    Image.fromarray(depth_mm).save(tmp_path / "depth.png")
    view = read_frame(tmp_path / "a.png", depth=tmp_path / "depth.png", max_side=20)
    assert view.rgb.shape == (10, 20, 3)
    assert (known(view.depth_m) == 1.25).all()  # every second row: the first one is left out
    whole = known(read_frame(tmp_path / "a.png", depth=tmp_path / "depth.png").depth_m)
    assert np.isinf(whole[0]).all()
    Image.new("L", (40, 20), 3).save(tmp_path / "eight.png")
    with pytest.raises(PliantError, match="depth of 8 bits has no unit"):
        read_frame(tmp_path / "a.png", depth=tmp_path / "eight.png")
    for value, said in [
        (800, "found a median of 800.*divide it by 1000"),
        (0, "unknown everywhere"),
    ]:
        np.save(tmp_path / "depth.npy", np.full((20, 40), value, np.float32))
        with pytest.raises(PliantError, match=said):
            read_frame(tmp_path / "a.png", depth=tmp_path / "depth.npy")
    (tmp_path / "depth.npy").write_bytes((tmp_path / "depth.npy").read_bytes()[:100])
    with pytest.raises(PliantError, match=r"depth\.npy: the depth image cannot be read \(EOF"):
        read_frame(tmp_path / "a.png", depth=tmp_path / "depth.npy")
    with pytest.raises(PliantError, match=r"depth\.npy: the mask cannot be read"):
        read_frame(tmp_path / "a.png", mask=tmp_path / "depth.npy")
