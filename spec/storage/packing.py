"""Packs the sequences of a dataset into Parquet shards, and writes the index that finds them.

Three kinds of shard, each of one split: `frames` (one row per frame, the images as files within),
`folders` (a row for every other file of a sequence's folder) and `correspondences` (rows for
people and query engines; Pliant reads the files in `folders`). A sequence is never divided between
two shards of a kind unless it is larger than one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa

from pliant.spec.io.jsonfiles import parse_json
from pliant.spec.io.parquet import TableWriter, read_table
from pliant.spec.io.reading import Blob
from pliant.spec.storage import layout
from pliant.spec.storage.shards import ShardWriter
from pliant.spec.tables import CORRESPONDENCES, INDEX

SHARD_BYTES: Final = 500_000_000
GROUP_BYTES: Final = 32 * 2**20
_INDEX_GROUP_FILES: Final = 4096
_LENGTH_BYTES: Final = 4
_GROUP_ROWS: Final = 2**17

_IMAGE = pa.struct([pa.field("bytes", pa.binary()), pa.field("path", pa.string())])

FRAMES: Final = pa.schema(
    [
        pa.field("sequence", pa.string(), nullable=False),
        pa.field("tier", pa.string(), nullable=False),
        pa.field("shape", pa.string()),
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("image", _IMAGE, nullable=False),
        pa.field("depth_exr", pa.binary()),
        pa.field("fx", pa.float64()),
        pa.field("fy", pa.float64()),
        pa.field("cx", pa.float64()),
        pa.field("cy", pa.float64()),
        pa.field("world_to_camera", pa.list_(pa.field("element", pa.float64()))),
    ]
)
"""One row per frame; what a held-out sequence does not tell is null."""

FOLDERS: Final = pa.schema(
    [
        pa.field("sequence", pa.string(), nullable=False),
        pa.field("path", pa.string(), nullable=False),
        pa.field("content", pa.binary(), nullable=False),
    ]
)
"""A row for every file of a sequence's folder that is not an image."""

ROWS: Final = pa.schema(
    [
        pa.field("sequence", pa.string(), nullable=False),
        pa.field("tier", pa.string(), nullable=False),
        *[pa.field(f.name, f.type, nullable=False) for f in CORRESPONDENCES],
        pa.field("object", pa.int32(), nullable=False),
        pa.field("kind", pa.string(), nullable=False),
        pa.field("m0", pa.float32(), nullable=False),
        pa.field("m1", pa.float32(), nullable=False),
    ]
)
"""The correspondences of all sequences, each row with what it is of the material."""

FEATURES: Final[dict[str, dict[str, Any]]] = {
    "sequence": {"dtype": "string", "_type": "Value"},
    "tier": {"dtype": "string", "_type": "Value"},
    "shape": {"dtype": "string", "_type": "Value"},
    "frame": {"dtype": "int32", "_type": "Value"},
    "image": {"_type": "Image"},
    "depth_exr": {"dtype": "binary", "_type": "Value"},
    **{name: {"dtype": "float64", "_type": "Value"} for name in ("fx", "fy", "cx", "cy")},
    "world_to_camera": {"feature": {"dtype": "float64", "_type": "Value"}, "_type": "List"},
}
"""`FRAMES` in the words of Hugging Face `datasets`: without them an image is but a struct."""


@dataclass(frozen=True)
class FolderToPack:
    """A sequence on its way into the shards.

    Attributes:
        id: The sequence.
        tier: Its tier.
        split: Its split.
        shape: Its shape, or None.
        frames: Number of frames.
        files: Path in its folder -> bytes, all of them; read when asked for.
        sizes: Path -> bytes of those that are large, so that room is made without reading them.
    """

    id: str
    tier: str
    split: str
    shape: str | None
    frames: int
    files: Mapping[str, bytes]
    sizes: Mapping[str, int] = field(default_factory=dict)

    def size(self, name: str) -> int:
        """Return the size of a file."""
        return self.sizes[name] if name in self.sizes else len(self.files[name])


class _Blob(NamedTuple):
    """A file inside a row: its column, sequence, path in the sequence's folder and size."""

    column: str
    sequence: str
    path: str
    size: int


