"""Position-based dynamics of a rope on a table, moved by a hand of limited force.

Position-based dynamics after Mueller, Heidelberger, Hennix, Ratcliff 2007. The rope is a chain
of particles; its stretches are capsules of the rope's radius. Everything is serial float64
without fast maths, so that a run gives the same bytes on any number of workers.

The ball, if any, is one more particle behind the first: heavier, with a contact radius of its
own, held in line with the rope's first stretch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from numba import njit

from pliant.generator.objects.rope.ball import BALL_DEPTH
from pliant.generator.objects.rope.contact import NEIGHBOUR_DIAMETERS, segment_distance
from pliant.generator.scene.scene_object import FloatArray
from pliant.generator.settings.rope import RopeSettings

_GRAVITY: Final = 9.81
_DAMPING_PER_S: Final = 8.0
_STRAIGHTENING_S: Final = 0.0066
"""Time in which a corner left alone would lose most of its angle."""
_TIGHTEST_BEND_RADII: Final = 2.2
_TABLE_FRICTION: Final = 0.7
_ROPE_FRICTION: Final = 0.3
_BALL_FRICTION: Final = 0.25
_FASTEST_M_S: Final = 2.0
_STEPS_PER_SEARCH: Final = 4
_BALL_INVERSE_MASS: Final = 0.25
_PRESSED_INVERSE_MASS: Final = 2.0
_CONTACT_MARGIN: Final = 1.05
"""Capsules are this much thicker than the rope, for the curve bulges between its particles."""


@dataclass(frozen=True)
class Physics:
    """Constants of one rope, as the compiled step takes them."""

    spacing_m: float
    radius_m: float
    contact_m: float
    ball_radius_m: float
    step_s: float
    substeps: int
    apart: int
    ball_apart: int
    hand_reach_m: float


def physics_of(settings: RopeSettings) -> Physics:
    """Return the constants of a tier's ropes."""
    spacing = settings.length_m / (settings.particles - 1)
    step = 1.0 / (settings.frame_rate_hz * settings.substeps)
    diameter = settings.diameter_m
    ball_reach = settings.ball_radius_m + settings.radius_m
    return Physics(
        spacing_m=spacing,
        radius_m=settings.radius_m,
        contact_m=_CONTACT_MARGIN * diameter,
        ball_radius_m=settings.ball_radius_m if settings.ball else 0.0,
        step_s=step,
        substeps=settings.substeps,
        apart=max(3, math.ceil(NEIGHBOUR_DIAMETERS * diameter / spacing)),
        ball_apart=max(2, math.ceil(1.5 * ball_reach / spacing)),
        # force * step^2 / mass of one particle, the force in weights of the whole rope
        hand_reach_m=settings.hand_force_weights * settings.particles * _GRAVITY * step**2,
    )


