"""Ropes and cloths that are moved by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from pliant.generator.objects.cloth.handling import Action, Handling, perform
from pliant.generator.objects.cloth.sampling import cloth_parts
from pliant.generator.objects.cloth.surface import PART, cover_of, render_vertices
from pliant.generator.objects.rope.body import RopeBody, upward_normal
from pliant.generator.objects.rope.contact import STATIC_RULE, nearest_stretches
from pliant.generator.objects.rope.curve import arc_length, resample, tightest_bend
from pliant.generator.objects.rope.dynamics import RopeState
from pliant.generator.objects.rope.static import MIN_BEND_RADII, ball_centre_of
from pliant.generator.scene.scene_object import Pose
from pliant.generator.settings.cloth import ClothSettings
from pliant.generator.settings.rope import RopeSettings, least_substeps
from pliant.spec.arrays import FloatArray
from pliant.spec.calls import check_numbers, check_whole
from pliant.spec.configuration import settings_from, settings_to_dict
from pliant.spec.errors import CallError, GenerationError

Each = Callable[[], object]
"""Called after every frame of time, such as `film.shoot`."""

SETTLE_FRAMES: Final = 30
"""Frames of time in which a rope that was let go comes to rest, about."""

FRAMES_PER_S: Final = 30
"""Frames of time per second."""


class Rope:
    """A rope on a table.

    Args:
        curve: (N, 2) or (N, 3), points of its centre line in metres, joined smoothly; without a
            height it lies on the table. The rope is as long as this curve.
        radius_m: Radius.
        ball: Whether a ball is at its first point; without one, both ends look alike.
        settings: More fields of the setting `rope`, such as `{"strands": 3, "turns": 12}`.

    Raises:
        CallError: The curve is too short, under the table, bends more tightly than the rope can,
            or passes through itself.

    Examples:
        >>> rope = pliant.scene.Rope([(-0.4, 0.0), (0.0, 0.15), (0.4, 0.0)], ball=True)
        >>> round(rope.settings.length_m, 3)  # the length of the curve
        0.864
        >>> rope.pull(1.0, to=(0.3, 0.1, 0.05))
        >>> rope.settle(5)
    """

    kind: Literal["rope"] = "rope"
    tier = "rope"
    variant = "plain"
    proportion = 1.0

    def __init__(
        self,
        curve: npt.ArrayLike,
        *,
        radius_m: float = 0.01,
        ball: bool = False,
        settings: Mapping[str, Any] = {},
    ) -> None:
        check_numbers("radius_m", radius_m, "metres")
        if "length_m" in settings:
            raise CallError(
                "the rope is as long as its curve",
                where="settings.length_m",
                found=settings["length_m"],
                fix="Leave it out, and scale the curve.",
            )
        line = _smooth(curve, radius_m)
        length = float(arc_length(line)[-1])
        values = {
            "length_m": length,
            "radius_m": radius_m,
            "ball": ball,
            "frame_rate_hz": FRAMES_PER_S,
            "substeps": least_substeps(length, FRAMES_PER_S),
            # Of shapes and actions that are drawn, which these ropes are not.
            "shapes": {"open": 1.0},
            "loop_radius_m": [0.09 * length, 0.09 * length],
            "lift_m": [0.1 * length, 0.2 * length],
            "hand_speed_m_s": [0.2 * length, 0.4 * length],
        }
        self.settings = settings_from(RopeSettings, {**values, **settings})
        self._body = RopeBody(self.settings)
        self.parts, self.points = self._body.parts, self._body.points
        self.size_m, self.thickness_m = length, self.settings.diameter_m
        self._line = resample(line, self.settings.rows)
        self._check(self._line)
        place = ball_centre_of(self._line, self.settings) if ball else None
        self._state = RopeState(self.settings, resample(line, self.settings.particles), place)
        self._state.normal = upward_normal(self._line, 0.0)

    def pull(
        self, s: float, to: Sequence[float], *, speed_m_s: float = 0.3, each: Each | None = None
    ) -> None:
        """Take the rope at a place and pull it in a straight line.

        Args:
            s: Where it is held, 0 to 1 along the rope.
            to: (x, y, z) where the hand goes, metres.
            speed_m_s: Speed of the hand; a hand that is too fast lags behind.
            each: Called after every frame of time (30 a second).
        """
        check_numbers("s", s, "0 to 1 along the rope", low=0, high=1)
        check_numbers("to", to, "(x, y, z), metres", count=3)
        check_numbers("speed_m_s", speed_m_s, "more than 0 m/s", low=0, strict=True)
        held = round(s * (self._state.particles - 1))
        start, goal = self._state.now[held].copy(), np.asarray(to, np.float64)
        way = float(np.linalg.norm(goal - start))
        frames = max(1, int(np.ceil(way / speed_m_s * self.settings.frame_rate_hz)))
        for frame in range(1, frames + 1):
            self._advance(each, held, start + (goal - start) * frame / frames)

    def settle(self, frames: int = SETTLE_FRAMES, *, each: Each | None = None) -> None:
        """Let go, and let it fall for some frames of time; `each` as in `pull`."""
        check_whole("frames", frames)
        for _ in range(frames):
            self._advance(each)

    def pose(self) -> Pose:
        """Return the geometry as it is now."""
        return self._body.pose(self._line, self._state.normal, self._state.ball, {})

    def _advance(self, each: Each | None, held: int = -1, target: FloatArray | None = None) -> None:
        self._state.advance(held, target)
        self._line = self._state.centreline()
        if each is not None:
            each()

    def _check(self, line: FloatArray) -> None:
        radius, diameter = self.settings.radius_m, self.settings.diameter_m
        problem = None
        if line[:, 2].min() < 0.999 * radius:
            problem = "is under the table", line[:, 2].min(), f"heights of at least {radius:g} m"
        elif (bend := tightest_bend(line)) < MIN_BEND_RADII * radius:
            least = MIN_BEND_RADII * radius
            problem = "bends more tightly than the rope can", bend, f"radii of at least {least:g} m"
        elif (near := nearest_stretches(line, self.size_m, diameter)) < STATIC_RULE * diameter:
            least = STATIC_RULE * diameter
            apart = f"{least:g} m apart: give heights where it crosses"
            problem = "passes through itself", near, apart
        if problem is not None:
            text, found, required = problem
            raise CallError(
                f"the curve {text}", where="curve", found=f"{found:.4g} m", required=required
            )


class Cloth:
    """A cloth that lies flat on the table, its middle over the origin.

    Args:
        side_m: Length along u; along v it is the same unless `settings` has a `proportion`.
        towel: With hems and stripes, so that every corner is another one; else of one colour.
        seed: Of the unevenness without which nothing wrinkles.
        settings: More fields of the setting `cloth`, such as `{"points_a_side": 81}`.

    Examples:
        >>> cloth = pliant.scene.Cloth(settings={"points_a_side": 33})
        >>> cloth.drape(lambda u, v: (0.5 * u, 0.5 * v, 0.02 + 0.01 * u))
        >>> cloth.settle(0.1)
    """

    kind: Literal["cloth"] = "cloth"

    def __init__(
        self,
        *,
        side_m: float = 0.6,
        towel: bool = False,
        seed: int = 0,
        settings: Mapping[str, Any] = {},
    ) -> None:
        check_whole("seed", seed)
        self.tier = "towel" if towel else "cloth-1"
        self.variant = "towel" if towel else "plain"
        values = {"side_m": side_m, "level": 1, "variant": self.variant, "points_a_side": 49}
        self.settings = settings_from(ClothSettings, {**values, **settings})
        self.parts, self.points = cloth_parts(self.settings)
        self.size_m, self.thickness_m = self.settings.side_m, self.settings.thickness_m
        self.proportion = self.settings.grid.proportion
        self._handling = Handling(self.settings, np.random.default_rng(seed))

    def pull(
        self,
        uv: tuple[float, float],
        carry: tuple[float, float],
        *,
        lift_m: float = 0.1,
        each: Each | None = None,
    ) -> None:
        """Pick the cloth up at a material point, carry it over the table and let go.

        Args:
            uv: Material point, 0 to 1 each.
            carry: (x, y), how far, metres.
            lift_m: How high on the way.
            each: Called after every frame of time (30 a second).
        """
        check_numbers("uv", uv, "a material point, 0 to 1 each", count=2, low=0, high=1)
        check_numbers("carry", carry, "(x, y), metres", count=2)
        check_numbers("lift_m", lift_m, "0 m or more", low=0)
        grid = self.settings.grid
        column, row = (
            round(share * (count - 1))
            for share, count in zip(uv, (grid.columns, grid.rows), strict=True)
        )
        speed = self.settings.hand_speed_m_s
        vertex = row * grid.columns + column
        action = Action("pull", vertex, (carry[0], carry[1]), lift_m, lift_m / 2, speed)
        self._handling.record.append(action.record(grid))
        every = self._handling.simulator.sheet.steps_per_frame
        for step, _ in enumerate(perform(self._handling.simulator, action), start=1):
            if each is not None and step % every == 0:
                each()

    def drape(self, shape: Callable[[npt.NDArray[Any], npt.NDArray[Any]], Any]) -> None:
        """Put every material point somewhere, at rest.

        Args:
            shape: Returns (x, y, z) in metres, three arrays like the u and v that it is given.

        Raises:
            CallError: It does not.
        """
        u, v = (self._handling.simulator.rest[:, :2] / self._handling.lengths_m).T
        answer = shape(u, v)
        try:
            x, y, z = answer
            places = np.stack(np.broadcast_arrays(x, y, z, u)[:3], axis=1).astype(np.float64)
            fits = places.shape == (len(u), 3) and bool(np.isfinite(places).all())
        except (TypeError, ValueError):
            fits = False
        if not fits:
            raise CallError(
                "the function does not say where the points are",
                where="shape",
                found=_described(answer),
                required="(x, y, z), each a finite number of metres or an array of them, "
                f"one per point ({len(u)})",
            )
        self._handling.simulator.place(places)

    def settle(self, seconds: float | None = None, *, each: Each | None = None) -> None:
        """Let it fall, for some time or (None) until it is calm; `each` is called at 30 Hz."""
        if seconds is None:
            self._handling.calm()
            return
        check_numbers("seconds", seconds, "0 s or more, or None until it is calm", low=0)
        simulator = self._handling.simulator
        for _ in range(max(1, round(seconds * FRAMES_PER_S))):
            simulator.run(simulator.sheet.steps_per_frame)
            if each is not None:
                each()

    def pose(self) -> Pose:
        """Return the geometry as it is now.

        Raises:
            GenerationError: The cloth pokes through itself.
        """
        vertices, pierced = render_vertices(self.settings, self._handling.simulator.positions)
        if pierced:
            raise GenerationError(
                "the cloth intersects itself",
                found=f"{pierced} edges",
                fix="Move it by less at a time, or drape it farther from itself.",
            )
        return Pose({PART: vertices}, info=settings_to_dict(cover_of(self.settings, vertices)))


Body = Rope | Cloth
"""What a film shows."""


def _described(answer: object) -> str:
    """Return what a function of (u, v) returned, in a few words."""
    if isinstance(answer, tuple | list):
        return f"({', '.join(_described(each) for each in answer[:4])})"
    if isinstance(answer, np.ndarray):
        unknown = answer.dtype.kind == "f" and not np.isfinite(answer).all()
        return f"an array {answer.shape}" + (" with values that are not finite" if unknown else "")
    return f"{answer!r:.80}"


def _smooth(curve: npt.ArrayLike, radius_m: float) -> FloatArray:
    """Return a dense smooth curve through points, float64 (M, 3)."""
    from scipy.interpolate import CubicSpline

    try:
        points = np.asarray(curve, np.float64)
    except (TypeError, ValueError):  # no numbers, or rows of different lengths
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or len(points) < 2:
        raise CallError(
            "a curve is a list of points",
            where="curve",
            found=f"{curve!r:.80}",
            required="(x, y) or (x, y, z) for each of two points or more",
        )
    if points.shape[1] == 2:
        points = np.column_stack([points, np.full(len(points), radius_m)])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if not np.isfinite(points).all() or not (steps > 0).all():
        raise CallError(
            "points of a curve are finite, and no two in a row are equal",
            where="curve",
            found=f"{curve!r:.80}",
        )
    at = np.concatenate([[0.0], np.cumsum(steps)])
    dense = np.linspace(0.0, at[-1], max(401, 20 * len(points)))
    return np.asarray(CubicSpline(at, points, bc_type="natural")(dense))
