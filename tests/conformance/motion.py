"""Steps of a case that move the points of a sequence, or see them again: tables follow cameras."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.arrays import FloatArray
from pliant.spec.storage import layout
from tests.conformance.edits import change_exr, change_json, whole

_CAMERA = ("K", "world_to_camera")
_UV = ("u_px", "v_px")
_XYZ = ("x_m", "y_m", "z_m")


@dataclass
class _Tracks:
    """The correspondences of a sequence as arrays, with the camera of each row."""

    columns: dict[str, Any]
    K: FloatArray
    pose: FloatArray

    @classmethod
    def read(cls, folder: Path) -> _Tracks:
        table = pq.read_table(folder / layout.CORRESPONDENCES_TABLE)
        frames = json.loads((folder / layout.CAMERAS_JSON).read_text())["frames"]
        frame = table.column("frame").to_numpy()
        K, pose = (np.array([each[name] for each in frames])[frame] for name in _CAMERA)
        return cls({name: table.column(name) for name in table.column_names}, K, pose)

    def write(self, folder: Path, **changed: FloatArray) -> None:
        path = folder / layout.CORRESPONDENCES_TABLE
        schema = pq.read_schema(path)
        columns = {**self.columns, **{n: a.astype(np.float32) for n, a in changed.items()}}
        pq.write_table(pa.table(columns, schema=schema), path, compression="zstd")

    def stacked(self, *names: str) -> FloatArray:
        return np.stack([np.asarray(self.columns[name], np.float64) for name in names], axis=1)


def see_again(root: Path, folder: str = ".") -> None:
    """Compute u_px, v_px and depth_m of a sequence again from positions and cameras."""
    tracks = _Tracks.read(root / whole(folder))
    local = np.einsum("nij,nj->ni", tracks.pose[:, :3, :3], tracks.stacked(*_XYZ))
    local += tracks.pose[:, :3, 3]
    uv = tracks.K[:, [0, 1], [0, 1]] * local[:, :2] / local[:, 2:] + tracks.K[:, :2, 2]
    tracks.write(root / whole(folder), u_px=uv[:, 0], v_px=uv[:, 1], depth_m=local[:, 2])


def _move(root: Path, folder: str, move: Callable[[FloatArray], FloatArray]) -> None:
    """Move the points of a sequence parallel to the image plane; the tables follow."""
    tracks = _Tracks.read(root / whole(folder))
    uv, z = move(tracks.stacked(*_UV)), tracks.stacked("depth_m")
    local = np.column_stack([(uv - tracks.K[:, :2, 2]) / tracks.K[:, [0, 1], [0, 1]] * z, z])
    local -= tracks.pose[:, :3, 3]
    xyz = np.einsum("nji,nj->ni", tracks.pose[:, :3, :3], local)
    moved = dict(zip((*_UV, *_XYZ), np.column_stack([uv, xyz]).T, strict=True))
    tracks.write(root / whole(folder), **moved)


def scatter(root: Path, folder: str = ".", *, size_px: float) -> None:
    """Move the points of a sequence at random."""
    _move(root, folder, lambda uv: uv + np.random.default_rng(0).normal(0, size_px, uv.shape))


def centre_in_pixels(root: Path, folder: str = ".") -> None:
    """Move the points of a sequence to the centres of the pixels that they are in."""
    _move(root, folder, lambda uv: np.floor(uv) + 0.5)


def next_frame(root: Path, folder: str = ".") -> None:
    """Give every frame the rows and the camera of the next one."""
    path = root / whole(folder) / layout.CORRESPONDENCES_TABLE
    table = pq.read_table(path)
    frame = table.column("frame").to_numpy()
    count = int(frame.max()) + 1
    order = np.concatenate([np.flatnonzero(frame == (f + 1) % count) for f in range(count)])
    moved = table.take(order).set_column(0, table.schema.field("frame"), table.column("frame"))
    pq.write_table(moved, path)

    def turn(document: dict[str, Any]) -> None:
        frames = document["frames"]
        document["frames"] = [
            {**frames[(index + 1) % count], "frame": index} for index in range(count)
        ]

    change_json(f"{folder}/{layout.CAMERAS_JSON}", turn)(root)


def measure_rows_along_rays(root: Path) -> None:
    """Turn depth_m of a sequence from planar depth into the length of the ray."""
    tracks = _Tracks.read(root)
    slope = (tracks.stacked(*_UV) - tracks.K[:, :2, 2]) / tracks.K[:, [0, 1], [0, 1]]
    depth_m = tracks.stacked("depth_m")[:, 0] * np.sqrt(1 + (slope**2).sum(axis=1))
    tracks.write(root, depth_m=depth_m)


def measure_rays(root: Path) -> None:
    """Turn the depth images of a sequence from planar depth into the length of the ray."""
    for camera in json.loads((root / layout.CAMERAS_JSON).read_text())["frames"]:
        K = np.array(camera["K"])

        def lengthen(channels: dict[str, Any], K: FloatArray = K) -> None:
            v, u = np.indices(channels["Z"].shape) + 0.5
            x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
            channels["Z"][:] = channels["Z"] * np.sqrt(1 + x * x + y * y)

        change_exr(layout.depth_name(camera["frame"]), lengthen)(root)
