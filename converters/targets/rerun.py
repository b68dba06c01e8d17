"""Rerun: a recording (`.rrd`) per sequence, to be opened by `rerun FOLDER/*.rrd`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pliant.converters.targets.recording import Options, Recording, colours
from pliant.spec.sequence import RecordedFrame, SequenceRecord

POINT_RADIUS_M = 0.002


def write(sequences: Iterable[SequenceRecord], folder: Path, options: Options) -> Iterator[None]:
    """Write a recording per sequence, on a timeline `frame`.

    `world/camera` is the camera with `rgb`, `depth` (metres, 0 where nothing is seen), `mask` and
    the visible `points`; `world/points` are the points in metres, `world/surface` their mesh. The
    colour of a point comes from its material coordinates.
    """
    import rerun as rr

    for sequence in sequences:
        recording = Recording.of(sequence, options.points)
        # Recordings of one application share its layout of views.
        stream = rr.new_recording(f"pliant {sequence.tier}", recording_id=sequence.id)
        encoded = rr.binary_stream(recording=stream)
        # Written here: Rerun's own writer only logs that a disk is full.
        with open(folder / f"{sequence.id}.rrd", "wb") as file:
            rr.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, recording=stream)
            for frame in sequence:
                _set_frame(rr, stream, frame.index)
                for name, value in _entities(rr, recording, frame).items():
                    rr.log(name, value, recording=stream)
                file.write(encoded.read() or b"")
            rr.disconnect(recording=stream)
            file.write(encoded.read() or b"")
        yield


def _set_frame(rr: Any, stream: Any, frame: int) -> None:
    """Set the time, which Rerun renamed in its version 0.23."""
    if hasattr(rr, "set_time"):
        rr.set_time("frame", sequence=frame, recording=stream)
    else:
        rr.set_time_sequence("frame", frame, recording=stream)


def _entities(rr: Any, recording: Recording, frame: RecordedFrame) -> dict[str, Any]:
    index = frame.index
    camera, surface = recording.sequence.camera(index), recording.sequence.surface(index)
    rotation, translation = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
    seen = recording.visible[index]
    shades = colours(recording)
    xyz = recording.xyz_m[index]
    entities = {
        "world/camera": rr.Transform3D(mat3x3=rotation.T, translation=-rotation.T @ translation),
        "world/camera/image": rr.Pinhole(
            image_from_camera=camera.K, resolution=camera.size, camera_xyz=rr.ViewCoordinates.RDF
        ),
        "world/camera/image/rgb": rr.Image(frame.rgb),
        "world/camera/image/depth": rr.DepthImage(
            np.where(np.isfinite(surface.depth_m), surface.depth_m, 0), meter=1.0
        ),
        "world/camera/image/objects": rr.SegmentationImage(surface.object_id),
        "world/camera/image/points": rr.Points2D(
            recording.uv_px[index][seen], colors=shades[seen], radii=1.5
        ),
        "world/points": rr.Points3D(xyz, colors=shades, radii=POINT_RADIUS_M),
    }
    if len(recording.chosen) == len(recording.mesh.rows):  # triangles name all points
        entities["world/surface"] = rr.Mesh3D(
            vertex_positions=xyz, triangle_indices=recording.mesh.faces, vertex_colors=shades
        )
    return entities
