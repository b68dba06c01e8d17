"""The truth of one frame: what every pixel shows, and where every material point is.

Both come from the same vertices: the surface image by exact rasterisation, the points by
projection and ray casting. No renderer has a part in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pliant.generator.scene.scene_object import Pose, SceneMesh, SceneObject
from pliant.generator.truth.rasteriser import Hits, interpolate, rasterise, rest_seen
from pliant.generator.truth.visibility import first_occluders, inside_frame
from pliant.spec.arrays import FloatArray, Int32Array, IntArray
from pliant.spec.camera import Camera
from pliant.spec.conventions import VISIBILITY_STATES
from pliant.spec.io.exr import Surface

_VISIBLE, _SELF_OCCLUDED, _OCCLUDED, _OUT_OF_FRAME = VISIBILITY_STATES


@dataclass(frozen=True)
class FrameTruth:
    """The exact answers of one frame.

    Attributes:
        surface: Depth, material coordinates and object id of every pixel.
        uv_px: float64 (P, 2), where each point of the scene object projects to.
        depth_m: float64 (P,), planar z of each point.
        visibility: Per point one of the specification's visibility states.
        xyz_m: float64 (P, 3), world positions.
        hits: The triangle under each pixel's centre.
        world_vertices: float64 (V, 3), the vertices of all parts, as rendered.
    """

    surface: Surface
    uv_px: FloatArray
    depth_m: FloatArray
    visibility: list[str]
    xyz_m: FloatArray
    hits: Hits
    world_vertices: FloatArray


def frame_truth(scene_object: SceneObject, pose: Pose, camera: Camera) -> FrameTruth:
    """Work out the truth of one frame.

    Args:
        scene_object: The sequence's object and points.
        pose: The frame's geometry.
        camera: The frame's camera.

    Returns:
        The surface image and, row by row of `scene_object.points`, the point table's columns.
    """
    mesh = SceneMesh.of(scene_object)
    world = mesh.vertices(pose)
    local = camera.to_camera(world)
    hits = rasterise(camera, local, mesh.faces)
    xyz_m, own_edge = _point_positions(scene_object, pose, mesh, world)
    point_local = camera.to_camera(xyz_m)
    uvz = camera.to_pixels(point_local)
    states = np.full(len(uvz), _VISIBLE, dtype="<U13")
    inside = inside_frame(camera, uvz)
    states[~inside] = _OUT_OF_FRAME
    rows = np.flatnonzero(inside)
    if len(rows):
        triangle, weights = first_occluders(
            camera, point_local[rows], own_edge[rows], local, mesh.faces
        )
        states[rows] = _states(scene_object, mesh, rows, triangle, weights)
    surface = surface_image(scene_object, mesh, hits)
    return FrameTruth(surface, uvz[:, :2], uvz[:, 2], states.tolist(), xyz_m, hits, world)


def surface_image(scene_object: SceneObject, mesh: SceneMesh, hits: Hits) -> Surface:
    """Turn hits into depth, material coordinates and object ids.

    The rest coordinates are interpolated and the part's chart is applied afterwards, so that a
    coordinate with a seam (a rope's theta) is exact on the triangles across it too.

    Args:
        scene_object: The parts.
        mesh: Their joined topology.
        hits: The triangle under each pixel's centre.
    """
    shape = hits.triangle.shape
    depth = hits.depth_m.astype(np.float32)
    material = np.zeros((2, *shape), np.float32)
    object_id = np.zeros(shape, np.uint32)
    for part, faces, _ in mesh.parts:
        at, rest = rest_seen(hits, faces.start, faces.stop, part.faces, part.rest)
        m = part.chart(rest)
        material[0].ravel()[at] = m[:, 0]
        material[1].ravel()[at] = m[:, 1]
        object_id.ravel()[at] = part.object_id
    return Surface(depth, material[0], material[1], object_id)


def _point_positions(
    scene_object: SceneObject, pose: Pose, mesh: SceneMesh, world: FloatArray
) -> tuple[FloatArray, Int32Array]:
    """Return each point's world position and the ends of its edge: rows, -1 for none."""
    points = scene_object.points
    ends = points.vertex if points.other is None else points.other
    own = np.full((len(points.vertex), 2), -1, np.int32)
    xyz = np.empty((len(points.vertex), 3))
    for part, _, rows in mesh.parts:
        mine = (points.object_id == part.object_id) & ~points.centreline
        own[mine] = np.stack([points.vertex, ends], axis=1)[mine] + rows.start
    surface = own[:, 0] >= 0
    xyz[surface] = world[own[surface, 0]]
    if points.share is not None:
        share = points.share[surface, None]
        xyz[surface] = (1.0 - share) * xyz[surface] + share * world[own[surface, 1]]
    if not bool(surface.all()):
        assert pose.centreline is not None  # there are centre-line points
        line = pose.centreline.astype(np.float32).astype(np.float64)
        xyz[~surface] = line[points.vertex[~surface]]
    return xyz, own


def _states(
    scene_object: SceneObject,
    mesh: SceneMesh,
    rows: IntArray,
    triangle: Int32Array,
    weights: FloatArray,
) -> npt.NDArray[np.str_]:
    """Name the state of points inside the frame from the first triangle before each."""
    points = scene_object.points
    states = np.full(len(rows), _VISIBLE, dtype="<U13")
    hidden = triangle >= 0
    object_id = np.zeros(len(rows), np.int32)
    for part, faces, _ in mesh.parts:
        object_id[(triangle >= faces.start) & (triangle < faces.stop)] = part.object_id
    same = hidden & (object_id == points.object_id[rows])
    states[hidden & ~same] = _OCCLUDED
    states[same] = _SELF_OCCLUDED
    # A point of the centre line is under the surface and is never seen itself. It counts as
    # visible where the surface seen in its place is the rope's own, within one diameter of it.
    line = np.flatnonzero(same & points.centreline[rows])
    for part, faces, _ in mesh.parts:
        at = line[(triangle[line] >= faces.start) & (triangle[line] < faces.stop)]
        own = triangle[at] - np.int32(faces.start)
        s_seen = part.chart(interpolate(own, weights[at], part.faces, part.rest))[:, 0]
        s_own = points.material[rows[at], 0]
        near = np.abs(s_seen - s_own) * scene_object.size_m <= scene_object.thickness_m
        states[at[near]] = _VISIBLE
    return states
