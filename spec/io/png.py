"""Colour images: 8-bit sRGB PNG, written without metadata so that equal pixels give equal bytes."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.spec.io import limits
from pliant.spec.io.reading import AnyFile, FileRefusedError, read_bytes

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_UP_FILTER = 2
_HEADER_BYTES = 33
_GREY, _RGB = 0, 2
"""PNG's numbers of colour types."""

_REMARKS = {
    b"tRNS": "a tRNS chunk makes one colour transparent",
    b"gAMA": "a gAMA chunk states a transfer curve, which some programs apply",
    b"iCCP": "an iCCP chunk states a colour space, which some programs apply",
}
"""Kind of a chunk -> why it is remarked."""


def write_rgb(path: Path | str, rgb: npt.NDArray[np.uint8], *, level: int = 1) -> None:
    """Write a colour image.

    Every row carries the `Up` filter: with zlib's level 1 that is two and a half times as
    fast as a search over the filters and as small.

    Args:
        path: Where to; replaced if it exists.
        rgb: uint8 (H, W, 3), sRGB.
        level: zlib level, 0 to 9.

    Raises:
        ValueError: The array is not uint8 (H, W, 3), or is empty or too large.
    """
    if rgb.dtype != np.uint8 or rgb.shape[2:] != (3,):
        raise ValueError(f"rgb must be uint8 (H, W, 3), not {rgb.dtype} {rgb.shape}")
    _write(path, rgb, _RGB, level)


def write_mask(path: Path | str, object_ids: npt.NDArray[np.uint8]) -> None:
    """Write a mask: an object id for each pixel, 0 for none; arguments as `write_rgb`.

    Raises:
        ValueError: The array is not uint8 (H, W), or is empty or too large.
    """
    if object_ids.dtype != np.uint8 or object_ids.ndim != 2:
        raise ValueError(f"a mask must be uint8 (H, W), not {object_ids.dtype} {object_ids.shape}")
    _write(path, object_ids[..., None], _GREY, level=6)


def _write(path: Path | str, pixels: npt.NDArray[np.uint8], colour_type: int, level: int) -> None:
    """Write uint8 (H, W, channels)."""
    height, width, channels = pixels.shape
    if not (0 < width <= limits.MAX_IMAGE_SIDE_PX and 0 < height <= limits.MAX_IMAGE_SIDE_PX):
        raise ValueError(f"an image of {width} x {height} pixels cannot be written")
    rows = np.ascontiguousarray(pixels).reshape(height, width * channels)
    filtered = np.empty((height, width * channels + 1), np.uint8)
    filtered[:, 0] = _UP_FILTER
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
    header = struct.pack(">IIBBBBB", width, height, 8, colour_type, 0, 0, 0)
    with open(path, "wb") as stream:
        stream.write(PNG_SIGNATURE)
        for kind, payload in (
            (b"IHDR", header),
            *([(b"sRGB", b"\x00")] if colour_type == _RGB else []),
            (b"IDAT", zlib.compress(filtered.data, level)),
            (b"IEND", b""),
        ):
            stream.write(struct.pack(">I", len(payload)) + kind + payload)
            stream.write(struct.pack(">I", zlib.crc32(payload, zlib.crc32(kind))))


def png_size(head: bytes, path: AnyFile, colour_type: int = _RGB) -> tuple[int, int]:
    """Return (width, height) from a PNG's first 33 bytes, refusing other kinds of PNG.

    Args:
        head: The first bytes of the file.
        path: The file, for messages.
        colour_type: PNG's number of the colour type required.

    Raises:
        FileRefusedError: No PNG, or not 8-bit of this type without interlacing, or too large.
    """
    if len(head) < _HEADER_BYTES or head[:8] != PNG_SIGNATURE or head[12:16] != b"IHDR":
        raise FileRefusedError("FILE_UNREADABLE", "this is not a PNG file", path=path)
    width, height, depth, colour, _, _, interlace = struct.unpack(">IIBBBBB", head[16:29])
    if (depth, colour, interlace) != (8, colour_type, 0):
        raise FileRefusedError(
            "IMAGE_FORMAT",
            "the PNG is of another kind",
            path=path,
            found=f"bit depth {depth}, colour type {colour}, interlace {interlace}",
            required=f"8-bit {'RGB' if colour_type == _RGB else 'grey'} (colour type "
            f"{colour_type}), not interlaced",
        )
    refuse_large(width, height, path)
    return width, height