class RopeState:
    """Particles of one rope and where they were a step ago.

    Attributes:
        now: float64 (particles [+ 1 for the ball], 3), metres.
        before: The same one physics step earlier.
    """

    def __init__(self, settings: RopeSettings, curve: FloatArray, ball: FloatArray | None) -> None:
        """Put a rope at rest.

        Args:
            settings: The tier's settings.
            curve: float64 (particles, 3), equal arc length, metres.
            ball: float64 (3,), the ball's centre, or None.
        """
        self.physics = physics_of(settings)
        self.particles = len(curve)
        self.now = curve.copy() if ball is None else np.concatenate([curve, ball[None]])
        self.before = self.now.copy()
        self._pairs = np.empty((self.particles**2 // 2, 2), dtype=np.int64)

    @property
    def chain(self) -> FloatArray:
        """float64 (particles, 3), the rope without its ball, metres."""
        return self.now[: self.particles]

    @property
    def ball(self) -> FloatArray | None:
        """float64 (3,), the ball's centre, metres, or None."""
        return self.now[self.particles] if len(self.now) > self.particles else None

    def advance(self, held: int = -1, target: FloatArray | None = None) -> None:
        """Advance by one frame.

        Args:
            held: Particle in the hand, or -1.
            target: float64 (3,), where the hand wants it at the end of the frame, metres.
        """
        p = self.physics
        goal = np.zeros(3) if target is None else target
        _frame(
            self.now,
            self.before,
            self._pairs,
            self.particles,
            held,
            goal,
            p.spacing_m,
            p.radius_m,
            p.contact_m,
            p.ball_radius_m,
            p.step_s,
            p.substeps,
            p.apart,
            p.ball_apart,
            p.hand_reach_m,
        )


@njit(cache=True)
def _find_pairs(
    now: FloatArray, pairs: npt.NDArray[np.int64], n: int, apart: int, reach: float
) -> int:
    count = 0
    for a in range(n - 1):
        b = a + apart
        while b < n - 1:
            d2 = 0.0
            for c in range(3):
                d = now[a, c] + now[a + 1, c] - now[b, c] - now[b + 1, c]
                d2 += d * d
            if d2 < 4.0 * reach * reach:
                pairs[count, 0] = a
                pairs[count, 1] = b
                count += 1
            b += 1
    return count


@njit(cache=True)
def _move_apart(now: FloatArray, i: int, j: int, wi: float, wj: float, rest: float) -> None:
    """Bring two particles to a distance, each by its share of inverse mass."""
    d2 = 0.0
    for c in range(3):
        d2 += (now[j, c] - now[i, c]) ** 2
    d = math.sqrt(d2)
    share = (d - rest) / (max(d, 1e-12) * (wi + wj))
    for c in range(3):
        move = share * (now[j, c] - now[i, c])
        now[i, c] += wi * move
        now[j, c] -= wj * move


@njit(cache=True)
def _bend(now: FloatArray, n: int, straighten: float, sharpest: float) -> None:
    """Straighten every corner a little, and one sharper than the rope can bend at once.

    A corner is measured by the second difference of its three particles, which a move of
    (1, -2, 1) parts changes without pushing the rope along.
    """
    for i in range(1, n - 1):
        length = 0.0
        for c in range(3):
            length += (now[i - 1, c] - 2.0 * now[i, c] + now[i + 1, c]) ** 2
        length = math.sqrt(length)
        part = straighten
        if length > sharpest:
            part = max(part, 1.0 - sharpest / length)
        if part == 0.0:
            continue
        share = part / 6.0
        for c in range(3):
            off = (now[i - 1, c] - 2.0 * now[i, c] + now[i + 1, c]) * share
            now[i - 1, c] -= off
            now[i, c] += 2.0 * off
            now[i + 1, c] -= off


@njit(cache=True)
def _stretch(now: FloatArray, n: int, spacing: float) -> None:
    """Keep neighbours at their distance: one sweep forward, one back."""
    for q in range(2 * (n - 1)):
        i = q if q < n - 1 else 2 * (n - 1) - 1 - q
        _move_apart(now, i, i + 1, 1.0, 1.0, spacing)


@njit(cache=True)
def _neck(now: FloatArray, n: int, spacing: float, ball_radius: float) -> None:
    """Keep the ball at its distance, in line with the first stretch within a few degrees."""
    neck = BALL_DEPTH * ball_radius
    _move_apart(now, n, 0, _BALL_INVERSE_MASS, 1.0, neck)
    d2 = 0.0
    for c in range(3):
        d2 += (now[1, c] - now[n, c]) ** 2
    straight = 0.99 * (neck + spacing)
    if d2 < straight * straight:
        _move_apart(now, n, 1, _BALL_INVERSE_MASS, 1.0, straight)


@njit(cache=True)
def _touch(
    now: FloatArray,
    before: FloatArray,
    pairs: npt.NDArray[np.int64],
    count: int,
    held: int,
    contact: float,
) -> None:
    """Push touching capsules apart and rub them against each other."""
    w = np.empty(4)
    index = np.empty(4, dtype=np.int64)
    share = np.empty(4)
    normal = np.empty(3)
    slip = np.empty(3)
    for k in range(count):
        a = pairs[k, 0]
        b = pairs[k, 1]
        d2, s, t = segment_distance(now, a, b)
        if d2 >= contact * contact:
            continue
        d = math.sqrt(d2)
        if d < 1e-9:
            continue
        index[0], index[1], index[2], index[3] = a, a + 1, b, b + 1
        share[0], share[1], share[2], share[3] = 1.0 - s, s, t - 1.0, -t
        total = 0.0
        for q in range(4):
            # The hand yields to what it presses on; else it would push strands through.
            w[q] = _PRESSED_INVERSE_MASS if index[q] == held else 1.0
            total += w[q] * share[q] * share[q]
        depth = contact - d
        along = 0.0
        for c in range(3):
            normal[c] = 0.0
            slip[c] = 0.0
            for q in range(4):
                normal[c] += share[q] * now[index[q], c]
                slip[c] += share[q] * (now[index[q], c] - before[index[q], c])
            normal[c] /= d
            along += slip[c] * normal[c]
        length = 0.0
        for c in range(3):
            slip[c] -= along * normal[c]
            length += slip[c] * slip[c]
        length = math.sqrt(length)
        rub = min(1.0, _ROPE_FRICTION * depth / length) if length > 1e-12 else 0.0
        for q in range(4):
            for c in range(3):
                move = depth * normal[c] - rub * slip[c]
                now[index[q], c] += w[q] * share[q] / total * move


@njit(cache=True)
def _touch_ball(now: FloatArray, n: int, first: int, ball_radius: float, contact: float) -> None:
    """Push the ball and the stretches that lie on it apart."""
    reach = ball_radius + 0.5 * contact
    for a in range(first, n - 1):
        along = 0.0
        length = 0.0
        for c in range(3):
            u = now[a + 1, c] - now[a, c]
            along += u * (now[n, c] - now[a, c])
            length += u * u
        t = min(max(along / length, 0.0), 1.0)
        d2 = 0.0
        for c in range(3):
            d2 += (now[a, c] + t * (now[a + 1, c] - now[a, c]) - now[n, c]) ** 2
        if d2 >= reach * reach or d2 < 1e-18:
            continue
        d = math.sqrt(d2)
        total = (1.0 - t) ** 2 + t * t + _BALL_INVERSE_MASS
        push = (reach - d) / (d * total)
        for c in range(3):
            off = push * (now[a, c] + t * (now[a + 1, c] - now[a, c]) - now[n, c])
            now[a, c] += (1.0 - t) * off
            now[a + 1, c] += t * off
            now[n, c] -= _BALL_INVERSE_MASS * off


@njit(cache=True)
def _ground(now: FloatArray, before: FloatArray, i: int, height: float, friction: float) -> None:
    """Lift a particle out of the table and rub it against it."""
    depth = height - now[i, 2]
    if depth <= 0.0:
        return
    now[i, 2] = height
    dx = now[i, 0] - before[i, 0]
    dy = now[i, 1] - before[i, 1]
    slip = math.sqrt(dx * dx + dy * dy)
    if slip > 1e-12:
        rub = min(1.0, friction * depth / slip)
        now[i, 0] -= rub * dx
        now[i, 1] -= rub * dy


@njit(cache=True)
def _frame(
    now: FloatArray,
    before: FloatArray,
    pairs: npt.NDArray[np.int64],
    n: int,
    held: int,
    target: FloatArray,
    spacing: float,
    radius: float,
    contact: float,
    ball_radius: float,
    step: float,
    substeps: int,
    apart: int,
    ball_apart: int,
    hand_reach: float,
) -> None:
    keep = math.exp(-_DAMPING_PER_S * step)
    furthest = _FASTEST_M_S * step
    straighten = 1.0 - math.exp(-step / _STRAIGHTENING_S)
    half_angle = min(0.5 * spacing / (_TIGHTEST_BEND_RADII * radius), 1.2)
    sharpest = 2.0 * spacing * math.sin(half_angle)
    # No pair left out of the list can touch before the next search.
    reach = contact + spacing + 2.0 * furthest * _STEPS_PER_SEARCH
    count = 0
    start = np.zeros(3)
    if held >= 0:
        for c in range(3):
            start[c] = now[held, c]
    for sub in range(substeps):
        if sub % _STEPS_PER_SEARCH == 0:
            count = _find_pairs(now, pairs, n, apart, reach)
        for i in range(now.shape[0]):
            speed = 0.0
            for c in range(3):
                speed += (now[i, c] - before[i, c]) ** 2
            speed = keep * math.sqrt(speed)
            slow = keep if speed <= furthest else keep * furthest / speed
            for c in range(3):
                move = slow * (now[i, c] - before[i, c])
                before[i, c] = now[i, c]
                now[i, c] += move
            now[i, 2] -= _GRAVITY * step * step
        if held >= 0:
            # The hand wants to be on the straight line to its target, but no faster and no
            # stronger than it can.
            off = 0.0
            for c in range(3):
                now[held, c] = before[held, c]
                wish = start[c] + (target[c] - start[c]) * (sub + 1) / substeps
                off += (wish - now[held, c]) ** 2
            off = math.sqrt(off)
            reachable = min(furthest, hand_reach)
            part = 1.0 if off <= reachable else reachable / off
            for c in range(3):
                wish = start[c] + (target[c] - start[c]) * (sub + 1) / substeps
                now[held, c] += part * (wish - now[held, c])
        _bend(now, n, straighten, sharpest)
        if ball_radius > 0.0:
            _neck(now, n, spacing, ball_radius)
        _stretch(now, n, spacing)
        _touch(now, before, pairs, count, held, contact)
        if ball_radius > 0.0:
            _touch_ball(now, n, ball_apart, ball_radius, contact)
            _ground(now, before, n, ball_radius, _BALL_FRICTION)
        for i in range(n):
            _ground(now, before, i, radius, _TABLE_FRICTION)
