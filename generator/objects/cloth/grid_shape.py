"""How many vertices a cloth's grid has along v and along u."""

from __future__ import annotations

from typing import NamedTuple


class GridShape(NamedTuple):
    """A grid of equally spaced vertices.

    Attributes:
        rows: Vertices along v, >= 2.
        columns: Vertices along u, >= 2.
    """

    rows: int
    columns: int

    @property
    def vertices(self) -> int:
        """Number of vertices."""
        return self.rows * self.columns

    @property
    def proportion(self) -> float:
        """Length along v over the length along u, exactly 1 for a square."""
        return (self.rows - 1) / (self.columns - 1)
