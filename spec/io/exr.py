"""Depth and surface images: single-part OpenEXR, its header checked before anything is decoded."""

from __future__ import annotations

import errno
import io
import os
import struct
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import OpenEXR

from pliant.spec.io import limits
from pliant.spec.io.exr_chunks import check_chunks
from pliant.spec.io.png import refuse_large, require_size
from pliant.spec.io.reading import (
    AnyFile,
    Blob,
    FileRefusedError,
    check_regular,
    open_binary,
    read_bytes,
)

_KINDS: Final = {0: "UINT", 1: "HALF", 2: "FLOAT"}

CHANNELS: Final[dict[str, tuple[str, int]]] = {
    "Z": ("FLOAT", 2),
    "surface.m0": ("FLOAT", 2),
    "surface.m1": ("FLOAT", 2),
    "surface.object": ("UINT", 0),
}
"""Channel name -> its pixel type by name and by EXR's number."""

COMPRESSIONS: Final = {0: "NONE", 2: "ZIPS", 3: "ZIP"}
"""The compressions allowed: they keep every bit and need nothing but zlib to read."""

_MAGIC = 20000630
_HEAD_BYTES = 65536
_MAX_ATTRIBUTES = 256

_damage_seen = threading.Event()
"""Set once OpenEXR has failed in this process: then chunks are decompressed before it sees them,
because it keeps the memory of every picture that it fails to decode."""


@dataclass(frozen=True)
class Surface:
    """What the camera sees at each pixel centre.

    Attributes:
        depth_m: float32 (H, W), planar z in metres, +inf where no object is seen.
        m0: float32 (H, W), first material coordinate, 0 where no object is seen.
        m1: float32 (H, W), second material coordinate, 0 where no object is seen.
        object_id: uint32 (H, W), 0 where no object is seen.
    """

    depth_m: npt.NDArray[np.float32]
    m0: npt.NDArray[np.float32]
    m1: npt.NDArray[np.float32]
    object_id: npt.NDArray[np.uint32]


@dataclass(frozen=True)
class ExrHeader:
    """The parts of an EXR header that matter here.

    Attributes:
        width: Pixels.
        height: Pixels.
        channels: Channel name -> (pixel type number, x sampling, y sampling).
        compression: EXR's compression number.
        origin: Corner of the data window.
        same_windows: True if data and display window are one.
        size: Bytes of the header.
    """

    width: int
    height: int
    channels: dict[str, tuple[int, int, int]]
    compression: int
    origin: tuple[int, int]
    same_windows: bool
    size: int


def write_surface(path: Path | str, surface: Surface) -> None:
    """Write a depth and surface image: one part, ZIP, equal arrays give equal bytes.

    Args:
        path: Where to; replaced if it exists.
        surface: The arrays, all (H, W), of the types that `Surface` states.

    Raises:
        ValueError: An array has another type or shape.
    """
    shape = surface.depth_m.shape
    arrays = (surface.depth_m, surface.m0, surface.m1, surface.object_id)
    channels = dict(zip(CHANNELS, arrays, strict=True))
    for name, array in channels.items():
        kind = np.dtype(np.uint32 if name == "surface.object" else np.float32)
        if array.dtype != kind or array.shape != shape or array.ndim != 2 or array.size == 0:
            raise ValueError(f"{name} must be {kind} {shape}, not {array.dtype} {array.shape}")
    _write(path, channels)


def write_camera_depth(path: Path | str, depth_m: npt.NDArray[np.float32]) -> None:
    """Write depth alone: float32 (H, W), metres, +inf where it is not known."""
    _write(path, {"Z": depth_m})


def _write(path: Path | str, channels: dict[str, npt.NDArray[Any]]) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    pixels = {name: np.ascontiguousarray(array) for name, array in channels.items()}
    with OpenEXR.File(header, pixels, 1) as image:
        image.write(str(path))
    _check_written(Path(path), 4 * len(channels))


def _check_written(path: Path, pixel_bytes: int) -> None:
    """Check the table of chunks, which OpenEXR writes last: it says nothing when that fails."""
    try:
        header = read_header(path)
        line_bytes, data = pixel_bytes * header.width, path.read_bytes()
        shape = (header.compression, header.height, line_bytes)
        check_chunks(data, header.size, *shape, inflate=False)
    except (FileRefusedError, ValueError) as error:
        raise OSError(errno.EIO, os.strerror(errno.EIO), str(path)) from error


def read_surface(
    path: AnyFile, *, size: tuple[int, int] | None = None, writable: bool = True
) -> Surface:
    """Read a depth and surface image.

    Args:
        path: The EXR file.
        size: (width, height) it must have, or None for any within the limits.
        writable: False saves a copy and gives arrays that can only be read.

    Returns:
        Its four channels.

    Raises:
        FileRefusedError: Missing, no EXR, other channels, of another size, too large, damaged.
    """
    arrays = _read(path, size, CHANNELS)
    if writable:
        arrays = {name: array.copy() for name, array in arrays.items()}
    return Surface(*arrays.values())


def read_camera_depth(
    path: AnyFile, *, size: tuple[int, int] | None = None
) -> npt.NDArray[np.float32]:
    """Read depth alone, float32 (H, W), metres; arguments and errors as `read_surface`."""
    return _read(path, size, {"Z": CHANNELS["Z"]})["Z"].copy()


