"""Where the material point under a pixel truly is in another frame, for any pixel.

Where both frames have surface images, the point is found in the target to a fraction of a pixel. A
point that the target does not show is placed on the mesh of tracked points and projected. A dataset
without surface images has the truth of its queries alone: the nearest query of the pair counts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.errors import SpecError
from pliant.spec.queries import RecordedPair
from pliant.spec.sequence import RecordedFrame
from pliant.viewer.explorer.frames import FrameCache
from pliant.viewer.explorer.recorded import RecordedQueries

_SAME_PX: Final = 2.0
"""Material within so many pixels, seen face on, is the same."""


@dataclass(frozen=True)
class Truth:
    """What is known of the point under a pixel of the source.

    Attributes:
        uv_a_px: float64 (2,), the pixel's centre, or the query that counts for it.
        uv_b_px: float64 (2,), its true place in the target, or None where it is not known.
        visibility: Its state in the target, or None.
        material: Names and values of its material coordinates; empty where they are not known.
        xyz_a_m, xyz_b_m: float64 (3,), its world position in both frames, or None.
        origin: How it is known: `surface`, `points` or `query`.
        partners_px: float64 (S, 2), where the target shows the places that look the same by the
            tier's symmetries, or None where they are not known.
    """

    uv_a_px: FloatArray
    uv_b_px: FloatArray | None
    visibility: str | None
    material: dict[str, float]
    xyz_a_m: FloatArray | None
    xyz_b_m: FloatArray | None
    origin: str
    partners_px: FloatArray | None = None

    def as_document(self) -> dict[str, Any]:
        """Return the truth as JSON values."""
        return {
            "query": rounded(self.uv_a_px),
            "place": rounded(self.uv_b_px),
            "visibility": self.visibility,
            "material": {name: round(value, 5) for name, value in self.material.items()},
            "xyz_a": rounded(self.xyz_a_m, 5),
            "xyz_b": rounded(self.xyz_b_m, 5),
            "origin": self.origin,
            "partners": [] if self.partners_px is None else self.partners_px.round(2).tolist(),
        }


class TruthFinder:
    """Answers any pixel of any pair of frames of a tier.

    Args:
        frames: The dataset's frames.
        queries: Its queries with their truth, for frames without a surface image.
    """

    def __init__(self, frames: FrameCache, queries: RecordedQueries) -> None:
        self._frames, self._queries = frames, queries

    def find(self, pair: RecordedPair) -> Truth | None:
        """Return the truth of the point under a pixel.

        Args:
            pair: The frames and the pixel.

        Returns:
            The truth, or None where the pixel does not show the queried object or nothing is known.
        """
        surface = pair.source.surface
        if surface is None or pair.target.surface is None:
            return self._recorded(pair)
        height, width = surface.object_id.shape
        column, row = np.floor(pair.uv_a_px[0]).astype(int).tolist()
        if not (0 <= column < width and 0 <= row < height):
            return None
        queried = pair.source.sequence.described.queried
        if surface.object_id[row, column] != queried.id:
            return None
        m = np.array([surface.m0[row, column], surface.m1[row, column]], np.float64)
        search = self._frames.search(pair.target)
        assert search is not None
        uv_b, found = search.find(m[None])
        xyz_b, place = self._placed(pair.target, m)
        visible = bool(found[0])
        names = [each.name for each in queried.material]
        symmetries = pair.source.sequence.described.symmetries
        images = np.array([each.apply(m) for each in symmetries]).reshape(-1, 2)
        partners, seen = search.find(images)
        return Truth(
            uv_a_px=np.array([column + 0.5, row + 0.5]),
            uv_b_px=uv_b[0] if visible else place,
            visibility="visible" if visible else self._state(pair.target, m, place),
            material=dict(zip(names, m.tolist(), strict=True)),
            xyz_a_m=self._placed(pair.source, m)[0],
            xyz_b_m=xyz_b,
            origin="surface" if visible else "points",
            partners_px=partners[seen],
        )

    def places(self, pair: RecordedPair) -> FloatArray:
        """Return the true places of pixels that the target shows, for a map of errors.

        Args:
            pair: The frames, both with surface images, and centres of pixels of the queried object.

        Returns:
            float64 (N, 2), NaN where the target does not show the point.
        """
        surface, search = pair.source.surface, self._frames.search(pair.target)
        if surface is None or search is None:
            return np.full((len(pair), 2), np.nan)
        column, row = np.floor(pair.uv_a_px).astype(int).T
        material = np.stack([surface.m0[row, column], surface.m1[row, column]], axis=1)
        return search.find(material.astype(np.float64))[0]

    def _placed(
        self, frame: RecordedFrame, m: FloatArray
    ) -> tuple[FloatArray | None, FloatArray | None]:
        """Return a material point's world position and projection, or None without tracked points.

        A point under the surface of the mesh's triangles is off by their sagitta, a fraction of a
        pixel for a cloth and up to some pixels for a thick rope.
        """
        try:
            mesh, points = self._frames.mesh(frame), self._frames.points(frame)
        except SpecError:
            return None, None
        if not len(mesh.rows):
            return None, None
        chosen, weights = mesh.barycentric(m)
        xyz = weights @ points.xyz_m[chosen].astype(np.float64)
        u, v, z = frame.sequence.camera(frame.index).project(xyz[None])[0]
        return xyz, np.array([u, v]) if z > 0 else None

    def _state(self, frame: RecordedFrame, m: FloatArray, place: FloatArray | None) -> str | None:
        """Return the state of a point that is not found to a fraction of a pixel.

        Args:
            frame: The target.
            m: float64 (2,), its material coordinates.
            place: float64 (2,), where the mesh of tracked points has it.

        Returns:
            `visible` where the pixel there shows the same material: on a narrow strip of surface,
            neighbouring pixels do not say how the material continues. Else why it is hidden.
        """
        surface = frame.surface
        if place is None or surface is None:
            return None
        width, height = frame.size
        if not (0 <= place[0] < width and 0 <= place[1] < height):
            return "out_of_frame"
        column, row = int(place[0]), int(place[1])
        shown, queried = surface.object_id[row, column], frame.sequence.described.queried
        if shown not in (0, queried.id):
            return "occluded"
        there = np.array([surface.m0[row, column], surface.m1[row, column]], np.float64)
        pixel_m = float(surface.depth_m[row, column] / frame.sequence.camera(frame.index).K[0, 0])
        same = shown == queried.id and queried.distance_m(there, m) <= _SAME_PX * pixel_m
        return "visible" if same else "self_occluded"

    def _recorded(self, pair: RecordedPair) -> Truth | None:
        found = self._queries.nearest(pair)
        if found is None:
            return None
        queries, row = found
        if queries.uv_b_px is None or queries.visibility is None:
            return None
        uv_a, uv_b, state = queries.uv_a_px[row], queries.uv_b_px[row], queries.visibility[row]
        return Truth(uv_a, uv_b, str(state), {}, None, None, "query")


def rounded(values: npt.NDArray[Any] | None, digits: int = 3) -> list[float] | None:
    """Return numbers for JSON, or None."""
    return None if values is None else [round(float(x), digits) for x in values]
