"""Colour and surface images: exact round trips, equal bytes, and refusals before decoding."""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from pliant.spec.io.exr import Surface, read_header, read_surface, write_surface
from pliant.spec.io.exr_chunks import check_chunks
from pliant.spec.io.png import read_rgb, write_rgb
from pliant.spec.io.reading import FileRefusedError


def surface(height: int = 6, width: int = 9) -> Surface:
    rng = np.random.default_rng(0)
    object_id = rng.integers(0, 3, (height, width)).astype(np.uint32)
    depth = rng.uniform(0.3, 2, (height, width)).astype(np.float32)
    depth[object_id == 0] = np.inf
    m = rng.uniform(-3, 3, (2, height, width)).astype(np.float32)
    return Surface(depth, m[0], m[1], object_id)


def picture(height: int = 7, width: int = 5) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (height, width, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    ("rgb", "level"),
    [(picture(), 0), (picture(), 1), (picture(), 9), (picture(8, 10)[::2, ::-1], 1)],
    ids=["0", "1", "9", "slice"],
)
def test_rgb_round_trip_is_exact(tmp_path: Path, rgb: np.ndarray, level: int) -> None:
    write_rgb(tmp_path / "a.png", rgb, level=level)
    assert np.array_equal(read_rgb(tmp_path / "a.png"), rgb)
    # An independent decoder sees the same pixels and no metadata that would change them.
    with Image.open(tmp_path / "a.png") as image:
        assert image.mode == "RGB"
        assert np.array_equal(np.asarray(image), rgb)


def test_equal_arrays_give_equal_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_rgb(tmp_path / f"{name}.png", picture())
        write_surface(tmp_path / f"{name}.exr", surface())
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_surface_round_trip_is_exact(tmp_path: Path) -> None:
    written = surface()
    write_surface(tmp_path / "a.exr", written)
    found = read_surface(tmp_path / "a.exr", size=(9, 6))
    for name in ("depth_m", "m0", "m1", "object_id"):
        expected = getattr(written, name)
        assert getattr(found, name).dtype == expected.dtype
        assert np.array_equal(getattr(found, name), expected)
    found.depth_m[0, 0] = 1  # a reader's own copy


