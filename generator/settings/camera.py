"""Ranges that a camera is drawn from."""

from __future__ import annotations

from typing import Annotated, Final

from pliant.spec.configuration import configuration
from pliant.spec.constraints import Bounds, NonNegative, Range, Refused

CLEARANCE_M: Final = 0.02
"""A camera keeps at least this far from the table and from the object's box."""

MIN_MARGIN: Final = 0.02
"""Share of the frame that stays free on every side of the object at the start."""


@configuration(frozen=True)
class CameraSettings:
    """Ranges a camera is drawn from, uniformly; (low, high) with low <= high.

    Attributes:
        top: Weight of the view from above.
        oblique: Weight of the view from the side.
        fov_deg: Horizontal field of view, degrees.
        fill: Share of the frame's width or height, whichever is tighter, that the object's
            box takes at the start.
        shift: Share of the free margin by which the object may lie off the centre.
        top_tilt_deg: Angle of the top view against the vertical, degrees.
        top_roll_deg: Roll of the top view about its axis, degrees.
        oblique_elevation_deg: Height of the oblique camera above the table, degrees.
        oblique_azimuth_deg: Where around the object it stands, degrees; 0 is the side -y. None is
            anywhere about a rope, and within 20 degrees for a cloth: a blank square looks the same
            from four sides, and only how it lies in the image says which corner is which.
        oblique_roll_deg: Roll of the oblique view, degrees.
        distance_m: Distance from the object's middle in place of `fill`, or None.
    """

    top: NonNegative = 0.6
    oblique: NonNegative = 0.4
    fov_deg: Annotated[Range, Bounds(5, 120)] = (38.0, 55.0)
    fill: Annotated[Range, Bounds(0.05, 1 - 2 * MIN_MARGIN)] = (0.62, 0.86)
    shift: Annotated[Range, Bounds(0, 1)] = (0.0, 0.7)
    top_tilt_deg: Annotated[Range, Bounds(0, 30)] = (0.0, 4.0)
    top_roll_deg: Annotated[Range, Bounds(-180, 180)] = (-12.0, 12.0)
    oblique_elevation_deg: Annotated[Range, Bounds(5, 90)] = (42.0, 68.0)
    oblique_azimuth_deg: Annotated[Range, Bounds(-360, 360)] | None = None
    oblique_roll_deg: Annotated[Range, Bounds(-180, 180)] = (-4.0, 4.0)
    distance_m: Annotated[Range, Bounds(CLEARANCE_M, 100)] | None = None

    def __post_init__(self) -> None:
        if self.top + self.oblique <= 0:
            raise Refused("above 0 for one of top and oblique", "top")
