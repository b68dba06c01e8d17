"""The settings of a cloth tier: a frozen dataclass that refuses what cannot be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

from pliant.generator.cloth.simulator import Sheet
from pliant.spec.errors import CallError

Variant = Literal["plain", "two-sided", "striped", "printed"]

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


@dataclass(frozen=True)
class ClothSettings:
    """How a cloth is made, shaped and handed on.

    Attributes:
        level: 1 smooth, 2 wrinkled and folded, 3 heavily scrunched; None takes the digit at
            the end of the tier's name (`cloth-2`).
        variant: `plain` (one colour), `two-sided` (a back of another shade), `striped` or
            `printed`.
        side_m: Side of the square, metres.
        points_a_side: Point masses along a side.
        doublings: How often the simulated cells are halved for rendering.
        smoothing: How far a mass goes towards the average of its neighbours before the rendered
            surface is laid through it, 0 to 1; it takes out the dimples of the contact.
        tracked_a_side: Named material points along a side; its steps must divide the
            rendered grid's.
        thickness_m: Thickness of the cloth; a cloth on the table lies at half of it.
        contact_spacings: Distance at which two layers touch, in spacings of the masses.
        density: kg/m².
        ks: Stiffness of structural and shear springs, N/m.
        bending_ratio: Stiffness of bending springs over `ks`.
        damping_percent: Motion lost per 1/2700 s, percent (the course's 0.2).
        cloth_friction: Coulomb's coefficient between layers.
        table_friction: Coulomb's coefficient on the table.
        hand_speed_m_s: Highest speed of the hand.
        coverage_band: Accepted silhouette coverage; None takes the level's.
        yaw_max_rad: The finished cloth is turned by up to this angle either way.
        max_tries: Configurations tried for one frame before giving up.
    """

    level: int | None = None
    variant: Variant = "plain"
    side_m: float = 0.6
    points_a_side: int = 81
    doublings: int = 1
    smoothing: float = 1.0
    tracked_a_side: int = 33
    thickness_m: float = 0.002
    contact_spacings: float = 1.0
    density: float = 150.0
    ks: float = 3000.0
    bending_ratio: float = 0.08
    damping_percent: float = 0.2
    cloth_friction: float = 0.3
    table_friction: float = 0.6
    hand_speed_m_s: float = 0.6
    coverage_band: tuple[float, float] | None = None
    yaw_max_rad: float = 0.35
    max_tries: int = 25

    def __post_init__(self) -> None:
        if self.coverage_band is not None:  # JSON and YAML give lists
            object.__setattr__(self, "coverage_band", tuple(self.coverage_band))
        _one_of("level", self.level, (None, *COVERAGE_BANDS))
        _one_of("variant", self.variant, get_args(Variant))
        _within("side_m", self.side_m, 0.05, 5.0)
        _whole("points_a_side", self.points_a_side, 9, 257)
        _whole("doublings", self.doublings, 0, 3)
        _within("smoothing", self.smoothing, 0.0, 1.0)
        _whole("tracked_a_side", self.tracked_a_side, 2, self.render_a_side)
        if self.render_cells % (self.tracked_a_side - 1):
            raise _refusal(
                "tracked_a_side",
                self.tracked_a_side,
                f"{self.render_cells} rendered cells divisible by tracked_a_side - 1",
            )
        _within("thickness_m", self.thickness_m, 1e-5, 0.05 * self.side_m)
        # Below 0.8 spacings a mass fits through a stretched cell; above 1.5 layers fight
        # their own springs.
        _within("contact_spacings", self.contact_spacings, 0.8, 1.5)
        _within("density", self.density, 1.0, 10_000.0)
        _within("ks", self.ks, 10.0, 100_000.0)
        _within("bending_ratio", self.bending_ratio, 0.0, 1.0)
        _within("damping_percent", self.damping_percent, 0.0, 5.0)
        _within("cloth_friction", self.cloth_friction, 0.0, 2.0)
        _within("table_friction", self.table_friction, 0.0, 2.0)
        _within("hand_speed_m_s", self.hand_speed_m_s, 0.05, LARGEST_HAND_SPEED_M_S)
        _within("yaw_max_rad", self.yaw_max_rad, 0.0, math.pi)
        _whole("max_tries", self.max_tries, 1, 1000)
        if self.coverage_band is not None:
            band = self.coverage_band
            if len(band) != 2 or not 0.0 <= band[0] < band[1] <= 1.2:
                raise _refusal("coverage_band", band, "two numbers, 0 <= lowest < highest <= 1.2")

    @property
    def render_cells(self) -> int:
        """Cells along a side of the rendered grid."""
        return (self.points_a_side - 1) << self.doublings

    @property
    def render_a_side(self) -> int:
        """Vertices along a side of the rendered grid."""
        return self.render_cells + 1

    def level_of(self, tier: str) -> int:
        """Return the level of a tier: the setting's, else the digit that ends its name.

        Raises:
            CallError: Neither names a level.
        """
        if self.level is not None:
            return self.level
        for level in COVERAGE_BANDS:
            if tier.endswith(f"-{level}"):
                return level
        raise CallError(
            f"tier '{tier}' names no cloth level",
            where="level",
            found=tier,
            required="a name ending in -1, -2 or -3, or the setting level",
        )

    def band_of(self, level: int) -> tuple[float, float]:
        """Return the accepted silhouette coverage of a level."""
        return COVERAGE_BANDS[level] if self.coverage_band is None else self.coverage_band

    def sheet(self) -> Sheet:
        """Return the simulator's settings: the step follows from stiffness and mass."""
        mass_kg = self.density * self.side_m**2 / self.points_a_side**2
        steps_per_frame = math.ceil(
            math.sqrt(self.ks / (_STABILITY * mass_kg)) / _FRAMES_PER_SECOND
        )
        steps_per_second = float(steps_per_frame * _FRAMES_PER_SECOND)
        spacing_m = self.side_m / (self.points_a_side - 1)
        kept_per_step = (1.0 - self.damping_percent / 100.0) ** (2700.0 / steps_per_second)
        return Sheet(
            columns=self.points_a_side,
            rows=self.points_a_side,
            width_m=self.side_m,
            height_m=self.side_m,
            density=self.density,
            ks=self.ks,
            bending_ratio=self.bending_ratio,
            damping_percent=100.0 * (1.0 - kept_per_step),
            steps_per_second=steps_per_second,
            steps_per_frame=steps_per_frame,
            thickness_m=self.thickness_m,
            contact="pbd",
            contact_distance_m=self.contact_spacings * spacing_m,
            contact_friction=self.cloth_friction,
            longest_step_m=0.25 * spacing_m,
        )


def _refusal(field: str, found: Any, required: str) -> CallError:
    return CallError(
        f"the cloth setting {field} cannot be", where=field, found=found, required=required
    )


def _one_of(field: str, found: Any, allowed: tuple[Any, ...]) -> None:
    if isinstance(found, bool) or found not in allowed:
        raise _refusal(field, found, "one of " + ", ".join(str(value) for value in allowed))


def _within(field: str, found: Any, low: float, high: float) -> None:
    number = isinstance(found, int | float) and not isinstance(found, bool)
    if not number or not low <= found <= high:
        raise _refusal(field, found, f"a number from {low:g} to {high:g}")


def _whole(field: str, found: Any, low: int, high: int) -> None:
    if not isinstance(found, int) or isinstance(found, bool) or not low <= found <= high:
        raise _refusal(field, found, f"a whole number from {low} to {high}")
