"""A sequence in three dimensions, as binary blocks for the page: mesh, positions, tracks, cameras.

The mesh is that of the tracked points (`pliant.spec.point_mesh`); the points that a camera
measured come from the depth image.
"""

from __future__ import annotations

import base64
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.evaluator.report.colours import material_colours
from pliant.evaluator.report.contact_sheet import evenly
from pliant.spec.errors import SpecError
from pliant.spec.sequence import RecordedFrame, SequenceRecord
from pliant.viewer.explorer.documents import NO_SCENE, has_scene
from pliant.viewer.explorer.frames import FrameCache

_TRACKS: Final = 24
_DEPTH_POINTS: Final = 20000


def scene_document(frames: FrameCache, sequence: SequenceRecord) -> dict[str, Any]:
    """Return what all frames of a sequence share, as JSON values.

    `faces` int32 (F, 3), `colours` uint8 (N, 3) index colours and `tracks` int32 (K,), numbers of
    points spread over the object, are little-endian in base64; `cameras` has per frame K, pixels,
    and world_to_camera, metres.

    Raises:
        SpecError: The sequence has no tracked points or cameras, or they are damaged.
    """
    if not has_scene(sequence):
        raise SpecError(NO_SCENE)
    mesh = frames.mesh(RecordedFrame(sequence, 0))
    colours = material_colours(mesh.material[:, 0], mesh.material[:, 1], sequence.described)
    count = len(mesh.rows)  # of a table that is in the order of the material
    spread = np.array(evenly(_TRACKS, count))
    cameras = [sequence.camera(index) for index in range(sequence.frames)]
    return {
        "sequence": sequence.id,
        "frames": sequence.frames,
        "temporal": sequence.temporal,
        "size": list(sequence.size),
        "points": count,
        "faces": _packed(mesh.faces, np.int32),
        "colours": _packed(np.rint(255 * colours), np.uint8),
        "tracks": _packed(spread, np.int32),
        "cameras": [
            {"K": each.K.tolist(), "world_to_camera": each.world_to_camera.tolist()}
            for each in cameras
        ],
    }


def pose_bytes(frames: FrameCache, frame: RecordedFrame) -> bytes:
    """Return a frame's points: float32 (N, 3) positions in metres, then uint8 (N,) states."""
    points = frames.points(frame)
    return points.xyz_m.astype("<f4").tobytes() + points.state.tobytes()


def depth_bytes(frames: FrameCache, frame: RecordedFrame) -> bytes | None:
    """Return what the camera measured: float32 (M, 3) world positions, then uint8 (M, 3) colours.

    At most 20,000 pixels, evenly chosen; None where the frame has no depth.
    """
    depth_m = frame.depth_m
    if depth_m is None:
        return None
    on = np.isfinite(depth_m) & (depth_m > 0)
    step = max(1, int(np.ceil(np.sqrt(np.count_nonzero(on) / _DEPTH_POINTS))))
    rows, columns = np.nonzero(on[::step, ::step])
    rows, columns = rows * step, columns * step
    z = depth_m[rows, columns].astype(np.float64)
    camera = frame.sequence.camera(frame.index)
    rays = np.linalg.inv(camera.K) @ np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))])
    local = rays * z
    world = np.linalg.inv(camera.world_to_camera) @ np.vstack([local, np.ones(len(rows))])
    return world[:3].T.astype("<f4").tobytes() + frame.rgb[rows, columns].tobytes()


def _packed(values: npt.NDArray[Any], kind: type[np.generic]) -> str:
    array = np.ascontiguousarray(values, np.dtype(kind).newbyteorder("<"))
    return base64.b64encode(array.tobytes()).decode("ascii")
