"""A mesh of the tracked points: triangles from their material coordinates, positions per frame.

The files contain no mesh. Tracked points cover the whole material, also where no camera sees it, so
the Delaunay triangulation of their material coordinates (in metres) is a mesh of the object that
needs no rendering. Where a coordinate is periodic, the points are repeated one period to each side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.arrays import FloatArray
from pliant.spec.conventions import VISIBILITY_STATES
from pliant.spec.errors import SpecError
from pliant.spec.io.parquet_columns import codes, stacked
from pliant.spec.model import MaterialObject
from pliant.spec.sequence import RecordedFrame, SequenceRecord


def surface_points(table: pa.Table, queried_object: int) -> npt.NDArray[np.int64]:
    """Return the ids of the queried object's surface points (a centre line is on no pixel).

    Args:
        table: The table of points.
        queried_object: Object id.

    Returns:
        int64 (P,), ascending.
    """
    own = table["object"].to_numpy() == queried_object
    return np.flatnonzero(own & (codes(table["kind"], ("surface",)) == 0))


@dataclass(frozen=True)
class PosedMesh:
    """The triangles of a sequence's tracked surface points.

    Attributes:
        queried: The object that the points are on.
        rows: int64 (N,), the points' rows in the tables of the sequence.
        material: float64 (N, 2), their material coordinates.
    """

    queried: MaterialObject
    rows: npt.NDArray[np.int64]
    material: FloatArray

    @classmethod
    def of(cls, sequence: SequenceRecord) -> PosedMesh:
        """Read the points of a sequence.

        Raises:
            SpecError: The table of points is missing or damaged.
        """
        table = sequence.points()
        queried = sequence.described.queried
        rows = surface_points(table, queried.id)
        return cls(queried, rows, stacked(table, "m0", "m1")[rows].astype(np.float64))

    @cached_property
    def faces(self) -> npt.NDArray[np.int32]:
        """Numbers of points, int32 (F, 3); empty where there are too few points."""
        return triangulate(self.queried, self.material)

    def barycentric(self, material: FloatArray) -> tuple[npt.NDArray[np.int64], FloatArray]:
        """Return which points surround a material point, and their weights.

        Args:
            material: float64 (2,).

        Returns:
            int64 (K,) and float64 (K,): the three nearest points with weights that reproduce the
            coordinate where they are a triangle around it, else the nearest one.
        """
        steps = self.queried.steps_m(self.material - material)  # (N, 2), metres
        corners = steps[self.faces]  # (F, 3, 2)
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        areas = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)  # (F, 3)
        total = areas.sum(axis=1, keepdims=True)
        weights = areas / np.where(np.abs(total) > 1e-15, total, np.inf)
        contains = (weights.min(axis=1, initial=1.0) >= -1e-6) & (weights.sum(axis=1) > 0.5)
        if contains.any():
            # A triangle on the far side of a closed coordinate is torn apart, so not the smallest.
            reach = np.linalg.norm(corners, axis=2).max(axis=1)
            best = int(np.where(contains, reach, np.inf).argmin())
            return self.faces[best].astype(np.int64), weights[best]
        nearest = int((steps**2).sum(axis=1).argmin())
        return np.array([nearest]), np.ones(1)


@dataclass(frozen=True)
class PosedPoints:
    """Where the points of a mesh are in one frame.

    Attributes:
        xyz_m: float32 (N, 3), world positions, metres.
        uv_px: float32 (N, 2).
        state: uint8 (N,), numbers of `VISIBILITY_STATES`.
    """

    xyz_m: npt.NDArray[np.float32]
    uv_px: npt.NDArray[np.float32]
    state: npt.NDArray[np.uint8]

    @classmethod
    def of(cls, frame: RecordedFrame, mesh: PosedMesh) -> PosedPoints:
        """Read the positions of a mesh's points in a frame.

        Raises:
            SpecError: The table of correspondences is missing or damaged.
        """
        table = frame.correspondences
        xyz, uv = stacked(table, "x_m", "y_m", "z_m"), stacked(table, "u_px", "v_px")
        states, rows = states_of(table, frame.key), mesh.rows
        return cls(xyz[rows], uv[rows], states[rows])


def states_of(correspondences: pa.Table, where: str) -> npt.NDArray[np.uint8]:
    """Return the state of every row, uint8 (N,), numbers of `VISIBILITY_STATES`.

    Args:
        correspondences: A table of correspondences.
        where: Its sequence or frame, for the message.

    Raises:
        SpecError: A state is none of the specification's.
    """
    states = codes(correspondences["visibility"], VISIBILITY_STATES)
    if (states < 0).any():
        raise SpecError(
            "unknown state of visibility",
            where=where,
            found=correspondences["visibility"][int(np.argmin(states))].as_py(),
            required=", ".join(VISIBILITY_STATES),
        )
    return states.astype(np.uint8)


def triangulate(queried: MaterialObject, material: FloatArray) -> npt.NDArray[np.int32]:
    """Return the Delaunay triangles of material points.

    Args:
        queried: Their object; its periods close the surface.
        material: float64 (N, 2).

    Returns:
        int32 (F, 3); F = 0 for fewer than three points, or points on one line.
    """
    from scipy.spatial import Delaunay, QhullError

    units = np.array([each.metres_per_unit for each in queried.material])
    copies = [material]
    for axis, coordinate in enumerate(queried.material):
        if coordinate.period is not None:
            step = np.eye(2)[axis] * coordinate.period
            copies = [moved for each in copies for moved in (each, each - step, each + step)]
    points = np.concatenate(copies) * units
    try:
        found = Delaunay(points).simplices
    except (QhullError, ValueError):
        return np.zeros((0, 3), np.int32)
    count = len(material)
    # Of the copies of one triangle, that whose centre is in the original period is kept.
    centre = points[found].mean(axis=1)
    keep = np.ones(len(found), bool)
    for axis, coordinate in enumerate(queried.material):
        if coordinate.period is not None:
            low = coordinate.min * units[axis]
            keep &= (centre[:, axis] >= low) & (
                centre[:, axis] < low + coordinate.period * units[axis]
            )
    faces = (found[keep] % count).astype(np.int32)
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return np.ascontiguousarray(faces[distinct])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    crossed: FloatArray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return crossed
