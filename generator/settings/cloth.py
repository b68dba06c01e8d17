"""Settings of the cloth tiers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Final, Literal, Self

from pydantic import model_validator

from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds, Range, Refused, Share

if TYPE_CHECKING:
    from pliant.generator.objects.cloth.simulator import Sheet

Variant = Literal["plain", "towel", "printed"]

COVERAGE_BANDS: Final[dict[int, tuple[float, float]]] = {
    1: (0.70, 0.90),
    2: (0.45, 0.65),
    3: (0.25, 0.42),
}
"""Level -> accepted silhouette area over flat area."""

LARGEST_HAND_SPEED_M_S: Final = 3.0
"""Fastest hand the simulator is tested with."""

_STABILITY: Final = 0.2
"""ks dt² / m of the tiers. The stiffest mode of the grid, neighbours against each other with
structural and shear springs adding up to 8 ks / m, is stable below 0.5."""

_FRAMES_PER_SECOND: Final = 30

_CLOSE: Final = 0.1
"""Share by which a cloth's proportion may differ from the setting."""


class ClothSettings(Settings):
    """How a cloth is made, shaped and handed on.

    Attributes:
        level: 1 smooth, 2 wrinkled and folded, 3 heavily scrunched; None takes the digit at
            the end of the tier's name (`cloth-2`), and 2 for the tier `towel`.
        variant: `plain` (one colour), or `towel` (a hem and two stripes; the tier `towel` always
            has it), or `printed` (stripes or checks on some, discs, bars and rings, a stitched hem,
            a tag; paler on the back).
        design: Number of the print of all sequences, whose colours are the sequence's own.
        side_m: Length along u, metres.
        proportion: Length along v over the length along u; 1 is a square. It is rounded so that all
            points have one spacing: with the other defaults to a sixteenth. `metres_per_unit` of
            the tier is exact.
        points_a_side: Point masses along u.
        doublings: How often the simulated cells are halved for rendering.
        smoothing: How far a mass goes towards the average of its neighbours before the rendered
            surface is laid through it, 0 to 1; it takes out the dimples of the contact.
        tracked_a_side: Named material points along u; its steps must divide the rendered
            grid's.
        thickness_m: Thickness of the cloth; a cloth on the table is at half of it.
        contact_spacings: Distance at which two layers touch, in spacings of the masses.
        density: kg/m².
        ks: Stiffness of structural and shear springs, N/m.
        bending_ratio: Stiffness of bending springs over `ks`.
        damping_percent: Motion lost per 1/2700 s, percent.
        cloth_friction: Coulomb's coefficient between layers.
        table_friction: Coulomb's coefficient on the table.
        hand_speed_m_s: Highest speed of the hand.
        coverage_band: Accepted silhouette coverage; None takes the level's.
        yaw_max_rad: The finished cloth is turned by up to this angle either way.
        sides: `any`, or `alternate`: sequences of even number show more of the cloth's upper side,
            the others more of its underside. Episodes take `any`.
        max_tries: Configurations tried for one frame before giving up.
    """

    level: Annotated[int, Bounds(1, 3)] | None = None
    variant: Variant = "plain"
    design: Annotated[int, Bounds(0, 2**31 - 1)] = 0
    side_m: Annotated[float, Bounds(0.05, 5)] = 0.6
    proportion: Annotated[float, Bounds(0.4, 2.5)] = 1.0
    points_a_side: Annotated[int, Bounds(9, 257)] = 81
    doublings: Annotated[int, Bounds(0, 3)] = 1
    smoothing: Share = 1.0
    tracked_a_side: Annotated[int, Bounds(2)] = 33
    thickness_m: Annotated[float, Bounds(1e-5)] = 0.002
    # Below 0.8 spacings a mass fits through a stretched cell; above 1.5 layers fight their own
    # springs.
    contact_spacings: Annotated[float, Bounds(0.8, 1.5)] = 1.0
    density: Annotated[float, Bounds(1, 10_000, "kg/m²")] = 150.0
    ks: Annotated[float, Bounds(10, 100_000, "N/m")] = 3000.0
    bending_ratio: Share = 0.08
    damping_percent: Annotated[float, Bounds(0, 5)] = 0.2
    cloth_friction: Annotated[float, Bounds(0, 2)] = 0.3
    table_friction: Annotated[float, Bounds(0, 2)] = 0.6
    hand_speed_m_s: Annotated[float, Bounds(0.05, LARGEST_HAND_SPEED_M_S)] = 0.6
    coverage_band: Annotated[Range, Bounds(0, 1.2)] | None = None
    yaw_max_rad: Annotated[float, Bounds(0, math.pi)] = 0.35
    sides: Literal["any", "alternate"] = "any"
    max_tries: Annotated[int, Bounds(1, 1000)] = 25

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.render_cells % (self.tracked_a_side - 1):
            raise Refused(
                f"a divisor of the {self.render_cells} rendered cells, plus 1", "tracked_a_side"
            )
        if abs(self.grid.proportion - self.proportion) > _CLOSE * self.proportion:
            step = self._row_step / (self.points_a_side - 1)
            raise Refused(
                f"a multiple of {step:g}, or a number within {_CLOSE:.0%} of one",
                "proportion",
                "Raise tracked_a_side: the tracked points have the same spacing along u and v",
            )
        thickest_m = 0.05 * min(self.side_m, self.length_v_m)
        if self.thickness_m > thickest_m:
            raise Refused(f"at most 1/20 of the shorter side: {thickest_m:g}", "thickness_m")
        if self.coverage_band is not None and self.coverage_band[0] == self.coverage_band[1]:
            raise Refused("[low, high] with low < high", "coverage_band")
        return self

    @property
    def render_cells(self) -> int:
        """Cells of the rendered grid along u."""
        return (self.points_a_side - 1) << self.doublings

    @property
    def tracked_every(self) -> int:
        """Cells of the rendered grid from one tracked point to the next, along u and along v."""
        return self.render_cells // (self.tracked_a_side - 1)

    @property
    def _row_step(self) -> int:
        """Rows of masses after which a tracked point is again on a row of the rendered grid."""
        return self.tracked_every // math.gcd(self.tracked_every, 1 << self.doublings)

    @property
    def grid(self) -> GridShape:
        """The masses: as many rows as fit the proportion best and end at a tracked point."""
        cells = self.points_a_side - 1
        steps = max(1, round(self.proportion * cells / self._row_step))
        return GridShape(steps * self._row_step + 1, self.points_a_side)

    @property
    def render_grid(self) -> GridShape:
        """The rendered vertices."""
        rows, columns = self.grid
        return GridShape(((rows - 1) << self.doublings) + 1, ((columns - 1) << self.doublings) + 1)

    @property
    def tracked_grid(self) -> GridShape:
        """The tracked points: every `tracked_every`-th rendered vertex of a row and a column."""
        rows = (self.render_grid.rows - 1) // self.tracked_every + 1
        return GridShape(rows, self.tracked_a_side)

    @property
    def length_v_m(self) -> float:
        """Length along v, metres: of the grid, not of the proportion that was asked for."""
        return self.side_m * self.grid.proportion

    @property
    def area_m2(self) -> float:
        """Area of the flat cloth."""
        return self.side_m**2 * self.grid.proportion

    @property
    def pattern(self) -> str:
        """Name of what is on the cloth: the variant, and the number of a print."""
        return f"printed {self.design}" if self.variant == "printed" else self.variant

    def band_of(self, level: int) -> tuple[float, float]:
        """Return the accepted silhouette coverage of a level."""
        return COVERAGE_BANDS[level] if self.coverage_band is None else self.coverage_band

    def sheet(self) -> Sheet:
        """Return the simulator's settings: the step follows from stiffness and mass."""
        from pliant.generator.objects.cloth.simulator import Sheet  # brings numba

        mass_kg = self.density * self.area_m2 / self.grid.vertices
        steps_per_frame = math.ceil(
            math.sqrt(self.ks / (_STABILITY * mass_kg)) / _FRAMES_PER_SECOND
        )
        steps_per_second = float(steps_per_frame * _FRAMES_PER_SECOND)
        spacing_m = self.side_m / (self.points_a_side - 1)
        kept_per_step = (1.0 - self.damping_percent / 100.0) ** (2700.0 / steps_per_second)
        return Sheet(
            grid=self.grid,
            side_m=self.side_m,
            density=self.density,
            ks=self.ks,
            bending_ratio=self.bending_ratio,
            damping_percent=100.0 * (1.0 - kept_per_step),
            steps_per_second=steps_per_second,
            steps_per_frame=steps_per_frame,
            longest_step_m=0.25 * spacing_m,
        )
