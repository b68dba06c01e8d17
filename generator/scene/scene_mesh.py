"""All parts of a scene object as one list of triangles, for the rasteriser and the shaders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.generator.scene.scene_object import FloatArray, IntArray, Pose, SceneObject


@dataclass(frozen=True)
class SceneMesh:
    """The topology of a scene object's parts, one after the other.

    Attributes:
        faces: int32 (F, 3), rows of the joined vertices.
        face_starts: Per part its first face, and last the number of faces.
        vertex_starts: Per part its first vertex, and last the number of vertices.
        names: The parts' names in that order.
    """

    faces: IntArray
    face_starts: tuple[int, ...]
    vertex_starts: tuple[int, ...]
    names: tuple[str, ...]

    @classmethod
    def of(cls, scene_object: SceneObject) -> SceneMesh:
        """Join the parts of a scene object."""
        face_starts, vertex_starts, faces = [0], [0], []
        for part in scene_object.parts:
            faces.append(part.faces + np.int32(vertex_starts[-1]))
            face_starts.append(face_starts[-1] + len(part.faces))
            vertex_starts.append(vertex_starts[-1] + len(part.rest))
        joined = np.ascontiguousarray(np.concatenate(faces), np.int32)
        names = tuple(part.name for part in scene_object.parts)
        return cls(joined, tuple(face_starts), tuple(vertex_starts), names)

    def vertices(self, pose: Pose) -> FloatArray:
        """Return the world positions of a pose, rounded to what the files can hold.

        Files and Blender keep float32. Rounding once, here, makes the rendered surface, the
        truth and the tabulated positions one and the same mesh.

        Args:
            pose: The frame's geometry.

        Returns:
            float64 (V, 3), world metres, every value a float32.
        """
        parts = [pose.vertices[name] for name in self.names]
        return np.concatenate(parts).astype(np.float32).astype(np.float64)