def png_chunks(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Yield the kind of each chunk of a PNG file, and its first byte and the one after its last.

    The walk ends with the IEND chunk, or where the file has none, at its end.
    """
    at, kind = len(PNG_SIGNATURE), b""
    while at + 12 <= len(data) and kind != b"IEND":
        start, kind = at, data[at + 4 : at + 8]
        at += int.from_bytes(data[at : at + 4], "big") + 12
        yield kind, start, at


def png_remarks(data: bytes) -> list[str]:
    """Return what other readers may understand in another way: colour chunks, a missing end.

    Args:
        data: A PNG file that can be decoded.
    """
    ends = {kind: end for kind, _, end in png_chunks(data)}
    found = [text for kind, text in _REMARKS.items() if kind in ends]
    if b"IEND" not in ends:
        found.append("it has no IEND chunk: truncated?")
    elif ends[b"IEND"] != len(data):
        found.append("bytes follow its IEND chunk")
    return found


def refuse_large(width: int, height: int, path: AnyFile) -> None:
    """Refuse an image whose header announces more pixels than the limits allow.

    Raises:
        FileRefusedError: Too large, or empty.
    """
    if not (0 < width <= limits.MAX_IMAGE_SIDE_PX and 0 < height <= limits.MAX_IMAGE_SIDE_PX) or (
        width * height > limits.MAX_IMAGE_PIXELS
    ):
        raise FileRefusedError(
            "FILE_TOO_LARGE",
            "the image's header announces a size outside the limits",
            path=path,
            found=f"{width} x {height} pixels",
            required=f"sides of 1 to {limits.MAX_IMAGE_SIDE_PX}, "
            f"at most {limits.MAX_IMAGE_PIXELS} pixels",
        )


def read_rgb(path: AnyFile, *, size: tuple[int, int] | None = None) -> npt.NDArray[np.uint8]:
    """Read a colour image.

    Args:
        path: The PNG file.
        size: (width, height) it must have, or None for any within the limits.

    Returns:
        uint8 (H, W, 3), sRGB.

    Raises:
        FileRefusedError: Missing, no 8-bit RGB PNG, of another size, too large or damaged.
    """
    return _read(path, size, _RGB)


def read_mask(path: AnyFile, *, size: tuple[int, int] | None = None) -> npt.NDArray[np.uint8]:
    """Read a mask, uint8 (H, W) of object ids; arguments and errors as `read_rgb`."""
    return _read(path, size, _GREY)


def _read(path: AnyFile, size: tuple[int, int] | None, colour_type: int) -> npt.NDArray[np.uint8]:
    data = read_bytes(path, limits.MAX_IMAGE_FILE_BYTES)
    found = png_size(data[:_HEADER_BYTES], path, colour_type)
    require_size(found, size, path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            image = Image.open(io.BytesIO(data), formats=["PNG"])
            pixels = np.asarray(image)
    except Exception as error:  # Pillow raises whatever its decoder met
        raise FileRefusedError(
            "FILE_UNREADABLE", "the PNG cannot be decoded", path=path, found=str(error)
        ) from error
    shape = (found[1], found[0], *((3,) if colour_type == _RGB else ()))
    if pixels.dtype != np.uint8 or pixels.shape != shape:
        raise FileRefusedError(
            "IMAGE_FORMAT", "the PNG's pixels are not as announced", path=path, found=pixels.shape
        )
    return pixels


def require_size(found: tuple[int, int], size: tuple[int, int] | None, path: AnyFile) -> None:
    """Refuse an image of another size than (width, height).

    Raises:
        FileRefusedError: The sizes differ.
    """
    if size is not None and found != size:
        raise FileRefusedError(
            "IMAGE_SIZE_DIFFERS",
            "the image's size is not the dataset's",
            path=path,
            found=f"{found[0]} x {found[1]}",
            required=f"{size[0]} x {size[1]}",
        )