def test_a_table_of_chunks_that_could_not_be_written_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenEXR leaves the space for it empty then, and says nothing."""

    class Failing(OpenEXR.File):
        def write(self, path: str) -> None:
            super().write(path)
            table = read_header(path).size
            data = Path(path).read_bytes()
            Path(path).write_bytes(data[:table] + bytes(8) + data[table + 8 :])

    monkeypatch.setattr(OpenEXR, "File", Failing)
    with pytest.raises(OSError, match=r"a\.exr"):
        write_surface(tmp_path / "a.exr", surface())


def test_writers_refuse_wrong_arrays(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="uint8"):
        write_rgb(tmp_path / "a.png", np.zeros((4, 4, 3), np.float32))
    good = surface()
    with pytest.raises(ValueError, match=r"surface\.m0 must be float32"):
        write_surface(
            tmp_path / "a.exr",
            Surface(good.depth_m, good.m0.astype(np.float64), good.m1, good.object_id),
        )
    assert not list(tmp_path.iterdir())


def channels_of(s: Surface) -> dict[str, Any]:
    return {
        "Z": s.depth_m,
        "surface.m0": s.m0,
        "surface.m1": s.m1,
        "surface.object": s.object_id,
    }


def write_exr(path: Path, channels: dict[str, Any], compression: str = "ZIP") -> None:
    kind = getattr(OpenEXR, f"{compression}_COMPRESSION")
    header = {"compression": kind, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


def refusal(path: Path) -> str:
    read = read_rgb if path.suffix == ".png" else read_surface
    with pytest.raises(FileRefusedError) as caught:
        read(path)
    assert str(path) in str(caught.value)
    return caught.value.code


@pytest.mark.parametrize("mode", ["L", "RGBA", "P", "I;16", "1"])
def test_other_kinds_of_png_are_refused(tmp_path: Path, mode: str) -> None:
    Image.new(mode, (4, 3)).save(tmp_path / "a.png")
    assert refusal(tmp_path / "a.png") == "IMAGE_FORMAT"


@pytest.mark.parametrize("corners", [(0, 0, 99_999, 99_999), (10, 10, 0, 0)])
def test_exr_that_claims_too_much_is_refused_by_its_header(
    tmp_path: Path, corners: tuple[int, ...]
) -> None:
    write_surface(tmp_path / "a.exr", surface())
    data = (tmp_path / "a.exr").read_bytes()
    window = struct.pack("<4i", 0, 0, 8, 5)
    assert data.count(window) == 2
    (tmp_path / "a.exr").write_bytes(data.replace(window, struct.pack("<4i", *corners)))
    assert refusal(tmp_path / "a.exr") == "FILE_TOO_LARGE"


@pytest.mark.parametrize("keep", [0, 3, 8, 60, 400])
def test_truncated_images_are_refused(tmp_path: Path, keep: int) -> None:
    write_surface(tmp_path / "a.exr", surface(60, 80))
    write_rgb(tmp_path / "a.png", picture(60, 80))
    for name in ("a.exr", "a.png"):
        path = tmp_path / name
        path.write_bytes(path.read_bytes()[:keep])
        assert refusal(path) in ("FILE_UNREADABLE", "IMAGE_FORMAT")


@pytest.mark.parametrize("compression", ["NO", "ZIP", "ZIPS"])
def test_every_compression_allowed_is_read_and_its_chunks_are_checked(
    tmp_path: Path, compression: str
) -> None:
    s, path = surface(37, 20), tmp_path / "a.exr"
    write_exr(path, channels_of(s), compression)
    assert np.array_equal(read_surface(path).m0, s.m0)
    data, head = path.read_bytes(), read_header(path)
    check_chunks(data, head.size, head.compression, 37, 4 * 4 * 20, inflate=True)
    for end in range(head.size, len(data)):
        with pytest.raises(ValueError, match="chunk"):
            check_chunks(data[:end], head.size, head.compression, 37, 320, inflate=False)


@pytest.mark.parametrize("compression", ["RLE", "PIZ", "DWAA", "B44", "PXR24"])
def test_other_compressions_are_refused(tmp_path: Path, compression: str) -> None:
    write_exr(tmp_path / "a.exr", channels_of(surface(40, 40)), compression)
    assert refusal(tmp_path / "a.exr") == "IMAGE_FORMAT"


@pytest.mark.parametrize("name", ["Z", "surface.object", "extra"])
def test_channels_must_be_exactly_the_four(tmp_path: Path, name: str) -> None:
    channels = channels_of(surface())
    if channels.pop(name, None) is None:
        channels[name] = surface().depth_m
    write_exr(tmp_path / "a.exr", channels)
    assert refusal(tmp_path / "a.exr") == "IMAGE_FORMAT"


def test_channels_of_another_type_are_named(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", channels_of(surface()) | {"Z": np.ones((6, 9), np.float16)})
    with pytest.raises(FileRefusedError, match=r"found Z \(HALF\), surface.m0 \(FLOAT\), "):
        read_surface(tmp_path / "a.exr")


def test_several_parts_and_tiles_are_refused(tmp_path: Path) -> None:
    parts = [OpenEXR.Part({}, {"Z": surface().depth_m}, name) for name in ("a", "b")]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    assert refusal(tmp_path / "a.exr") == "IMAGE_FORMAT"


def test_damaged_pixels_raise_and_print_nothing_on_stdout(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write_surface(tmp_path / "a.exr", surface(60, 80))
    data = bytearray((tmp_path / "a.exr").read_bytes())
    data[len(data) // 2] ^= 255
    (tmp_path / "a.exr").write_bytes(data)
    assert refusal(tmp_path / "a.exr") == "FILE_UNREADABLE"
    assert capfd.readouterr().out == ""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_damaged_pixels_keep_no_memory(tmp_path: Path) -> None:
    """OpenEXR keeps 4 MB each time it fails to decode such a picture: it may fail once."""
    path = tmp_path / "a.exr"
    write_surface(path, Surface(*(np.zeros((512, 512), kind) for kind in "fffI")))
    whole = path.read_bytes()

    def resident_mb() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6

    before = resident_mb()
    for damage in range(30):
        data = bytearray(whole[: len(whole) // 2] if damage % 2 else whole)
        data[-9] ^= 255
        path.write_bytes(data)
        assert refusal(path) == "FILE_UNREADABLE"
    assert resident_mb() - before < 30