class _Shards:
    """The shards of one kind and split, one after another."""

    def __init__(self, packer: Packer, folder: str, split: str) -> None:
        self._packer, self._folder, self._split = packer, folder, split
        self._number = 0
        self._writer: ShardWriter | None = None
        # What waits for its row group: rows, their files, and tables of rows without files.
        self._rows: list[dict[str, Any]] = []
        self._blobs: list[_Blob] = []
        self._groups: list[list[_Blob]] = []  # of each row group of the present shard
        self._tables: list[pa.Table] = []
        self._waiting = 0  # bytes of the files
        self.schema = {"frames": FRAMES, "folders": FOLDERS, "correspondences": ROWS}[folder]

    def make_room(self, size: int) -> None:
        """Begin a new shard if this many bytes more would make the present one too large."""
        written = self._waiting + (0 if self._writer is None else self._writer.size)
        if written and written + size > self._packer.shard_bytes:
            self._roll()

    def add(self, row: dict[str, Any], blobs: list[_Blob]) -> None:
        """Append a row and the files in it."""
        size = sum(blob.size for blob in blobs)
        if self._rows and self._waiting + size > GROUP_BYTES:
            self.flush()
        self._rows.append(row)
        self._waiting += size
        self._blobs += blobs

    def add_table(self, table: pa.Table) -> None:
        """Append a table of rows without files."""
        self._tables.append(table)
        if sum(each.num_rows for each in self._tables) >= _GROUP_ROWS:
            self.flush()
            if self._open().size > self._packer.shard_bytes:
                self._roll()

    def flush(self) -> None:
        """Write what waits as one row group."""
        if self._tables:
            self._open().write(pa.concat_tables(self._tables).combine_chunks())
            self._tables = []
        if not self._rows:
            return
        self._open().write(pa.Table.from_pylist(self._rows, schema=self.schema))
        self._groups.append(self._blobs)
        self._rows, self._blobs, self._waiting = [], [], 0

    def _roll(self) -> None:
        self.close()
        self._number += 1

    def close(self) -> None:
        """Finish the present shard."""
        self.flush()
        if self._writer is None:
            return
        shard = layout.shard_name(self._folder, self._split, self._number)
        ends = self._writer.close()
        for group, blobs in zip(ends, self._groups or [[]] * len(ends), strict=True):
            for blob in reversed(blobs):
                offset = group[blob.column] - blob.size
                group[blob.column] = offset - _LENGTH_BYTES
                place = {"path": blob.path, "shard": shard, "offset": offset, "bytes": blob.size}
                self._packer.places[blob.sequence].append(place)
        self._groups, self._writer = [], None

    def abandon(self) -> None:
        """Let go of the open file."""
        if self._writer is not None:
            self._writer.abandon()

    def _open(self) -> ShardWriter:
        if self._writer is None:
            path = self._packer.root / layout.shard_name(self._folder, self._split, self._number)
            blobs = {"frames": ("image.bytes", "depth_exr"), "folders": ("content",)}
            features = json.dumps({"info": {"features": FEATURES}}, sort_keys=True)
            footer = {"table": self._folder, "dataset": self._packer.dataset, "split": self._split}
            self._writer = ShardWriter(
                path,
                self.schema,
                blobs.get(self._folder, ()),
                footer,
                {"huggingface": features} if self._folder == "frames" else None,
            )
        return self._writer


