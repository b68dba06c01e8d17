"""What every target is made of: a sequence with its tracked points as arrays over all frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pliant.spec.conventions import VISIBLE
from pliant.spec.point_mesh import PosedMesh, states_of
from pliant.spec.sequence import SequenceRecord


@dataclass(frozen=True)
class Options:
    """What a conversion is asked for.

    Attributes:
        points: Most tracked points of a sequence; None for all. Fewer are spread over the object.
        frame_rate_hz: Frames per second of targets with a clock: a dataset has no times.
    """

    points: int | None = None
    frame_rate_hz: float = 15.0


@dataclass(frozen=True, eq=False)
class Recording:
    """A sequence and its tracked surface points of the queried object.

    Attributes:
        sequence: The sequence.
        mesh: The points' material coordinates and their triangles.
        chosen: int64 (N,), numbers of the mesh's points that are converted.
        uv_px: float32 (T, N, 2), where the points are in the T frames, centre of the first pixel
            at (0.5, 0.5).
        xyz_m: float32 (T, N, 3), world positions, metres.
        state: uint8 (T, N), numbers of `VISIBILITY_STATES`.
    """

    sequence: SequenceRecord
    mesh: PosedMesh
    chosen: npt.NDArray[np.int64]
    uv_px: npt.NDArray[np.float32]
    xyz_m: npt.NDArray[np.float32]
    state: npt.NDArray[np.uint8]

    @classmethod
    def of(cls, sequence: SequenceRecord, points: int | None = None) -> Recording:
        """Read a sequence.

        Args:
            sequence: The sequence.
            points: Most points to keep; None for all.

        Raises:
            SpecError: Its points or correspondences are missing or damaged.
        """
        mesh = PosedMesh.of(sequence)
        count = len(mesh.rows)
        chosen = np.arange(count)
        if points is not None and points < count:
            chosen = spread(mesh, points)
        table = sequence.correspondences()
        state = states_of(table, sequence.id)

        def of_frames(*names: str) -> npt.NDArray[np.float32]:
            columns = [table[name].to_numpy().astype(np.float32) for name in names]
            all_points = np.stack(columns, axis=-1).reshape(sequence.frames, -1, len(names))
            kept: npt.NDArray[np.float32] = all_points[:, mesh.rows[chosen]]
            return kept

        return cls(
            sequence,
            mesh,
            chosen,
            of_frames("u_px", "v_px"),
            of_frames("x_m", "y_m", "z_m"),
            state.reshape(sequence.frames, -1)[:, mesh.rows[chosen]],
        )

    @property
    def material(self) -> npt.NDArray[np.float64]:
        """Material coordinates of the points, float64 (N, 2)."""
        return self.mesh.material[self.chosen]

    @property
    def visible(self) -> npt.NDArray[np.bool_]:
        """Which points a camera sees, bool (T, N)."""
        return self.state == VISIBLE


def spread(mesh: PosedMesh, count: int) -> npt.NDArray[np.int64]:
    """Return points that are far from each other on the material, int64 (count,), ascending.

    Point 0, then again and again the point that is farthest from those before (Gonzalez 1985).

    Args:
        mesh: The points.
        count: How many, 1 to all.
    """
    chosen = [0]
    nearest_m = mesh.queried.distance_m(mesh.material, mesh.material[0])
    while len(chosen) < count:
        chosen.append(int(nearest_m.argmax()))
        last = mesh.material[chosen[-1]]
        nearest_m = np.minimum(nearest_m, mesh.queried.distance_m(mesh.material, last))
    return np.sort(np.array(chosen, np.int64))


def shares_of_range(recording: Recording) -> npt.NDArray[np.float32]:
    """Return material coordinates as shares of their ranges, float32 (N, 2), 0 to 1."""
    axes = recording.mesh.queried.material
    shares = [(recording.material[:, i] - axis.min) / axis.span for i, axis in enumerate(axes)]
    return np.stack(shares, axis=1).astype(np.float32)


def colours(recording: Recording) -> npt.NDArray[np.uint8]:
    """Return a colour per point that changes along the material, uint8 (N, 3): red m0, green m1."""
    first, second = shares_of_range(recording).T
    rgb = np.stack([first, second, 1 - first], axis=1)
    return np.clip(np.rint(255 * rgb), 0, 255).astype(np.uint8)
