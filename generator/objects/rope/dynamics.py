"""Position-based dynamics of a rope on a table, moved by a hand of limited force.

Position-based dynamics after Mueller, Heidelberger, Hennix, Ratcliff 2007. The rope is a chain
of particles; its stretches are capsules of the rope's radius. Everything is serial float64
without fast maths, so that a run gives the same bytes on any number of workers.

The ball, if any, is one more particle behind the first: heavier, with a contact radius of its
own, held in line with the rope's first stretch.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from pliant.generator.compiled import compiled
from pliant.generator.objects.rope.constraints import (
    bend,
    find_pairs,
    ground,
    neck,
    stretch,
    touch,
    touch_ball,
)
from pliant.generator.objects.rope.contact import NEIGHBOUR_DIAMETERS
from pliant.generator.objects.rope.curve import first_direction, resample, smooth_curve, turned
from pliant.generator.settings.rope import RopeSettings
from pliant.spec.arrays import FloatArray, IntArray

_GRAVITY: Final = 9.81
_DAMPING_PER_S: Final = 8.0
_STRAIGHTENING_S: Final = 0.0066
"""Time in which a corner left alone would lose most of its angle."""
_TIGHTEST_BEND_RADII: Final = 2.2
_TABLE_FRICTION: Final = 0.7
_BALL_FRICTION: Final = 0.25
_FASTEST_M_S: Final = 2.0
_STEPS_PER_SEARCH: Final = 4
_CONTACT_MARGIN: Final = 1.05
"""Capsules are this much thicker than the rope, for the curve bulges between its particles."""


class Physics(NamedTuple):
    """Constants of one rope, as the compiled step takes them.

    Attributes:
        particles: Particles of the rope, without the ball.
        spacing_m: Distance of neighbouring particles.
        radius_m: Radius of the rope.
        contact_m: Diameter of the capsules.
        ball_radius_m: Radius of the ball; 0 without one.
        step_s: Length of a physics step.
        substeps: Physics steps per frame.
        apart: Stretches this many particles apart can touch.
        ball_apart: From this particle on, the rope can touch the ball.
        hand_reach_m: Farthest that the hand can pull a particle in a step.
    """

    particles: int
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
        particles=settings.particles,
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
        normal: float64 (3,), direction of theta = 0 at s = 0, zero until it is set. It turns with
            the rope's first stretch, by no more than that does.
    """

    def __init__(self, settings: RopeSettings, curve: FloatArray, ball: FloatArray | None) -> None:
        """Put a rope at rest.

        Args:
            settings: The tier's settings.
            curve: float64 (particles, 3), equal arc length, metres.
            ball: float64 (3,), the ball's centre, or None.
        """
        self.settings = settings
        self.physics = physics_of(settings)
        self.normal = np.zeros(3)
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
        goal = np.zeros(3) if target is None else target
        first = first_direction(self.chain)
        _frame(self.now, self.before, self._pairs, held, goal, self.physics)
        self.normal = turned(self.normal, first, first_direction(self.chain))

    def centreline(self) -> FloatArray:
        """Return the smooth curve through the particles: float64 (rows, 3), metres, equal steps."""
        smooth = smooth_curve(self.chain, self.settings.radius_m)
        return resample(smooth, self.settings.rows)


@compiled
def _frame(
    now: FloatArray,
    before: FloatArray,
    pairs: IntArray,
    held: int,
    target: FloatArray,
    physics: Physics,
) -> None:
    n, spacing, step = physics.particles, physics.spacing_m, physics.step_s
    radius, ball_radius, contact = physics.radius_m, physics.ball_radius_m, physics.contact_m
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
    for sub in range(physics.substeps):
        if sub % _STEPS_PER_SEARCH == 0:
            count = find_pairs(now, pairs, n, physics.apart, reach)
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
                wish = start[c] + (target[c] - start[c]) * (sub + 1) / physics.substeps
                off += (wish - now[held, c]) ** 2
            off = math.sqrt(off)
            reachable = min(furthest, physics.hand_reach_m)
            part = 1.0 if off <= reachable else reachable / off
            for c in range(3):
                wish = start[c] + (target[c] - start[c]) * (sub + 1) / physics.substeps
                now[held, c] += part * (wish - now[held, c])
        bend(now, n, straighten, sharpest)
        if ball_radius > 0.0:
            neck(now, n, spacing, ball_radius)
        stretch(now, n, spacing)
        touch(now, before, pairs, count, held, contact)
        if ball_radius > 0.0:
            touch_ball(now, n, physics.ball_apart, ball_radius, contact)
            ground(now, before, n, ball_radius, _BALL_FRICTION)
        for i in range(n):
            ground(now, before, i, radius, _TABLE_FRICTION)
