"""A cloth on the table, and the hand that picks a point, lifts it, carries it and lets go."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.generator import portable
from pliant.generator.objects.cloth.contact_pbd import PairContact
from pliant.generator.objects.cloth.grid import corner_vertices, flat_positions, grid_faces
from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.generator.objects.cloth.measure import silhouette_m2
from pliant.generator.objects.cloth.simulator import Simulator, collide_table
from pliant.generator.settings.cloth import ClothSettings
from pliant.spec.arrays import FloatArray, IntArray

_SAMPLES = 256

GRAVITY_M_S2 = (0.0, 0.0, -9.8)
UNEVEN_SHARE = 1e-4
"""Height of the random unevenness of a flat cloth over √area: without any, nothing buckles."""

CALM_SPEED_M_S = 1e-3
CALM_DAMPING_PERCENT = (1.5, 3.0, 6.0, 12.0, 24.0)
"""Motion lost per 1/2700 s (0.2 while the cloth moves), one stage after another."""

CALM_CHECKS = 8
"""Looks at the speed per stage."""

CALM_CHECK_S = 0.05
SETTLED_SPEED_M_S = 0.01


@dataclass(frozen=True)
class Action:
    """One pick, lift, carry and release.

    Attributes:
        name: What it is meant to do (`fold`, `pull`, `drop`, `spread` …).
        vertex: Mass under the middle of the grip.
        carry_m: How far it goes over the table, (x, y), metres.
        lift_m: Top of the arc above the picked point, metres.
        lower_m: How far the hand comes down again before it lets go, metres, <= lift_m.
        speed_m_s: Highest speed of the hand.
    """

    name: str
    vertex: int
    carry_m: tuple[float, float]
    lift_m: float
    lower_m: float
    speed_m_s: float

    def record(self, grid: GridShape) -> dict[str, Any]:
        """Return the action as a JSON object, with the picked point as (u, v)."""
        row, column = divmod(self.vertex, grid.columns)
        facts = asdict(self)
        del facts["vertex"]
        facts["carry_m"] = list(self.carry_m)
        return {"picked": [column / (grid.columns - 1), row / (grid.rows - 1)], **facts}


def hand_path(action: Action) -> FloatArray:
    """Return the hand's way at equal times: float64 (257, 3), metres from the pick.

    It rises first, crosses while it is high, and comes down last; every part starts and ends
    at rest.
    """
    t = np.linspace(0.0, 1.0, _SAMPLES + 1)
    up = action.lift_m * _ease(t / 0.45)
    down = action.lower_m * _ease((t - 0.65) / 0.35)
    across = _ease((t - 0.2) / 0.6)
    return np.stack([action.carry_m[0] * across, action.carry_m[1] * across, up - down], axis=1)


def hand_steps(action: Action, dt_s: float) -> FloatArray:
    """Return how far the hand moves in each step of an action: float64 (steps, 3), metres."""
    path = hand_path(action)
    moves = np.linalg.norm(np.diff(path, axis=0), axis=1) * _SAMPLES
    fastest = float(moves.max())  # metres per unit of time
    steps = max(1, math.ceil(fastest / action.speed_m_s / dt_s))
    at = np.linspace(0.0, _SAMPLES, steps + 1)
    whole = np.arange(_SAMPLES + 1)
    places = np.stack([np.interp(at, whole, path[:, c]) for c in range(3)], axis=1)
    return np.asarray(np.diff(places, axis=0))


def perform(simulator: Simulator, action: Action) -> Iterator[FloatArray]:
    """Carry out an action step by step.

    Args:
        simulator: The cloth; one step of it is made before each yield.
        action: What the hand does.

    Yields:
        The hand's position after each step: float64 (3,), metres in the world.
    """
    held = grip(action.vertex, simulator.sheet.grid)
    where = simulator.positions[action.vertex].copy()
    simulator.free[held] = 0.0
    try:
        for move in hand_steps(action, simulator.dt_s):
            simulator.step(move)
            where += move
            yield where.copy()
    finally:
        simulator.free[held] = 1.0


def grip(vertex: int, grid: GridShape) -> IntArray:
    """Return the masses a hand holds: the 3 x 3 patch about one, cut at the cloth's edges."""
    row, column = divmod(vertex, grid.columns)
    rows = np.arange(max(row - 1, 0), min(row + 2, grid.rows))
    columns = np.arange(max(column - 1, 0), min(column + 2, grid.columns))
    return np.asarray((rows[:, None] * grid.columns + columns).ravel())


