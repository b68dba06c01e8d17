"""LeRobot's dataset format, version 3.0: an episode per sequence, pictures inside Parquet files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

from pliant.converters.targets.recording import Options, Recording
from pliant.spec.errors import CallError
from pliant.spec.io.limits import MAX_IMAGE_FILE_BYTES
from pliant.spec.io.photo import encoded
from pliant.spec.io.reading import read_bytes
from pliant.spec.sequence import SequenceRecord
from pliant.spec.storage import layout

VERSION: Final = "v3.0"
RGB, DEPTH, TRACKS = "observation.images.rgb", "observation.images.depth", "observation.tracks"
VISIBLE, POSITIONS = "observation.tracks_visible", "observation.positions"
_CHUNK_FILES: Final = 1000
_IMAGE: Final = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
_CHANNELS: Final = ["height", "width", "channels"]


def write(sequences: Iterable[SequenceRecord], folder: Path, options: Options) -> Iterator[None]:
    """Write `meta/` and `data/`, a Parquet file per episode.

    The columns are the PNG of a frame, its depth as a float32 TIFF in metres (+inf where nothing
    is seen), pixel positions (N, 2) and visibility of the tracked points, and their positions in
    metres (N, 3). The task of an episode is the name of its tier.

    Raises:
        CallError: Sequences have different numbers of points, which one table cannot hold.
    """
    episodes: list[dict[str, Any]] = []
    tasks: dict[str, int] = {}
    stats: dict[str, _Stats] = {}
    shapes: dict[str, tuple[int, ...]] = {}
    start = 0
    for sequence in sequences:
        recording = Recording.of(sequence, options.points)
        arrays = _arrays(recording)
        new = {name: array.shape[1:] for name, array in arrays.items()}
        if shapes and new != shapes:
            raise CallError(
                "an episode has another number of tracked points than those before",
                where=sequence.id,
                found=len(recording.chosen),
                required=shapes[TRACKS][0],
                fix="Convert one tier at a time (--tier), or ask for fewer points (--points).",
            )
        shapes = new
        for name, array in arrays.items():
            stats.setdefault(name, _Stats()).add(array)
        task = tasks.setdefault(sequence.tier, len(tasks))
        chunk, file = divmod(len(episodes), _CHUNK_FILES)
        path = folder / "data" / f"chunk-{chunk:03d}" / f"file-{file:03d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        counters = _counters(sequence.frames, start, len(episodes), task, options.frame_rate_hz)
        table = {**_images(sequence), **counters}
        for name, array in arrays.items():
            table[name] = pa.array(array.tolist(), _list_type(array))
        pq.write_table(pa.table(table), path)
        episodes.append(
            {
                "episode_index": len(episodes),
                "tasks": [sequence.tier],
                "length": sequence.frames,
                "dataset_from_index": start,
                "dataset_to_index": start + sequence.frames,
                "data/chunk_index": chunk,
                "data/file_index": file,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                "sequence": sequence.id,
                "split": sequence.split,
            }
        )
        start += sequence.frames
        size = sequence.size
        yield
    _write_meta(folder, episodes, tasks, stats, _features(shapes, size), options.frame_rate_hz)


def _arrays(recording: Recording) -> Mapping[str, npt.NDArray[Any]]:
    """Return the columns of numbers, with the frames first."""
    return {
        TRACKS: recording.uv_px,
        VISIBLE: recording.visible.astype(np.float32),
        POSITIONS: recording.xyz_m,
    }


def _images(sequence: SequenceRecord) -> dict[str, pa.Array]:
    rgb, depth = [], []
    for frame in range(sequence.frames):
        name = layout.rgb_name(frame)
        sequence.rgb(frame)  # a damaged picture is not handed on
        data = read_bytes(sequence.file(name), MAX_IMAGE_FILE_BYTES)
        rgb.append({"bytes": data, "path": name})
        tiff = encoded(Image.fromarray(sequence.surface(frame).depth_m), "TIFF")
        depth.append({"bytes": tiff, "path": f"depth/{frame:06d}.tiff"})
    return {RGB: pa.array(rgb, _IMAGE), DEPTH: pa.array(depth, _IMAGE)}


def _counters(
    frames: int, start: int, episode: int, task: int, rate_hz: float
) -> dict[str, pa.Array]:
    number = np.arange(frames)
    return {
        "timestamp": pa.array((number / rate_hz).astype(np.float32)),
        "frame_index": pa.array(number),
        "episode_index": pa.array(np.full(frames, episode)),
        "index": pa.array(number + start),
        "task_index": pa.array(np.full(frames, task)),
    }


def _list_type(array: npt.NDArray[Any]) -> pa.DataType:
    kind = pa.float32()
    for size in reversed(array.shape[1:]):
        kind = pa.list_(kind) if array.ndim > 2 else pa.list_(kind, size)
    return kind


class _Stats:
    """Mean, spread and range of a column, gathered episode by episode."""

    def __init__(self) -> None:
        self.count, self.total, self.squares = 0, 0.0, 0.0
        self.low, self.high = np.inf, -np.inf
        self.frames = 0

    def add(self, array: npt.NDArray[Any]) -> None:
        values = array.astype(np.float64)
        self.count, self.frames = self.count + values.size, self.frames + len(values)
        self.total, self.squares = self.total + values.sum(), self.squares + (values**2).sum()
        self.low, self.high = min(self.low, values.min()), max(self.high, values.max())

    def as_document(self) -> dict[str, list[float]]:
        mean = self.total / self.count
        std = float(np.sqrt(max(self.squares / self.count - mean**2, 0)))
        low, high = float(self.low), float(self.high)
        return {"min": [low], "max": [high], "mean": [mean], "std": [std], "count": [self.frames]}


def _features(shapes: Mapping[str, tuple[int, ...]], size: tuple[int, int]) -> dict[str, Any]:
    width, height = size
    features: dict[str, Any] = {
        RGB: {"dtype": "image", "shape": [height, width, 3], "names": _CHANNELS},
        DEPTH: {"dtype": "image", "shape": [height, width, 1], "names": _CHANNELS},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    }
    for name in ("frame_index", "episode_index", "index", "task_index"):
        features[name] = {"dtype": "int64", "shape": [1], "names": None}
    for name, shape in shapes.items():
        features[name] = {"dtype": "float32", "shape": list(shape), "names": None}
    return features


def _write_meta(
    folder: Path,
    episodes: list[dict[str, Any]],
    tasks: Mapping[str, int],
    stats: Mapping[str, _Stats],
    features: Mapping[str, Any],
    rate_hz: float,
) -> None:
    meta = folder / "meta"
    listed = meta / "episodes" / "chunk-000" / "file-000.parquet"
    listed.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(episodes), listed)
    pq.write_table(_with_index(tasks), meta / "tasks.parquet")
    info = {
        "codebase_version": VERSION,
        "robot_type": None,
        "total_episodes": len(episodes),
        "total_frames": sum(each["length"] for each in episodes),
        "total_tasks": len(tasks),
        "chunks_size": _CHUNK_FILES,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate_hz,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }
    (meta / "info.json").write_text(json.dumps(info, indent=1))
    documents = {name: each.as_document() for name, each in stats.items()}
    (meta / "stats.json").write_text(json.dumps(documents, indent=1))


def _with_index(tasks: Mapping[str, int]) -> pa.Table:
    """Return the table of tasks whose index pandas reads as the task's name, as LeRobot does."""
    name = "__index_level_0__"
    table = pa.table({"task_index": list(tasks.values()), name: list(tasks)})
    pandas = {
        "index_columns": [name],
        "column_indexes": [],
        "columns": [
            {"name": "task_index", "field_name": "task_index", "pandas_type": "int64",
             "numpy_type": "int64", "metadata": None},
            {"name": None, "field_name": name, "pandas_type": "unicode",
             "numpy_type": "object", "metadata": None},
        ],
    }  # fmt: skip
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})
