"""Reads point tracks in the form of TAP-Vid: `video`, `points` and `occluded`.

A pickle contains one such record, or many, in a dict by name or in a list; an npz file has one.
TAP-Vid's positions are x and y over the width and height of the frame, from the corner of the
image, so that the centre of the first pixel is at (0.5 / width, 0.5 / height).
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from pliant.converters.clip import Clip, Image
from pliant.converters.unpickle import read_pickle
from pliant.spec.errors import SpecError
from pliant.spec.io.photo import decode_photo

FIELDS: Final = ("video", "points", "occluded")
_MAX_NPZ_BYTES: Final = 16 * 2**30

Coordinates = Literal["auto", "normalised", "pixels"]
"""What positions are: shares of the frame, or pixels from its corner; `auto` takes them for shares
if no visible one is above 1."""


def read_tapvid(path: Path, *, coordinates: Coordinates = "auto") -> list[Clip]:
    """Read a file of point tracks; nothing in it is executed.

    Args:
        path: A pickle (`.pkl`, `.pickle`) or an `.npz` file.
        coordinates: What the positions are.

    Returns:
        The clips, in the order of the file.

    Raises:
        SpecError: The file is damaged, asks to run something, or is of another form.
    """
    records = _npz(path) if path.suffix == ".npz" else read_pickle(path)
    if isinstance(records, dict) and set(FIELDS) & set(records):
        records = {path.stem: records}
    if isinstance(records, list):
        records = {f"{path.stem}-{index:04d}": record for index, record in enumerate(records)}
    if not isinstance(records, dict) or not records:
        raise SpecError("the file contains no point tracks", path=path, required=", ".join(FIELDS))
    return [_clip(str(name), record, path, coordinates) for name, record in records.items()]


def _npz(path: Path) -> dict[str, Any]:
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > _MAX_NPZ_BYTES:
            raise ValueError(f"{size:,} bytes once unpacked; at most {_MAX_NPZ_BYTES:,} are read")
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except Exception as error:  # numpy, zipfile and zlib raise what they like
        raise SpecError(
            "the npz file cannot be read",
            path=path,
            found=str(error)[:200],
            fix="Its arrays must be numeric; save JPEG bytes in a pickle",
        ) from error


def _clip(name: str, record: Any, path: Path, coordinates: Coordinates) -> Clip:
    missing = [f for f in FIELDS if not isinstance(record, Mapping) or f not in record]
    if missing:
        raise SpecError(
            "a record is incomplete", path=path, where=name, found=f"no {', '.join(missing)}"
        )
    video = record["video"]
    first = _frame(video, 0, name, path)
    height, width, _ = first.shape
    frames = len(video)
    points = _numbers(record["points"], "points", name, path)
    hidden = _numbers(record["occluded"], "occluded", name, path)
    if points.ndim != 3 or points.shape[1:] != (frames, 2) or hidden.shape != points.shape[:2]:
        raise SpecError(
            "video, points and occluded do not belong together",
            path=path,
            where=name,
            found=f"{frames} frames, points {points.shape}, occluded {hidden.shape}",
            required="points (N, frames, 2) and occluded (N, frames)",
        )
    visible = hidden == 0
    if not np.isfinite(points[visible]).all():
        raise SpecError("a visible point has no position", path=path, where=f"{name}, points")
    shares = coordinates == "normalised" or (
        coordinates == "auto" and bool((np.abs(points[visible]) <= 1).all())
    )
    uv_px = points * np.array([width, height]) if shares else points
    return Clip(
        name=name,
        size=(width, height),
        frames=frames,
        read=lambda frame: _frame(video, frame, name, path),
        uv_px=np.where(np.isfinite(uv_px), uv_px, np.nan),
        visible=visible,
        temporal=True,
    )


def _numbers(value: Any, field: str, name: str, path: Path) -> np.ndarray[Any, Any]:
    try:
        return np.asarray(value, np.float64)
    except (TypeError, ValueError) as error:
        raise SpecError("these are not numbers", path=path, where=f"{name}, {field}") from error


def _frame(video: Any, frame: int, name: str, path: Path) -> Image:
    """Return a frame, decoded if it is an encoded picture."""
    try:
        item = video[frame]
        if isinstance(item, bytes):
            return decode_photo(io.BytesIO(item))
        image = np.asarray(item)
    except Exception as error:  # Pillow's errors do not share a base
        raise SpecError(
            "a frame cannot be read", path=path, where=f"{name}, frame {frame}", found=str(error)
        ) from error
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise SpecError(
            "a frame is not a colour image",
            path=path,
            where=f"{name}, frame {frame}",
            found=f"{image.dtype} {image.shape}",
            required="uint8 (height, width, 3), or the bytes of a JPEG or PNG",
        )
    return image
