"""Reads point tracks in the form of TAP-Vid: `video`, `points` and `occluded`, one npz per clip.

TAP-Vid's positions are x and y over the width and height of the frame, from the corner of the
image, so that the centre of the first pixel is at (0.5 / width, 0.5 / height).
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.filesize import decimal

from pliant.converters.clip import Clip
from pliant.spec.arrays import ImageArray
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.photo import decode_photo
from pliant.spec.limits import Limits, run_limited
from pliant.spec.lru_cache import LRUCache
from pliant.spec.progress import Progress

FIELDS: Final = ("video", "points", "occluded")

_MAX_UNPACKED_BYTES: Final = 2**30
_LIMITS: Final = Limits(memory_bytes=3 * 2**29, cpu_s=120, wall_s=300, file_bytes=0, network=False)

Record = dict[str, np.ndarray[Any, Any]]
RecordOf = Callable[[Path], Record]


def read_tapvid(files: Sequence[Path], progress: Progress | None = None) -> list[Clip]:
    """Read files of point tracks, each in a child process with limits.

    Positions are taken for shares of the frame if no visible one is above 2, else for pixels from
    its corner: interpolated tracks exceed 1 slightly, and a clip in pixels is not within 2 pixels.

    Args:
        files: npz files, a clip each.
        progress: Called after every file.

    Returns:
        The clips, in the order of the files.

    Raises:
        CallError: A file is a pickle, which can run code.
        SpecError: A file is damaged, too large, or of another form.
    """
    for path in files:
        if path.suffix.lower() in (".pkl", ".pickle"):
            raise CallError(
                "pickles are not read, because they can run code",
                path=path,
                required="npz files",
                fix="Convert one that you trust to npz, as docs/import.md shows.",
            )
        if path.suffix.lower() != ".npz":
            raise CallError(
                "this kind of file is not imported",
                path=path,
                required="annotations (.csv, .json), point tracks (.npz), or a folder of them",
            )

    # Clips are read once for their sizes and points, and again for their frames.
    records = LRUCache[Record](_MAX_UNPACKED_BYTES, _bytes_of)

    def record_of(path: Path) -> Record:
        read = partial(run_limited, partial(read_npz, path), limits=_LIMITS, path=path)
        return records.get(str(path), read)

    clips = []
    for path in files:
        clips.append(_clip(path, record_of))
        if progress is not None:
            progress(len(clips), len(files))
    return clips


def read_npz(path: Path) -> Record:
    """Return the arrays of an npz file; call it in a child process.

    Raises:
        SpecError: It is damaged, larger than 1 GiB once unpacked, or has arrays of objects.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > _MAX_UNPACKED_BYTES:
            most = decimal(_MAX_UNPACKED_BYTES)
            raise ValueError(f"{decimal(size)} once unpacked; at most {most} are read")
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in FIELDS if name in arrays.files}
    except MemoryError:
        raise
    except Exception as error:  # numpy, zipfile and zlib raise what they like
        raise SpecError(
            "the npz file cannot be read",
            path=path,
            found=str(error)[:200],
            fix="Its arrays must be numbers, or the bytes of JPEG or PNG files",
        ) from error


def _bytes_of(record: Record) -> int:
    return sum(array.nbytes for array in record.values())


def _clip(path: Path, record_of: RecordOf) -> Clip:
    record = record_of(path)
    missing = [name for name in FIELDS if name not in record]
    if missing:
        raise SpecError(
            "the file is incomplete",
            path=path,
            found=f"no {', '.join(missing)}",
            required=f"the arrays {', '.join(FIELDS)}",
        )
    frames = len(record["video"]) if record["video"].ndim else 0
    points, hidden = (_numbers(record[field], field, path) for field in ("points", "occluded"))
    if (
        frames == 0
        or points.ndim != 3
        or points.shape[1:] != (frames, 2)
        or hidden.shape != points.shape[:2]
    ):
        raise SpecError(
            "video, points and occluded do not belong together",
            path=path,
            found=f"{frames} frames, points {points.shape}, occluded {hidden.shape}",
            required="points (N, frames, 2) and occluded (N, frames)",
        )
    height, width, _ = _frame(record["video"], 0, path).shape
    if not np.isin(hidden, (0, 1)).all():
        raise SpecError(
            "a point is neither visible nor occluded",
            path=path,
            where="occluded",
            found=f"{hidden[~np.isin(hidden, (0, 1))][0]:g}",
            required="0 (visible) or 1 (occluded)",
        )
    visible = hidden == 0
    nowhere = np.argwhere(visible & ~np.isfinite(points).all(axis=2))
    if len(nowhere):
        point, frame = nowhere[0].tolist()
        raise SpecError(
            "a visible point has no position",
            path=path,
            where=f"points[{point}, {frame}]",
            found=points[point, frame].round(6).tolist(),
            required="two numbers, or occluded",
        )
    shares = (np.abs(points[visible]) <= 2).all()
    uv_px = points * np.array([width, height]) if shares else points
    return Clip(
        name=path.stem,
        size=(width, height),
        frames=frames,
        read=lambda frame: _frame(record_of(path)["video"], frame, path, (height, width, 3)),
        uv_px=np.where(np.isfinite(uv_px), uv_px, np.nan),
        visible=visible,
        temporal=True,
    )


def _numbers(value: np.ndarray[Any, Any], field: str, path: Path) -> np.ndarray[Any, Any]:
    if value.dtype.kind not in "biuf":
        raise SpecError("these are not numbers", path=path, where=field, found=str(value.dtype))
    return value.astype(np.float64)


def _frame(
    video: np.ndarray[Any, Any], frame: int, path: Path, shape: tuple[int, ...] | None = None
) -> ImageArray:
    """Return a frame, decoded if it is an encoded picture; it must have the shape, if given."""
    item = video[frame]
    if isinstance(item, bytes):
        try:
            item = decode_photo(io.BytesIO(item))
        except Exception as error:  # Pillow's errors do not share a base
            raise SpecError(
                "a frame cannot be read",
                path=path,
                where=f"frame {frame}",
                found=str(error).split(" <")[0],
            ) from error
    if shape is not None and item.shape != shape:
        raise SpecError(
            "the frames of a clip differ in size",
            path=path,
            where=f"frame {frame}",
            found=f"{item.shape[1]}x{item.shape[0]} px",
            required=f"{shape[1]}x{shape[0]} px, as frame 0",
        )
    if item.dtype != np.uint8 or item.ndim != 3 or item.shape[2] != 3:
        raise SpecError(
            "a frame is not a colour image",
            path=path,
            where=f"frame {frame}",
            found=f"{item.dtype} {item.shape}",
            required="uint8 (height, width, 3), or the bytes of a JPEG or PNG",
        )
    return np.asarray(item)
