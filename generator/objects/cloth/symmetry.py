"""Under which maps of (u, v) a square cloth looks the same, variant by variant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from pliant.generator.settings.cloth import Variant


@dataclass(frozen=True)
class SquareMap:
    """m' = matrix · m + offset on m = (u, v); entries are whole numbers.

    Attributes:
        name: As it stands in the tier.
        matrix: Row by row.
        offset: Added afterwards.
    """

    name: str
    matrix: tuple[tuple[int, int], tuple[int, int]]
    offset: tuple[int, int]

    def as_dict(self) -> dict[str, Any]:
        """Return the map as it stands in `dataset.json`."""
        return {
            "name": self.name,
            "matrix": [list(row) for row in self.matrix],
            "offset": list(self.offset),
        }


_ROTATIONS: Final = (
    SquareMap("rotation_90", ((0, -1), (1, 0)), (1, 0)),
    SquareMap("rotation_180", ((-1, 0), (0, -1)), (1, 1)),
    SquareMap("rotation_270", ((0, 1), (-1, 0)), (0, 1)),
)
_MIRROR_V: Final = SquareMap("mirror_v", ((1, 0), (0, -1)), (0, 1))
_MIRRORS: Final = (
    SquareMap("mirror_u", ((-1, 0), (0, 1)), (1, 0)),
    _MIRROR_V,
    SquareMap("mirror_diagonal", ((0, 1), (1, 0)), (0, 0)),
    SquareMap("mirror_antidiagonal", ((0, -1), (-1, 0)), (1, 1)),
)

SYMMETRIES: Final[dict[Variant, tuple[SquareMap, ...]]] = {
    # Both faces alike: turning the cloth over about an axis in its plane mirrors (u, v).
    "plain": _ROTATIONS + _MIRRORS,
    # A back of another shade tells a turned-over cloth; only rotations remain.
    "two-sided": _ROTATIONS,
    # Bands across u, unequal from end to end, alike on both faces: turning the cloth over
    # about the u axis changes nothing.
    "striped": (_MIRROR_V,),
    # A print that no map leaves alone.
    "printed": (),
}
"""Variant -> its maps, the identity left out."""
