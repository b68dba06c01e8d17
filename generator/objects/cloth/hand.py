"""A hand that picks a point of the cloth, lifts it, carries it along a smooth arc and lets go."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.generator.objects.cloth.simulator import Simulator

FloatArray = npt.NDArray[np.float64]

_SAMPLES = 256


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

    def record(self, columns: int, rows: int) -> dict[str, Any]:
        """Return the action as a JSON object, with the picked point as (u, v)."""
        row, column = divmod(self.vertex, columns)
        facts = asdict(self)
        del facts["vertex"]
        facts["carry_m"] = list(self.carry_m)
        return {"picked": [column / (columns - 1), row / (rows - 1)], **facts}


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
    moved: FloatArray = np.diff(places, axis=0)
    return moved


def perform(simulator: Simulator, action: Action) -> Iterator[FloatArray]:
    """Carry out an action step by step.

    Args:
        simulator: The cloth; one step of it is made before each yield.
        action: What the hand does.

    Yields:
        The hand's position after each step: float64 (3,), metres in the world.
    """
    sheet = simulator.sheet
    held = grip(action.vertex, sheet.columns, sheet.rows)
    where = simulator.positions[action.vertex].copy()
    simulator.free[held] = 0.0
    try:
        for move in hand_steps(action, simulator.dt_s):
            simulator.step(move)
            where += move
            yield where.copy()
    finally:
        simulator.free[held] = 1.0


def grip(vertex: int, columns: int, rows: int) -> npt.NDArray[np.int64]:
    """Return the masses a hand holds: the 3 x 3 patch about one, cut at the cloth's edges."""
    row, column = divmod(vertex, columns)
    patch_rows = np.arange(max(row - 1, 0), min(row + 2, rows))
    patch_columns = np.arange(max(column - 1, 0), min(column + 2, columns))
    held: npt.NDArray[np.int64] = (patch_rows[:, None] * columns + patch_columns).ravel()
    return held


def _ease(t: FloatArray) -> FloatArray:
    """Go from 0 to 1 while t does, starting and ending at rest."""
    c = np.clip(t, 0.0, 1.0)
    eased: FloatArray = c * c * (3.0 - 2.0 * c)
    return eased
