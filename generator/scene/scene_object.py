"""What a tier hands to the renderer: parts, points and the vertices of each frame.

A tier's sampler (rope, cloth) knows shapes and physics; truth, styles and the writer know
cameras and files. A `SceneObject` is all that passes between them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np

from pliant.spec.arrays import BoolArray, Float32Array, FloatArray, Int32Array

GRIPPER: Final = "gripper"
"""Name of the part that `generator.objects.gripper` adds."""

Chart = Callable[[FloatArray], FloatArray]
"""Maps rest coordinates (N, 3) to material coordinates (N, 2)."""


@dataclass(frozen=True)
class Part:
    """One object of a scene: topology and rest coordinates, which no frame changes.

    Attributes:
        object_id: 1 for the rope or the cloth, 2 for the rope's ball, the next for a gripper or
            for distractors.
        name: `rope`, `ball`, `cloth`, `gripper` or `distractor-1` and so on.
        faces: int32 (F, 3), vertex indices, outward winding where there is an outside.
        rest: float64 (V, 3), coordinates in the undeformed object. They are continuous over
            every triangle, so that interpolating them inside one is exact; the chart turns
            them into material coordinates afterwards (a rope's theta thus has no seam).
        chart: rest (N, 3) -> material (N, 2).
        strand: int32 (V,), which strand (or 0) a vertex belongs to; the appearances colour by it.
        double_sided: True for a sheet whose back can be seen.
        colour: Linear reflectance of scenery, which the camera does not frame: a gripper or a
            distractor. None for the object itself, whose colours are the appearance's.
    """

    object_id: int
    name: str
    faces: Int32Array
    rest: FloatArray
    chart: Chart
    strand: Int32Array
    double_sided: bool = False
    colour: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Points:
    """The named material points of a scene object.

    A surface point is a vertex of a part, or is on an edge between two vertices; a centre-line
    point is a row of the frame's centre line. Ids are the row numbers.

    Attributes:
        object_id: int32 (P,).
        vertex: int32 (P,), row in the part's vertices (surface) or in the centre line.
        centreline: bool (P,), True for a centre-line point.
        material: float32 (P, 2).
        partners: int32 (P, S), per symmetry of the tier the point it is mapped to.
        other: int32 (P,), second vertex of the edge of a surface point, or None if every surface
            point is a vertex.
        share: float64 (P,), 0 to 1, how far along the edge, or None.
    """

    object_id: Int32Array
    vertex: Int32Array
    centreline: BoolArray
    material: Float32Array
    partners: Int32Array
    other: Int32Array | None = None
    share: FloatArray | None = None


@dataclass(frozen=True)
class Pose:
    """The deformed geometry of one frame.

    Attributes:
        vertices: part name -> float64 (V, 3), world metres, table at z = 0, z up.
        centreline: float64 (M, 3) world metres, or None for a cloth.
        info: JSON-able facts of this frame (crossings, coverage, action …).
    """

    vertices: Mapping[str, FloatArray]
    centreline: FloatArray | None = None
    info: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class SceneObject:
    """One sequence before it is seen by a camera.

    Attributes:
        tier: Tier name.
        kind: `rope` or `cloth`.
        shape: Named shape or None.
        temporal: True for an episode.
        frames: Number of frames.
        parts: The objects, the queried one first.
        points: The named material points.
        pose: frame index -> Pose; called once per frame in ascending order.
        size_m: Rope length, or the cloth's length along u, metres.
        thickness_m: Rope diameter or cloth thickness, metres.
        info: JSON-able parameters kept in `sequence.json` (control points, handles, actions …).
        variant: What is on it: `plain`; a cloth also `towel`, or `printed` and the number of the
            design, as in `Appearance.pattern`.
        proportion: A cloth's length along v over its length along u.
    """

    tier: str
    kind: Literal["rope", "cloth"]
    shape: str | None
    temporal: bool
    frames: int
    parts: tuple[Part, ...]
    points: Points
    pose: Callable[[int], Pose]
    size_m: float
    thickness_m: float
    info: Mapping[str, Any] = field(default_factory=dict)
    variant: str = "plain"
    proportion: float = 1.0


def quads(a: Int32Array, b: Int32Array, c: Int32Array, d: Int32Array) -> Int32Array:
    """Return the two triangles, abc and acd, of every cell of a grid.

    Args:
        a: int (...), the first corner of each cell; b, c and d follow around it.
        b: int (...).
        c: int (...).
        d: int (...).

    Returns:
        int32 (2 N, 3).
    """
    pairs = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=-2)
    return pairs.reshape(-1, 3).astype(np.int32)


@dataclass(frozen=True)
class SceneMesh:
    """The topology of a scene object's parts, one after the other.

    Attributes:
        faces: int32 (F, 3), rows of the joined vertices.
        parts: Each part with the slices of its faces and of its vertices.
    """

    faces: Int32Array
    parts: tuple[tuple[Part, slice, slice], ...]

    @classmethod
    def of(cls, scene_object: SceneObject) -> SceneMesh:
        """Join the parts of a scene object."""
        first_face = first_vertex = 0
        faces, parts = [], []
        for part in scene_object.parts:
            last_face, last_vertex = first_face + len(part.faces), first_vertex + len(part.rest)
            faces.append(part.faces + np.int32(first_vertex))
            parts.append((part, slice(first_face, last_face), slice(first_vertex, last_vertex)))
            first_face, first_vertex = last_face, last_vertex
        return cls(np.ascontiguousarray(np.concatenate(faces), np.int32), tuple(parts))

    def vertices(self, pose: Pose) -> FloatArray:
        """Return the world positions of a pose, rounded to what the files can hold.

        Files and Blender keep float32. Rounding once, here, makes the rendered surface, the
        truth and the tabulated positions one and the same mesh.

        Args:
            pose: The frame's geometry.

        Returns:
            float64 (V, 3), world metres, every value a float32.
        """
        parts = [pose.vertices[part.name] for part, _, _ in self.parts]
        return np.concatenate(parts).astype(np.float32).astype(np.float64)
