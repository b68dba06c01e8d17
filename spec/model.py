"""What a dataset describes, typed: material coordinates, objects, symmetries, tiers, image pairs.

`dataset.json` and the query tables are converted here once; no other module looks inside them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray


@dataclass(frozen=True)
class MaterialCoordinate:
    """One of the two coordinates of an object's undeformed surface.

    Attributes:
        name: Such as `s`, `theta`, `u`, `v`.
        min: Smallest value.
        max: Largest value.
        metres_per_unit: Length of one unit on the undeformed material, metres.
        period: Period of a coordinate that closes on itself (an angle), else None.
    """

    name: str
    min: float
    max: float
    metres_per_unit: float
    period: float | None = None

    @property
    def span(self) -> float:
        """Length of the range, in the coordinate's unit."""
        return self.max - self.min

    def contains(self, values: npt.NDArray[Any], share: float = 0.0) -> npt.NDArray[np.bool_]:
        """Return which values are in the range, widened at both ends by a share of its length."""
        slack = share * self.span
        inside: npt.NDArray[np.bool_] = (values >= self.min - slack) & (values <= self.max + slack)
        return inside

    def wrapped(self, difference: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return differences of the coordinate, reduced to half a period where it has one."""
        if self.period is None:
            return difference
        return difference - self.period * np.round(difference / self.period)


DISTRACTOR: Final = "distractor"
"""Names of objects that are in the scene by chance begin with it."""


@dataclass(frozen=True)
class MaterialObject:
    """One object of a tier's scenes.

    Attributes:
        id: Its value in the surface layer and in the point table.
        name: Such as `rope`, `ball`, `cloth`.
        material: Its coordinates m0 and m1.
    """

    id: int
    name: str
    material: tuple[MaterialCoordinate, MaterialCoordinate]

    @property
    def diameter_m(self) -> float:
        """Diameter of a tube: the length of a closed m1 over pi; 0 if m1 is not closed."""
        second = self.material[1]
        return 0.0 if second.period is None else second.period * second.metres_per_unit / np.pi

    def wrapped(self, difference: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return differences (..., 2) of material coordinates, reduced to half a period."""
        # Stored one coordinate after the other: numpy is slow along an axis of 2.
        coordinates = [each.wrapped(difference[..., n]) for n, each in enumerate(self.material)]
        return np.moveaxis(np.stack(coordinates), 0, -1)

    def steps_m(self, difference: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return differences (..., 2) of material coordinates in metres, wrapped to the period."""
        units = np.array([each.metres_per_unit for each in self.material])
        kind = np.result_type(difference.dtype, np.float32)
        steps: npt.NDArray[Any] = self.wrapped(difference) * units.astype(kind)
        return steps

    def distance_m(self, first: npt.NDArray[Any], second: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return distances on the undeformed surface (the object's flat metric).

        Args:
            first: (..., 2), material coordinates; broadcasts with `second`.
            second: (..., 2), material coordinates.

        Returns:
            (...), metres.
        """
        steps = self.steps_m(np.asarray(first) - np.asarray(second))
        squared = steps**2
        distance: npt.NDArray[Any] = np.sqrt(squared[..., 0] + squared[..., 1])
        return distance


@dataclass(frozen=True)
class Symmetry:
    """A map m' = matrix · m + offset of the material under which the queried object looks the same.

    Attributes:
        name: Unique in the tier, such as `reversal`, `rotation_90`.
        matrix: 2x2, rows first.
        offset: Added after the product.
    """

    name: str
    matrix: tuple[tuple[float, float], tuple[float, float]]
    offset: tuple[float, float]

    def apply(self, material: FloatArray) -> FloatArray:
        """Return the images of material coordinates, float64 (..., 2)."""
        return material @ np.array(self.matrix, float).T + np.array(self.offset, float)


SQUARE_ROTATIONS: Final = (
    Symmetry("rotation_90", ((0, -1), (1, 0)), (1, 0)),
    Symmetry("rotation_180", ((-1, 0), (0, -1)), (1, 1)),
    Symmetry("rotation_270", ((0, 1), (-1, 0)), (0, 1)),
)
SQUARE_MIRRORS: Final = (
    Symmetry("mirror_u", ((-1, 0), (0, 1)), (1, 0)),
    Symmetry("mirror_v", ((1, 0), (0, -1)), (0, 1)),
    Symmetry("mirror_diagonal", ((0, 1), (1, 0)), (0, 0)),
    Symmetry("mirror_antidiagonal", ((0, -1), (-1, 0)), (1, 1)),
)
"""With the identity, these and the rotations map the unit square onto itself."""

RECTANGLE_SYMMETRIES: Final = (SQUARE_ROTATIONS[1], *SQUARE_MIRRORS[:2])
"""With the identity, these map a rectangle onto itself whose sides along u and v differ."""


@dataclass(frozen=True)
class Tier:
    """A family of one difficulty.

    Attributes:
        name: Unique in the dataset.
        kind: What the queried object is: `rope`, `cloth`, or another name.
        variant: Appearance that the symmetries depend on, such as `plain` or `striped`.
        queried_object: Id of the object that queries are on.
        objects: The objects of its scenes.
        symmetries: Without the identity; every other object is mapped to itself.
    """

    name: str
    kind: str
    variant: str
    queried_object: int
    objects: tuple[MaterialObject, ...]
    symmetries: tuple[Symmetry, ...] = ()

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Tier:
        """Return the tier that an entry of `dataset.json` describes.

        Args:
            document: An entry of `tiers` that conforms to the schema; fields of a newer minor
                version are left out.
        """
        # By hand: pydantic, which would do the same, takes a tenth of a second to import.
        return cls(
            document["name"],
            document["kind"],
            document["variant"],
            document["queried_object"],
            tuple(_material_object(each) for each in document["objects"]),
            tuple(_symmetry(each) for each in document["symmetries"]),
        )

    def as_document(self) -> dict[str, Any]:
        """Return the entry of `dataset.json`; `from_document` reads it back."""
        return asdict(self)

    def object(self, object_id: int) -> MaterialObject:
        """Return one of the tier's objects.

        Raises:
            KeyError: The tier has no object of this id.
        """
        for each in self.objects:
            if each.id == object_id:
                return each
        raise KeyError(f"tier {self.name!r} has no object {object_id}")

    @property
    def queried(self) -> MaterialObject:
        """The object that queries are on."""
        return self.object(self.queried_object)


def _material_object(entry: Mapping[str, Any]) -> MaterialObject:
    first, second = map(_coordinate, entry["material"])
    return MaterialObject(entry["id"], entry["name"], (first, second))


def _coordinate(entry: Mapping[str, Any]) -> MaterialCoordinate:
    period = entry["period"]
    return MaterialCoordinate(
        entry["name"],
        float(entry["min"]),
        float(entry["max"]),
        float(entry["metres_per_unit"]),
        None if period is None else float(period),
    )


def _symmetry(entry: Mapping[str, Any]) -> Symmetry:
    first, second = ((float(a), float(b)) for a, b in entry["matrix"])
    a, b = map(float, entry["offset"])
    return Symmetry(entry["name"], (first, second), (a, b))