class Packer:
    """Packs sequences, in the order of `sequences.parquet`. A context manager.

    Args:
        root: The packed dataset's folder.
        dataset: `id` and `version`, for the footers.
        shard_bytes: About how large a shard becomes.
        rows: Whether to write the shards `correspondences` too.
    """

    def __init__(
        self,
        root: Path,
        dataset: Mapping[str, str],
        *,
        shard_bytes: int = SHARD_BYTES,
        rows: bool = True,
    ) -> None:
        self.root, self.dataset, self.shard_bytes = root, dict(dataset), shard_bytes
        self.places: dict[str, list[dict[str, Any]]] = {}
        self._rows = rows
        self._shards: dict[tuple[str, str], _Shards] = {}

    def __enter__(self) -> Packer:
        return self

    def __exit__(self, kind: type[BaseException] | None, *exc: object) -> None:
        if kind is None:
            self.close()
        else:
            for shards in self._shards.values():
                shards.abandon()

    def add(self, folder: FolderToPack) -> None:
        """Pack one sequence."""
        self.places[folder.id] = []
        images = {layout.rgb_name(frame): frame for frame in range(folder.frames)}
        depths = {layout.depth_name(frame): frame for frame in range(folder.frames)}
        others = sorted(set(folder.files) - set(images) - set(depths))
        frames = self._of("frames", folder.split)
        pixels = set(images) | set(depths)
        frames.make_room(sum(folder.size(name) for name in folder.files if name in pixels))
        cameras = _cameras(folder)
        for frame in range(folder.frames):
            rgb_name, depth_name = layout.rgb_name(frame), layout.depth_name(frame)
            rgb, depth = folder.files[rgb_name], folder.files.get(depth_name)
            blobs = [_Blob("image.bytes", folder.id, rgb_name, len(rgb))]
            if depth is not None:
                blobs.append(_Blob("depth_exr", folder.id, depth_name, len(depth)))
            row = {
                "sequence": folder.id,
                "tier": folder.tier,
                "shape": folder.shape,
                "frame": frame,
                "image": {"bytes": rgb, "path": f"{folder.id}-{frame:06d}.png"},
                "depth_exr": depth,
                **cameras[frame],
            }
            frames.add(row, blobs)
        rest = self._of("folders", folder.split)
        rest.make_room(sum(folder.size(name) for name in others))
        for name in others:
            data = folder.files[name]
            row = {"sequence": folder.id, "path": name, "content": data}
            rest.add(row, [_Blob("content", folder.id, name, len(data))])
        if self._rows and layout.CORRESPONDENCES_TABLE in folder.files:
            self._of("correspondences", folder.split).add_table(correspondence_rows(folder))

    def close(self) -> None:
        """Finish the shards and write the index."""
        for shards in self._shards.values():
            shards.close()
        path = self.root / layout.INDEX_TABLE
        with TableWriter(path, "index", {"dataset": self.dataset}) as writer:
            rows: list[dict[str, Any]] = []
            for name, places in self.places.items():
                rows.append({"id": name, "files": sorted(places, key=lambda f: f["path"])})
                if sum(len(row["files"]) for row in rows) >= _INDEX_GROUP_FILES:
                    writer.write(pa.Table.from_pylist(rows, schema=INDEX))
                    rows = []
            if rows or not self.places:
                writer.write(pa.Table.from_pylist(rows, schema=INDEX))

    def _of(self, folder: str, split: str) -> _Shards:
        key = (folder, split)
        if key not in self._shards:
            self._shards[key] = _Shards(self, folder, split)
        return self._shards[key]


def _cameras(folder: FolderToPack) -> list[dict[str, Any]]:
    """Return the camera columns of every frame, nulls where the sequence tells none."""
    data = folder.files.get(layout.CAMERAS_JSON)
    if data is None:
        names = ("fx", "fy", "cx", "cy", "world_to_camera")
        return [dict.fromkeys(names) for _ in range(folder.frames)]
    found = []
    for entry in parse_json(data, f"{folder.id}/{layout.CAMERAS_JSON}")["frames"]:
        K = entry["K"]
        pose = np.asarray(entry["world_to_camera"], np.float64).ravel().tolist()
        found.append(
            {"fx": K[0][0], "fy": K[1][1], "cx": K[0][2], "cy": K[1][2], "world_to_camera": pose}
        )
    return found


def correspondence_rows(folder: FolderToPack) -> pa.Table:
    """Return a sequence's correspondences as self-contained rows.

    Args:
        folder: The sequence, with its two tables.

    Returns:
        `ROWS`, in the order of the sequence's table.
    """
    blobs = {
        name: Blob(f"{folder.id}/{name}", folder.files[name])
        for name in (layout.POINTS_TABLE, layout.CORRESPONDENCES_TABLE)
    }
    points = read_table(blobs[layout.POINTS_TABLE], "points")
    table = read_table(blobs[layout.CORRESPONDENCES_TABLE], "correspondences")
    of_point = points.select(["object", "kind", "m0", "m1"]).take(table["point"])
    columns: dict[str, Any] = {name: table[name] for name in table.column_names}
    columns.update({name: of_point[name] for name in of_point.column_names})
    for name in ("sequence", "tier"):
        text = folder.id if name == "sequence" else folder.tier
        columns[name] = pa.chunked_array([pa.repeat(pa.scalar(text), table.num_rows)])
    arrays = [columns[field.name] for field in ROWS]
    return pa.Table.from_arrays(arrays, schema=ROWS)
