"""glTF 2.0 binary: the mesh of the tracked points per sequence, moved by morph targets."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.converters.targets.recording import Options, Recording, colours, shares_of_range
from pliant.spec.errors import SpecError
from pliant.spec.sequence import SequenceRecord

_FLOAT, _UINT, _BYTE = 5126, 5125, 5121
_TYPES: Final = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_VERTICES, _TRIANGLES = 34962, 34963
_Y_UP: Final = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]
"""World of the dataset (z up) to that of glTF (y up), column by column."""


def write(sequences: Iterable[SequenceRecord], folder: Path, options: Options) -> Iterator[None]:
    """Write a file per sequence: positions in metres, texture coordinates from the material.

    The first frame is the mesh; every other frame is a morph target, and an animation shows them
    one after the other.

    Raises:
        SpecError: A sequence has too few tracked points for a mesh.
    """
    for sequence in sequences:
        recording = Recording.of(sequence)
        if not len(recording.mesh.faces):
            raise SpecError(
                "the sequence has too few tracked points for a mesh",
                path=sequence.dir,
                found=len(recording.mesh.rows),
            )
        (folder / f"{sequence.id}.glb").write_bytes(_glb(recording, options.frame_rate_hz))
        yield


class _Buffers:
    """The binary part of a file, and the descriptions of its pieces."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, array: npt.NDArray[Any], kind: int, target: int | None = None) -> int:
        """Add an array (N,) or (N, C) and return the number of its accessor."""
        array = np.ascontiguousarray(array)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes}
        self.views.append(view if target is None else {**view, "target": target})
        self.data += array.tobytes()
        self.data += bytes(-len(self.data) % 4)
        width = 1 if array.ndim == 1 else array.shape[1]
        accessor = {
            "bufferView": len(self.views) - 1,
            "componentType": kind,
            "count": len(array),
            "type": _TYPES[width],
        }
        if kind == _BYTE:
            accessor["normalized"] = True
        else:
            low, high = array.min(axis=0), array.max(axis=0)
            accessor["min"], accessor["max"] = (np.atleast_1d(e).tolist() for e in (low, high))
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _glb(recording: Recording, frame_rate_hz: float) -> bytes:
    buffers = _Buffers()
    xyz = recording.xyz_m
    frames = len(xyz)
    shades = np.column_stack([colours(recording), np.full(xyz.shape[1], 255, np.uint8)])
    primitive: dict[str, Any] = {
        "attributes": {
            "POSITION": buffers.add(xyz[0], _FLOAT, _VERTICES),
            "TEXCOORD_0": buffers.add(shares_of_range(recording), _FLOAT, _VERTICES),
            "COLOR_0": buffers.add(shades, _BYTE, _VERTICES),
        },
        "indices": buffers.add(recording.mesh.faces.ravel().astype(np.uint32), _UINT, _TRIANGLES),
        "material": 0,
    }
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "pliant"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": recording.sequence.id, "mesh": 0, "matrix": _Y_UP}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0}}],
    }
    if frames > 1:
        moved = [buffers.add(each - xyz[0], _FLOAT, _VERTICES) for each in xyz[1:]]
        primitive["targets"] = [{"POSITION": each} for each in moved]
        document["meshes"][0]["weights"] = [0.0] * (frames - 1)
        times = buffers.add(np.arange(frames, dtype=np.float32) / np.float32(frame_rate_hz), _FLOAT)
        weights = buffers.add(np.eye(frames, dtype=np.float32)[:, 1:].ravel(), _FLOAT)
        document["animations"] = [
            {
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}],
                "samplers": [{"input": times, "output": weights, "interpolation": "STEP"}],
            }
        ]
    document |= {
        "buffers": [{"byteLength": len(buffers.data)}],
        "bufferViews": buffers.views,
        "accessors": buffers.accessors,
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(buffers.data), b"BIN\0") + buffers.data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
