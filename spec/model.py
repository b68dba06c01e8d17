"""What a dataset describes, typed: material coordinates, objects, symmetries, tiers, image pairs.

`dataset.json` and the query tables are converted here once; no other module looks inside them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
TierKind = Literal["rope", "cloth"]


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

    def wrapped(self, difference: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return differences of the coordinate, reduced to half a period where it has one."""
        if self.period is None:
            return difference
        return difference - self.period * np.round(difference / self.period)


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

    def steps_m(self, difference: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return differences (..., 2) of material coordinates in metres, wrapped to the period."""
        return np.stack(
            [
                coordinate.wrapped(difference[..., axis]) * coordinate.metres_per_unit
                for axis, coordinate in enumerate(self.material)
            ],
            axis=-1,
        )

    def distance_m(self, first: npt.NDArray[Any], second: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return distances on the undeformed surface (the object's flat metric).

        Args:
            first: (..., 2), material coordinates; broadcasts with `second`.
            second: (..., 2), material coordinates.

        Returns:
            (...), metres.
        """
        steps = self.steps_m(np.asarray(first) - np.asarray(second))
        distance: npt.NDArray[Any] = np.sqrt((steps**2).sum(axis=-1))
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


@dataclass(frozen=True)
class Tier:
    """A family of one difficulty.

    Attributes:
        name: Unique in the dataset.
        kind: What the queried object is.
        variant: Appearance that the symmetries depend on, such as `plain` or `striped`.
        queried_object: Id of the object that queries are on.
        objects: The objects of its scenes.
        symmetries: Without the identity; every other object is mapped to itself.
    """

    name: str
    kind: TierKind
    variant: str
    queried_object: int
    objects: tuple[MaterialObject, ...]
    symmetries: tuple[Symmetry, ...] = ()

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Tier:
        """Return the tier that an entry of `dataset.json` describes.

        Args:
            document: An entry of `tiers` that conforms to the schema.
        """
        return cls(
            name=document["name"],
            kind=document["kind"],
            variant=document["variant"],
            queried_object=document["queried_object"],
            objects=tuple(
                MaterialObject(
                    entry["id"],
                    entry["name"],
                    (
                        MaterialCoordinate(**entry["material"][0]),
                        MaterialCoordinate(**entry["material"][1]),
                    ),
                )
                for entry in document["objects"]
            ),
            symmetries=tuple(
                Symmetry(
                    entry["name"],
                    (tuple(entry["matrix"][0]), tuple(entry["matrix"][1])),
                    tuple(entry["offset"]),
                )
                for entry in document["symmetries"]
            ),
        )

    def as_document(self) -> dict[str, Any]:
        """Return the entry of `dataset.json`; `from_document` reads it back."""
        return {
            "name": self.name,
            "kind": self.kind,
            "variant": self.variant,
            "queried_object": self.queried_object,
            "objects": [
                {
                    "id": each.id,
                    "name": each.name,
                    "material": [vars(coordinate).copy() for coordinate in each.material],
                }
                for each in self.objects
            ],
            "symmetries": [
                {
                    "name": each.name,
                    "matrix": [list(row) for row in each.matrix],
                    "offset": list(each.offset),
                }
                for each in self.symmetries
            ],
        }

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

    def orbit(self, material: FloatArray) -> FloatArray:
        """Return every material point that looks the same as the given ones.

        Args:
            material: float64 (N, 2).

        Returns:
            float64 (N, 1 + S, 2): the points themselves, then their S images in the tier's order.
        """
        return np.stack([material, *(each.apply(material) for each in self.symmetries)], axis=1)
