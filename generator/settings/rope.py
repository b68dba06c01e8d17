"""Settings of a rope tier: proportions, shapes, points and episode physics."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, model_validator

from pliant.spec.configuration import Settings
from pliant.spec.constraints import (
    Bounds,
    Count,
    DrawnFrom,
    OneOf,
    Range,
    Refused,
    Share,
    Weights,
    WholeRange,
)

SHAPES: Final = ("open", "loop", "overlap", "knot")
KNOTS: Final = ("overhand", "figure-eight")

SHORTEST_KNOT_DIAMETERS: Final[Mapping[str, float]] = {"overhand": 20.0, "figure-eight": 28.0}
"""Rope lengths, in diameters, under which the flat knot would press strands into each other."""

MAY_BE_DRAWN: Final = ("length_m", "radius_m", "strands", "turns")
"""Settings that may be given as a range [low, high]: each sequence draws its own value."""

LONGEST_KNOT_SHARE: Final = 0.92
"""A knot may take this share of the rope; the rest is its two tails."""


class RopeSettings(Settings):
    """The settings of a rope tier; every value is checked when the object is made.

    The defaults keep the paper's proportions: four laid strands, a ball of 7.5 strand radii
    at the origin end, 12 control points, and its mix of shapes (30 % open, 25 % overlap,
    45 % loop and tuck, of which a third are here pulled into true knots).

    `length_m`, `radius_m`, `strands` and `turns` may also be given as a range [low, high], from
    which each sequence draws its own value.

    Attributes:
        length_m: Length of the rope along its centre line, metres.
        radius_m: Radius of the circle around all strands, metres.
        structure: `laid` (strands wound around each other) or `tube`.
        strands: Laid 3 to 6, tube 1.
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

    length_m: Annotated[float, DrawnFrom(Range), Bounds(0.05, 20)] = 1.2
    radius_m: Annotated[float, DrawnFrom(Range), Bounds(1e-4, 0.5)] = 0.012
    structure: Literal["laid", "tube"] = "laid"
    strands: Annotated[int, DrawnFrom(WholeRange)] = 4
    turns: Annotated[int, DrawnFrom(WholeRange), Bounds(0, 1000)] = 18
    rows: Annotated[int, Bounds(64, 20_000)] = 320
    ring: Annotated[int, Bounds(6, 64, multiple_of=2)] = 8
    ball: bool = True
    ball_strand_radii: Annotated[float, Bounds(0.5, 40)] = 7.5
    shapes: Annotated[Mapping[str, float], Weights(SHAPES)] = Field(
        default_factory=lambda: {"open": 0.30, "loop": 0.30, "overlap": 0.25, "knot": 0.15}
    )
    knots: Annotated[Mapping[str, float], Weights(KNOTS)] = Field(
        default_factory=lambda: {"overhand": 0.6, "figure-eight": 0.4}
    )
    knot_diameters: Mapping[Annotated[str, OneOf(KNOTS)], Range] = Field(
        default_factory=lambda: {"overhand": (22.0, 32.0), "figure-eight": (31.0, 38.0)}
    )
    loop_radius_m: Range = (0.042, 0.085)
    control_points: Annotated[int, Bounds(8, 64)] = 12
    roll_deg: Annotated[float, Bounds(0, 180)] = 30.0
    workspace: Annotated[tuple[float, float], Bounds(0.4, 2, "rope lengths")] = (0.80, 0.60)
    point_stations: Annotated[int, Bounds(2, 20_000, multiple_of=2)] = 100
    point_angles: Count = 8
    centreline_points: Annotated[int, Bounds(2, 20_000)] = 101
    particles: Annotated[int, Bounds(65, 400)] = 65
    frame_rate_hz: Annotated[float, Bounds(1, 1000)] = 60.0
    substeps: Annotated[int, Bounds(1, 1000)] = 24
    lift_m: Annotated[Range, Bounds(0)] = (0.025, 0.06)
    hand_speed_m_s: Annotated[Range, Bounds(0, above=True)] = (0.2, 0.5)
    hand_force_weights: Annotated[float, Bounds(0.5, 20)] = 1.6
    spread_share: Share = 0.4

    @model_validator(mode="after")
    def _check(self) -> Self:
        """Refuse what cannot be built.

        Raises:
            Refused: A value is impossible together with others.
        """
        for extreme in self._extremes():
            extreme._check_mesh()
            extreme._check_shapes_and_points()
            extreme._check_episodes()
        return self

    @property
    def drawn(self) -> dict[str, tuple[Any, Any]]:
        """Field -> the range that each sequence draws it from; empty where all are given."""
        given = {name: getattr(self, name) for name in MAY_BE_DRAWN}
        return {name: each for name, each in given.items() if isinstance(each, tuple)}

    @property
    def nominal(self) -> RopeSettings:
        """The same settings with the middle of every range: the rope that `dataset.json` has."""
        middle: dict[str, Any] = {}
        for name, (low, high) in self.drawn.items():
            middle[name] = (low + high) // 2 if isinstance(low, int) else (low + high) / 2
        return self.replace(**middle) if middle else self

    def _extremes(self) -> Iterator[RopeSettings]:
        """Yield these settings with every combination of the ends of the ranges."""
        ranges = self.drawn
        for values in product(*ranges.values()):
            yield self.model_copy(update=dict(zip(ranges, values, strict=True)))

    @property
    def points(self) -> int:
        """Number of material points, on the surface and on the centre line."""
        return self.point_stations * self.point_angles + self.centreline_points

    @property
    def diameter_m(self) -> float:
        """Diameter of the rope, metres."""
        return 2.0 * self.radius_m

    @property
    def strand_radius_m(self) -> float:
        """Radius of one strand, metres: `strands` equal circles side by side within the rope."""
        if self.structure == "tube":
            return self.radius_m
        return self.radius_m / (1.0 + 1.0 / math.sin(math.pi / self.strands))

    @property
    def ball_radius_m(self) -> float:
        """Radius of the ball, metres (also where the tier has none)."""
        return self.ball_strand_radii * self.strand_radius_m

    def _check_mesh(self) -> None:
        if self.length_m < 24.0 * self.diameter_m:
            raise Refused(
                f"at most length_m / 48 = {self.length_m / 48.0:g}",
                "radius_m",
                "A thicker rope of this length cannot bend into the shapes.",
            )
        possible = {"laid": range(3, 7), "tube": range(1, 2)}
        strands = possible[self.structure]
        if self.strands not in strands:
            counts = ", ".join(map(str, strands))
            raise Refused(f"{counts} for structure {self.structure}", "strands")
        least = 0 if self.structure == "tube" else 8 * self.turns
        if self.rows < least:
            raise Refused(f"at least {least}, eight for each turn of a strand", "rows")
        if self.length_m / (self.rows - 1) > 0.75 * self.radius_m:
            least = math.ceil(self.length_m / (0.75 * self.radius_m)) + 1
            raise Refused(f"at least {least}, one cross section per 0.75 radii", "rows")
        low = 1.2 * self.radius_m / self.strand_radius_m
        high = min(0.06 * self.length_m, 7.5 * self.radius_m) / self.strand_radius_m
        if self.ball and not low <= self.ball_strand_radii <= high:
            raise Refused(
                f"{low:.3g} to {high:.3g}: a ball thicker than the rope, far shorter, and not "
                "higher than the rope can rise",
                "ball_strand_radii",
            )

    def _check_shapes_and_points(self) -> None:
        longest = LONGEST_KNOT_SHARE * self.length_m / self.diameter_m
        for knot, shortest in SHORTEST_KNOT_DIAMETERS.items():
            where = f"knot_diameters.{knot}"
            if knot not in self.knot_diameters:
                raise Refused("a range of rope diameters", where)
            low, high = self.knot_diameters[knot]
            if low < shortest:
                raise Refused(f"at least {shortest:g} rope diameters", where)
            wanted = self.shapes.get("knot", 0.0) > 0 and self.knots.get(knot, 0.0) > 0
            if wanted and high > longest:
                raise Refused(
                    f"at most {longest:.4g} rope diameters: the knot is longer than the rope",
                    where,
                    "Make the rope longer or thinner, or leave this knot out.",
                )
        tightest, widest = 2.2 * self.radius_m, 0.6 * self.length_m / (2.0 * math.pi)
        if self.loop_radius_m[0] < tightest or self.loop_radius_m[1] > widest:
            raise Refused(f"within {tightest:.4g} and {widest:.4g}", "loop_radius_m")
        if self.point_stations > self.rows:
            raise Refused(f"at most rows, {self.rows}", "point_stations")
        around = 3 * self.ring if self.structure == "tube" else self.strands * (self.ring // 2)
        if self.point_angles > around:
            raise Refused(
                f"at most {around}, the outer vertices of a cross section", "point_angles"
            )

    def _check_episodes(self) -> None:
        least = least_substeps(self.length_m, self.frame_rate_hz)
        if self.substeps < least:
            raise Refused(
                f"at least {least} at this length and frame rate, or the rope stretches and "
                "passes through itself",
                "substeps",
            )
        if self.lift_m[1] > 0.25 * self.length_m:
            raise Refused(f"at most length_m / 4 = {0.25 * self.length_m:g}", "lift_m")
        if self.hand_speed_m_s[1] > 0.5 * self.length_m:
            raise Refused(
                f"at most {0.5 * self.length_m:g}, half a rope length per second", "hand_speed_m_s"
            )


def least_substeps(length_m: float, frame_rate_hz: float) -> int:
    """Return how many physics steps a frame needs.

    A shorter rope falls and folds faster for its size: its steps must be shorter.
    """
    return math.ceil(1250.0 * math.sqrt(1.2 / length_m) / frame_rate_hz)
