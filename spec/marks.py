"""Marks of points in pictures, and the file `annotations.csv` that contains them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

ANNOTATIONS_CSV: Final = "annotations.csv"
COLUMNS: Final = ("picture", "point", "x", "y", "visible", "source")

Source = Literal["marked", "suggested", "confirmed"]
"""Who says so: a person, a method, or a person of what a method suggested."""


@dataclass(frozen=True)
class Mark:
    """Where a point is in a picture.

    Attributes:
        u_px, v_px: Pixels from the corner of the picture; NaN where the position is not given.
        visible: Whether the point is seen there.
        source: Who says so; what a method suggested is not ground truth until a person confirms it.
    """

    u_px: float
    v_px: float
    visible: bool
    source: Source = "marked"


def mark_source(text: Any) -> Source:
    """Return a source by its name.

    Raises:
        ValueError: There is none of this name.
    """
    for source in get_args(Source):
        if text == source:
            return source
    raise ValueError(f"source {text!r}")