def _ease(t: FloatArray) -> FloatArray:
    """Go from 0 to 1 while t does, starting and ending at rest."""
    c = np.clip(t, 0.0, 1.0)
    return np.asarray(c * c * (3.0 - 2.0 * c))


class Handling:
    """One cloth on a table, its random numbers and the record of what was done to it.

    Attributes:
        settings: The tier's settings.
        simulator: The cloth.
        rng: Where every choice comes from.
        grid: Its masses.
        lengths_m: float64 (2,), lengths along u and v, metres.
        scale_m: Side of the square of its area, metres: the unit of the hand's paths.
        record: What was done, JSON-able.
    """

    def __init__(self, settings: ClothSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self.rng = rng
        self.grid = settings.grid
        self.lengths_m = np.array([settings.side_m, settings.length_v_m])
        self.scale_m = math.sqrt(settings.area_m2)
        self.record: list[dict[str, Any]] = []
        self._faces = grid_faces(self.grid)
        height_m = 0.5 * settings.thickness_m
        flat = flat_positions(self.grid, settings.side_m)
        flat[:, :2] -= 0.5 * self.lengths_m
        flat[:, 2] = height_m + rng.uniform(0.0, UNEVEN_SHARE * self.scale_m, len(flat))
        sheet = settings.sheet()
        contact_m = settings.contact_spacings * sheet.spacing_m
        colliders = (
            PairContact.of(sheet, contact_m, settings.cloth_friction).collide,
            partial(collide_table, height_m, settings.table_friction),
        )
        self.simulator = Simulator(sheet, flat, gravity=GRAVITY_M_S2, colliders=colliders)

    # What is seen

    def coverage(self) -> float:
        """Return the silhouette's area over the flat cloth's, as quickly counted."""
        area = silhouette_m2(self.simulator.positions, self._faces, self.scale_m / 256)
        return float(area) / self.settings.area_m2

    def middle(self) -> FloatArray:
        """Return the mean of the masses over the table: float64 (2,), metres."""
        return np.asarray(self.simulator.positions[:, :2].mean(axis=0))

    def top_vertex(self, xy: FloatArray) -> int:
        """Return the uppermost mass about a place, the nearest one where there is none."""
        offsets = self.simulator.positions[:, :2] - xy
        square = (offsets**2).sum(axis=1)
        near = np.flatnonzero(square < (1.5 * self.simulator.sheet.spacing_m) ** 2)
        if len(near) == 0:
            return int(square.argmin())
        return int(near[self.simulator.positions[near, 2].argmax()])

    # What is done

    def action(
        self, name: str, vertex: int, carry_m: FloatArray, lift: float, lower_share: float
    ) -> Action:
        """Return an action; the lift is in units of `scale_m`, the lowering a share of it."""
        return Action(
            name=name,
            vertex=int(vertex),
            carry_m=(float(carry_m[0]), float(carry_m[1])),
            lift_m=float(lift * self.scale_m),
            lower_m=float(lift * lower_share * self.scale_m),
            speed_m_s=self.settings.hand_speed_m_s,
        )

    def act(
        self,
        name: str,
        vertex: int,
        carry: npt.ArrayLike,
        lift: float,
        lower_share: float = 0.5,
        settle_s: float = 0.5,
    ) -> None:
        """Pick a mass, carry it and let go; lengths are in units of `scale_m`."""
        carried = np.asarray(carry, dtype=np.float64) * self.scale_m
        action = self.action(name, vertex, carried, lift, lower_share)
        self.record.append(action.record(self.grid))
        for _ in perform(self.simulator, action):
            pass
        self.settle(settle_s)

    def settle(self, longest_s: float) -> None:
        """Let the cloth fall until it hardly moves, or for some time."""
        check = max(1, round(CALM_CHECK_S / self.simulator.dt_s))
        for _ in range(max(1, round(longest_s / CALM_CHECK_S))):
            self.simulator.run(check)
            if self.simulator.speeds().mean() < SETTLED_SPEED_M_S:
                break

    def calm(self) -> float:
        """Brake the cloth, harder and harder, until its mean speed is under 1 mm/s.

        Returns:
            The mean speed reached, m/s; it is over the limit where the time ran out.
        """
        simulator = self.simulator
        moving = simulator.damping
        check = max(1, round(CALM_CHECK_S / simulator.dt_s))
        speed = math.inf
        for percent in CALM_DAMPING_PERCENT:
            kept = (1.0 - percent / 100.0) ** (2700.0 * simulator.dt_s)
            simulator.damping = 1.0 - kept
            for _ in range(CALM_CHECKS):
                simulator.run(check)
                speed = float(simulator.speeds().mean())
                if not speed >= CALM_SPEED_M_S:  # not a number ends it as well
                    simulator.damping = moving
                    return speed
        simulator.damping = moving
        return speed

    def stand_up(self) -> int:
        """Stand the cloth on an edge, leaning and a little twisted, and let go of it.

        Returns:
            Which of the four edges is up: 0 and 1 the ends of u, 2 and 3 those of v.
        """
        rng = self.rng
        upper = int(rng.integers(4))
        tilt_rad = rng.uniform(math.radians(25.0), math.radians(50.0))
        twist_rad = rng.uniform(math.radians(-15.0), math.radians(15.0))
        towards = -1.0 if rng.random() < 0.5 else 1.0
        up_axis = upper // 2
        rest = self.simulator.rest
        height_m, width_m = self.lengths_m[up_axis], self.lengths_m[1 - up_axis]
        raised = rest[:, up_axis] if upper % 2 else height_m - rest[:, up_axis]
        along = rest[:, 1 - up_axis] - 0.5 * width_m
        lean_rad = tilt_rad + twist_rad * along / width_m
        positions = np.empty_like(rest)
        positions[:, 1 - up_axis] = along
        positions[:, up_axis] = towards * portable.sin(lean_rad) * raised
        positions[:, up_axis] += rng.uniform(-0.005, 0.005, len(rest)) * self.scale_m
        positions[:, 2] = 0.5 * self.settings.thickness_m + portable.cos(lean_rad) * raised
        self.simulator.place(positions)
        self.record.append(
            {
                "name": "stand",
                "upper_edge": ("u=0", "u=1", "v=0", "v=1")[upper],
                "tilt_rad": float(tilt_rad),
                "twist_rad": float(twist_rad),
                "towards": towards,
            }
        )
        return upper

    def corner(self) -> int:
        """Return a random corner mass."""
        return int(self.rng.choice(corner_vertices(self.grid)))

    def anywhere(self) -> FloatArray:
        """Return a random unit direction over the table."""
        angle = self.rng.uniform(-math.pi, math.pi)
        return np.array([math.cos(angle), math.sin(angle)])

    def inwards(self, vertex: int, spread_rad: float) -> FloatArray:
        """Return a unit direction from a mass to the middle, off by a random angle."""
        towards = self.middle() - self.simulator.positions[vertex, :2]
        length = portable.norm(towards)
        angle = self.rng.uniform(-spread_rad, spread_rad)
        if length < 1e-6:
            towards, angle = np.array([1.0, 0.0]), self.rng.uniform(-math.pi, math.pi)
            length = 1.0
        c, s = math.cos(angle), math.sin(angle)
        return np.asarray(portable.product(towards / length, np.array([[c, s], [-s, c]])))