def _read(
    path: AnyFile, size: tuple[int, int] | None, channels: dict[str, tuple[str, int]]
) -> dict[str, npt.NDArray[Any]]:
    check_regular(path, limits.MAX_IMAGE_FILE_BYTES)
    header = read_header(path)
    refuse_large(header.width, header.height, path)
    _require_kind(header, path, channels)
    require_size((header.width, header.height), size, path)
    return _decode(path, header, list(channels))


def _decode(path: AnyFile, header: ExrHeader, names: list[str]) -> dict[str, npt.NDArray[Any]]:
    """Decode channels of a file whose header was checked.

    `InputFile` raises on damaged pixels, where `OpenEXR.File` prints to stdout and goes on.
    """
    data = read_bytes(path, limits.MAX_IMAGE_FILE_BYTES)
    try:
        check_chunks(
            data,
            header.size,
            header.compression,
            header.height,
            4 * len(names) * header.width,
            inflate=_damage_seen.is_set(),
        )
        image = OpenEXR.InputFile(io.BytesIO(path.data) if isinstance(path, Blob) else str(path))
        try:
            planes = image.channels(names)
        finally:
            image.close()
        return {
            name: np.frombuffer(plane, np.uint32 if CHANNELS[name][1] == 0 else np.float32).reshape(
                header.height, header.width
            )
            for name, plane in zip(names, planes, strict=True)
        }
    except Exception as error:  # the binding raises OSError, TypeError and others
        if not isinstance(error, ValueError):
            _damage_seen.set()
        raise FileRefusedError(
            "FILE_UNREADABLE", "the EXR cannot be decoded", path=path, found=str(error)
        ) from error


def read_header(path: AnyFile) -> ExrHeader:
    """Parse an EXR header by hand, so that nothing is allocated on its word.

    Args:
        path: The EXR file.

    Raises:
        FileRefusedError: It is not a single-part scan-line EXR, or its header is damaged.
    """
    with open_binary(path) as stream:
        head = stream.read(_HEAD_BYTES)
    magic, version = struct.unpack_from("<II", head) if len(head) >= 8 else (0, 0)
    if magic != _MAGIC:
        raise FileRefusedError("FILE_UNREADABLE", "this is not an EXR file", path=path)
    if version & 0xFF != 2 or version & ~0x4FF:
        raise FileRefusedError(
            "IMAGE_FORMAT",
            "the EXR is tiled, deep or of several parts",
            path=path,
            required="one part of scan lines",
        )
    try:
        attributes, size = _attributes(head)
        channels = _channels(attributes["channels"])
        left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
        display = struct.unpack("<4i", attributes["displayWindow"])
        compression = attributes["compression"][0]
    except (KeyError, ValueError, IndexError, struct.error) as error:
        raise FileRefusedError(
            "FILE_UNREADABLE", "the EXR's header is damaged", path=path
        ) from error
    return ExrHeader(
        width=right - left + 1,
        height=bottom - top + 1,
        channels=channels,
        compression=compression,
        origin=(left, top),
        same_windows=display == (left, top, right, bottom),
        size=size,
    )


def _attributes(head: bytes) -> tuple[dict[str, bytes], int]:
    """Return the header's attributes and its size in bytes."""
    found: dict[str, bytes] = {}
    position = 8
    for _ in range(_MAX_ATTRIBUTES):
        end = head.index(b"\0", position)
        if end == position:
            return found, end + 1
        name = head[position:end].decode("ascii")
        position = head.index(b"\0", end + 1) + 1
        (size,) = struct.unpack_from("<i", head, position)
        position += 4
        if size < 0 or position + size > len(head):
            raise ValueError("attribute beyond the header")
        found[name] = head[position : position + size]
        position += size
    raise ValueError("too many attributes")


def _channels(data: bytes) -> dict[str, tuple[int, int, int]]:
    found: dict[str, tuple[int, int, int]] = {}
    position = 0
    while data[position] != 0:
        end = data.index(b"\0", position)
        kind, _, sampling_x, sampling_y = struct.unpack_from("<iiii", data, end + 1)
        found[data[position:end].decode("ascii")] = (kind, sampling_x, sampling_y)
        position = end + 17
    return found


def _require_kind(header: ExrHeader, path: AnyFile, channels: dict[str, tuple[str, int]]) -> None:
    found: object
    required = None
    if header.channels != {name: (number, 1, 1) for name, (_, number) in channels.items()}:
        problem = "the EXR has other channels"
        found = ", ".join(
            f"{name} ({_KINDS.get(kind, kind)}{'' if sampling == [1, 1] else ', subsampled'})"
            for name, (kind, *sampling) in sorted(header.channels.items())
        )
        required = ", ".join(f"{name} ({kind})" for name, (kind, _) in channels.items())
    elif header.compression not in COMPRESSIONS:
        problem = "the EXR file has a compression that the format does not allow"
        found, required = f"compression {header.compression}", ", ".join(COMPRESSIONS.values())
    elif header.origin != (0, 0) or not header.same_windows:
        problem = "data window and display window must both start at (0, 0) and be equal"
        found = f"origin {header.origin}"
    else:
        return
    raise FileRefusedError("IMAGE_FORMAT", problem, path=path, found=found, required=required)
