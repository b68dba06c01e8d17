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
from typing import Any, Final

import numpy as np
import pyarrow as pa

from pliant.spec.conventions import FOOTER_KEY, SPEC_VERSION
from pliant.spec.io.jsonfiles import parse_json
from pliant.spec.io.parquet import TableWriter, read_table
from pliant.spec.io.reading import Blob
from pliant.spec.storage import layout
from pliant.spec.storage.shards import PackedFile, Shards
from pliant.spec.tables import CORRESPONDENCES, INDEX

SHARD_BYTES: Final = 500_000_000
_INDEX_GROUP_FILES: Final = 4096

IMAGE: Final = pa.struct([pa.field("bytes", pa.binary()), pa.field("path", pa.string())])

FRAMES: Final = pa.schema(
    [
        pa.field("sequence", pa.string(), nullable=False),
        pa.field("tier", pa.string(), nullable=False),
        pa.field("shape", pa.string()),
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("image", IMAGE, nullable=False),
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

_HUB_NAMES: Final = {"float": "float32", "double": "float64"}


def hub_features(schema: pa.Schema) -> dict[str, Any]:
    """Return the columns of a table in the words of Hugging Face `datasets`.

    Without them an image is but a struct.
    """
    return {column.name: _hub_feature(column.type) for column in schema}


def _hub_feature(kind: pa.DataType) -> dict[str, Any]:
    if pa.types.is_struct(kind):
        return {"_type": "Image"}
    if pa.types.is_list(kind):
        return {"feature": _hub_feature(kind.value_type), "_type": "List"}
    return {"dtype": _HUB_NAMES.get(str(kind), str(kind)), "_type": "Value"}


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


_SCHEMAS: Final = {"frames": FRAMES, "folders": FOLDERS, "correspondences": ROWS}
"""Folder of shards -> their columns."""


class Packer:
    """Packs sequences, in the order of `sequences.parquet`. A context manager.

    Args:
        root: The packed dataset's folder.
        dataset: `id` and `version`, for the footers.
        shard_bytes: About how large a shard becomes.
    """

    def __init__(
        self, root: Path, dataset: Mapping[str, str], *, shard_bytes: int = SHARD_BYTES
    ) -> None:
        self._root, self._dataset, self._shard_bytes = root, dict(dataset), shard_bytes
        self._places: dict[str, list[dict[str, Any]]] = {}
        self._shards: dict[tuple[str, str], Shards] = {}

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
        self._places[folder.id] = []
        numbers = range(folder.frames)
        images = {name(frame) for name in (layout.rgb_name, layout.depth_name) for frame in numbers}
        others = sorted(set(folder.files) - images)
        frames = self._of("frames", folder.split)
        frames.make_room(sum(folder.size(name) for name in folder.files if name in images))
        for frame, camera in zip(numbers, _cameras(folder), strict=True):
            self._add_frame(frames, folder, frame, camera)
        rest = self._of("folders", folder.split)
        rest.make_room(sum(folder.size(name) for name in others))
        for name in others:
            data = folder.files[name]
            row = {"sequence": folder.id, "path": name, "content": data}
            file = PackedFile("content", folder.id, name, len(data))
            rest.add(pa.Table.from_pylist([row], schema=FOLDERS), [file])
        if layout.CORRESPONDENCES_TABLE in folder.files:
            correspondences = self._of("correspondences", folder.split)
            correspondences.make_room(0)
            correspondences.add(correspondence_rows(folder), [])

    def _add_frame(
        self, frames: Shards, folder: FolderToPack, frame: int, camera: Mapping[str, Any]
    ) -> None:
        rgb_name, depth_name = layout.rgb_name(frame), layout.depth_name(frame)
        rgb, depth = folder.files[rgb_name], folder.files.get(depth_name)
        row = {
            "sequence": folder.id,
            "tier": folder.tier,
            "shape": folder.shape,
            "frame": frame,
            "image": {"bytes": rgb, "path": f"{folder.id}-{frame:06d}.png"},
            "depth_exr": depth,
            **camera,
        }
        files = [PackedFile("image.bytes", folder.id, rgb_name, len(rgb))]
        if depth is not None:
            files.append(PackedFile("depth_exr", folder.id, depth_name, len(depth)))
        frames.add(pa.Table.from_pylist([row], schema=FRAMES), files)

    def close(self) -> None:
        """Finish the shards and write the index."""
        for shards in self._shards.values():
            shards.close()
        path = self._root / layout.INDEX_TABLE
        with TableWriter(path, "index", {"dataset": self._dataset}) as writer:
            rows: list[dict[str, Any]] = []
            for name, places in self._places.items():
                rows.append({"id": name, "files": sorted(places, key=lambda f: f["path"])})
                if sum(len(row["files"]) for row in rows) >= _INDEX_GROUP_FILES:
                    writer.write(pa.Table.from_pylist(rows, schema=INDEX))
                    rows = []
            if rows or not self._places:
                writer.write(pa.Table.from_pylist(rows, schema=INDEX))

    def _of(self, folder: str, split: str) -> Shards:
        key = (folder, split)
        if key not in self._shards:
            footer = {"table": folder, "dataset": self._dataset, "split": split}
            text = json.dumps({"spec_version": SPEC_VERSION, **footer}, sort_keys=True)
            metadata: dict[bytes | str, str] = {FOOTER_KEY: text}
            if folder == "frames":
                features = {"info": {"features": hub_features(FRAMES)}}
                metadata["huggingface"] = json.dumps(features, sort_keys=True)
            schema = _SCHEMAS[folder].with_metadata(metadata)
            self._shards[key] = Shards(
                self._root, folder, split, schema, self._shard_bytes, self._places
            )
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
    texts = {"sequence": folder.id, "tier": folder.tier}
    columns = {
        **{name: table[name] for name in table.column_names},
        **{name: of_point[name] for name in of_point.column_names},
        **{name: pa.repeat(pa.scalar(text), table.num_rows) for name, text in texts.items()},
    }
    return pa.table({field.name: columns[field.name] for field in ROWS}, schema=ROWS)
