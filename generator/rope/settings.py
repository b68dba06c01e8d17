"""What a rope tier can be told: proportions, shapes, points and episode physics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Final

from pliant.spec.errors import CallError

SHAPES: Final = ("open", "loop", "overlap", "knot")
KNOTS: Final = ("overhand", "figure-eight")
STRUCTURES: Final = ("laid", "braid", "tube")

SHORTEST_KNOT_DIAMETERS: Final[Mapping[str, float]] = {"overhand": 20.0, "figure-eight": 28.0}
"""Rope lengths, in diameters, under which the flat knot would press strands into each other."""

LONGEST_KNOT_SHARE: Final = 0.92
"""A knot may take this share of the rope; the rest is its two tails."""


def _even_shapes() -> dict[str, float]:
    return {"open": 0.30, "loop": 0.30, "overlap": 0.25, "knot": 0.15}


def _even_knots() -> dict[str, float]:
    return {"overhand": 0.6, "figure-eight": 0.4}


def _knot_sizes() -> dict[str, tuple[float, float]]:
    return {"overhand": (22.0, 32.0), "figure-eight": (31.0, 38.0)}


@dataclass(frozen=True)
class RopeSettings:
    """The settings of a rope tier; every value is checked when the object is made.

    The defaults keep the paper's proportions: four laid strands, a ball of 7.5 strand radii
    at the origin end, 12 control points, and its mix of shapes (30 % open, 25 % overlap,
    45 % loop and tuck, of which a third are here pulled into true knots).

    Attributes:
        length_m: Length of the rope along its centre line, metres.
        radius_m: Radius of the circle around all strands, metres.
        structure: `laid` (strands wound one way), `braid` (half of them each way) or `tube`.
        strands: Laid 3 to 6, braid an even 4 to 16, tube 1.
        turns: Whole turns of a strand over the length. A whole number makes the reversal
            (s, theta) -> (1 - s, -theta) map the mesh onto itself.
        rows: Cross sections of the mesh along the rope.
        ring: Vertices around one strand (a tube has three times as many).
        ball: Put a ball on the end s = 0. Without it the tier carries the reversal symmetry.
        ball_strand_radii: Radius of the ball in strand radii.
        shapes: Shape -> weight of a sequence having it.
        knots: Knot -> weight among the knots.
        knot_diameters: Knot -> range of rope length taken by the knot, in rope diameters
            (smaller is tighter).
        loop_radius_m: Range of the radius of a loop, metres.
        control_points: Control points of the curve (a knot takes as many as it needs).
        roll_deg: The rope is rolled about its axis by up to this angle, each way.
        workspace: Largest extent in x and in y, in rope lengths.
        point_stations: Even number of cross sections that carry surface points.
        point_angles: Surface points on each of them.
        centreline_points: Points along the centre line.
        particles: Particles of the episode simulation.
        frame_rate_hz: Frames of an episode per second.
        substeps: Physics steps per frame.
        lift_m: Range of the height a picked point is lifted by, metres.
        hand_speed_m_s: Range of the hand's mean speed while it carries, metres per second.
        hand_force_weights: Largest force of the hand, in weights of the whole rope.
        spread_share: Share of the actions that pull an end outward, so that ropes do not clump.
    """

    length_m: float = 1.2
    radius_m: float = 0.012
    structure: str = "laid"
    strands: int = 4
    turns: int = 18
    rows: int = 320
    ring: int = 8
    ball: bool = True
    ball_strand_radii: float = 7.5
    shapes: Mapping[str, float] = field(default_factory=_even_shapes)
    knots: Mapping[str, float] = field(default_factory=_even_knots)
    knot_diameters: Mapping[str, tuple[float, float]] = field(default_factory=_knot_sizes)
    loop_radius_m: tuple[float, float] = (0.042, 0.085)
    control_points: int = 12
    roll_deg: float = 30.0
    workspace: tuple[float, float] = (0.80, 0.60)
    point_stations: int = 100
    point_angles: int = 8
    centreline_points: int = 101
    particles: int = 65
    frame_rate_hz: float = 60.0
    substeps: int = 24
    lift_m: tuple[float, float] = (0.025, 0.06)
    hand_speed_m_s: tuple[float, float] = (0.2, 0.5)
    hand_force_weights: float = 1.6
    spread_share: float = 0.4

    def __post_init__(self) -> None:
        """Refuse what cannot be built, naming the field.

        Raises:
            CallError: A value is of the wrong kind, out of range, or impossible beside others.
        """
        self._check_types()
        self._check_mesh()
        self._check_shapes()
        self._check_points()
        self._check_episodes()

    @property
    def diameter_m(self) -> float:
        """Diameter of the rope, metres."""
        return 2.0 * self.radius_m

    @property
    def strand_radius_m(self) -> float:
        """Radius of one strand, metres: `strands` equal circles side by side within the rope."""
        if self.structure == "tube":
            return self.radius_m
        if self.structure == "braid":
            return 0.22 * self.radius_m
        return self.radius_m / (1.0 + 1.0 / math.sin(math.pi / self.strands))

    @property
    def ball_radius_m(self) -> float:
        """Radius of the ball, metres (also where the tier has none)."""
        return self.ball_strand_radii * self.strand_radius_m

    def _check_types(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            kind = str(each.type)
            if kind == "float":
                value = _number(each.name, value)
            elif kind == "int":
                if isinstance(value, bool) or not isinstance(value, int):
                    _refuse(each.name, value, "a whole number")
            elif kind == "bool":
                if not isinstance(value, bool):
                    _refuse(each.name, value, "true or false")
            elif kind.startswith("tuple"):
                value = _pair(each.name, value)
            elif kind.startswith("Mapping"):
                if not isinstance(value, Mapping):
                    _refuse(each.name, value, "an object of names to values")
                read = _pair if "tuple" in kind else _number
                value = {
                    str(key): read(f"{each.name}.{key}", entry) for key, entry in value.items()
                }
            object.__setattr__(self, each.name, value)

    def _check_mesh(self) -> None:
        _within("length_m", self.length_m, 0.05, 20.0)
        _within("radius_m", self.radius_m, 1e-4, 0.5)
        if self.length_m < 24.0 * self.diameter_m:
            _refuse(
                "radius_m",
                self.radius_m,
                f"at most length_m / 48 = {self.length_m / 48.0:g}",
                "A thicker rope of this length cannot bend into the shapes.",
            )
        if self.structure not in STRUCTURES:
            _refuse("structure", self.structure, "one of " + ", ".join(STRUCTURES))
        if self.structure == "tube" and self.strands != 1:
            _refuse("strands", self.strands, "1 for a tube")
        if self.structure == "laid":
            _within("strands", self.strands, 3, 6)
        if self.structure == "braid" and (self.strands % 2 or not 4 <= self.strands <= 16):
            _refuse("strands", self.strands, "an even number from 4 to 16 for a braid")
        _within("ring", self.ring, 6, 64)
        if self.ring % 2:
            _refuse("ring", self.ring, "an even number")
        _within("turns", self.turns, 0, 1000)
        _within("rows", self.rows, 64, 20_000)
        waves = self.turns * (self.strands // 2 if self.structure == "braid" else 1)
        if self.structure != "tube" and self.rows < 8 * waves:
            _refuse("rows", self.rows, f"at least {8 * waves}, eight for each turn of a strand")
        spacing_m = self.length_m / (self.rows - 1)
        if spacing_m > 0.75 * self.radius_m:
            _refuse(
                "rows",
                self.rows,
                f"at least {math.ceil(self.length_m / (0.75 * self.radius_m)) + 1}, "
                "so that a cross section follows each 0.75 radii",
            )
        _within("ball_strand_radii", self.ball_strand_radii, 0.5, 40.0)
        low = 1.2 * self.radius_m / self.strand_radius_m
        high = 0.06 * self.length_m / self.strand_radius_m
        if self.ball and not low <= self.ball_strand_radii <= high:
            _refuse(
                "ball_strand_radii",
                f"{self.ball_strand_radii:g}",
                f"{low:.3g} to {high:.3g}, a ball thicker than the rope and far shorter",
            )

    def _check_shapes(self) -> None:
        _weights("shapes", self.shapes, SHAPES)
        _weights("knots", self.knots, KNOTS)
        for knot in KNOTS:
            where = f"knot_diameters.{knot}"
            if knot not in self.knot_diameters:
                _refuse(where, "nothing", "a range of rope diameters")
            low, high = self.knot_diameters[knot]
            if low < SHORTEST_KNOT_DIAMETERS[knot]:
                _refuse(where, f"{low:g}", f"at least {SHORTEST_KNOT_DIAMETERS[knot]:g}")
            wanted = self.shapes.get("knot", 0.0) > 0 and self.knots.get(knot, 0.0) > 0
            room = LONGEST_KNOT_SHARE * self.length_m / self.diameter_m
            if wanted and high > room:
                _refuse(
                    where,
                    f"{high:g}",
                    f"at most {room:.4g}: the knot is longer than the rope",
                    "Make the rope longer or thinner, or leave this knot out.",
                )
        for name in set(self.knot_diameters) - set(KNOTS):
            _refuse(f"knot_diameters.{name}", "an unknown knot", "one of " + ", ".join(KNOTS))
        low, high = self.loop_radius_m
        if low < 2.2 * self.radius_m or 2.0 * math.pi * high > 0.6 * self.length_m:
            _refuse(
                "loop_radius_m",
                f"{low:g} to {high:g}",
                f"within {2.2 * self.radius_m:.4g} and {0.6 * self.length_m / (2.0 * math.pi):.4g}",
            )
        _within("control_points", self.control_points, 8, 64)
        _within("roll_deg", self.roll_deg, 0.0, 180.0)
        if min(self.workspace) < 0.4 or max(self.workspace) > 2.0:
            _refuse("workspace", list(self.workspace), "two extents from 0.4 to 2 rope lengths")

    def _check_points(self) -> None:
        _within("point_stations", self.point_stations, 2, 20_000)
        if self.point_stations % 2:
            _refuse("point_stations", self.point_stations, "an even number")
        if self.point_stations > self.rows:
            _refuse(
                "point_stations",
                self.point_stations,
                f"at most rows = {self.rows}: there are more points than the mesh has",
            )
        around = 3 * self.ring if self.structure == "tube" else self.strands * (self.ring // 2)
        if not 1 <= self.point_angles <= around:
            _refuse(
                "point_angles",
                self.point_angles,
                f"1 to {around}, the outer vertices of a cross section",
            )
        _within("centreline_points", self.centreline_points, 2, 20_000)

    def _check_episodes(self) -> None:
        _within("particles", self.particles, 65, 400)
        _within("frame_rate_hz", self.frame_rate_hz, 1.0, 1000.0)
        _within("substeps", self.substeps, 1, 1000)
        # A shorter rope falls and folds faster for its size: its steps must be shorter.
        slowest_hz = 1250.0 * math.sqrt(1.2 / self.length_m)
        if self.frame_rate_hz * self.substeps < slowest_hz:
            _refuse(
                "substeps",
                self.substeps,
                f"at least {math.ceil(slowest_hz / self.frame_rate_hz)} "
                "at this length and frame rate, or the rope stretches and tunnels",
            )
        low, high = self.lift_m
        if low < 0 or high > 0.25 * self.length_m:
            _refuse("lift_m", list(self.lift_m), f"within 0 and {0.25 * self.length_m:g}")
        low, high = self.hand_speed_m_s
        if low <= 0 or high > 0.5 * self.length_m:
            _refuse(
                "hand_speed_m_s",
                list(self.hand_speed_m_s),
                f"above 0 and at most {0.5 * self.length_m:g}, half a rope length a second",
            )
        _within("hand_force_weights", self.hand_force_weights, 0.5, 20.0)
        _within("spread_share", self.spread_share, 0.0, 1.0)


def _refuse(name: str, found: object, required: str, fix: str | None = None) -> None:
    raise CallError(
        "impossible rope setting", where=f"rope.{name}", found=found, required=required, fix=fix
    )


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        _refuse(name, value, "a finite number")
    return float(value)  # type: ignore[arg-type]


def _pair(name: str, value: object) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        _refuse(name, value, "two numbers")
    low, high = (_number(name, each) for each in value)  # type: ignore[attr-defined]
    if name != "workspace" and low > high:
        _refuse(name, list((low, high)), "the lower bound first")
    return low, high


def _within(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        _refuse(name, value, f"from {low:g} to {high:g}")


def _weights(name: str, weights: Mapping[str, float], allowed: tuple[str, ...]) -> None:
    for key, weight in weights.items():
        if key not in allowed:
            _refuse(f"{name}.{key}", "an unknown name", "one of " + ", ".join(allowed))
        if weight < 0:
            _refuse(f"{name}.{key}", weight, "a weight >= 0")
    if sum(weights.values()) <= 0:
        _refuse(name, dict(weights), "at least one weight above 0")
