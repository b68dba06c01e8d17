"""The constraints of a rope's physics step: each corrects the particles in place.

`now` and `before` are float64 (particles [+ 1 for the ball], 3), metres: positions, and those one
step earlier; n is the number of particles of the rope, and the ball is particle n.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pliant.generator.compiled import compiled
from pliant.generator.objects.rope.contact import segment_distance, squared_distance
from pliant.generator.objects.rope.mesh import BALL_DEPTH
from pliant.spec.arrays import FloatArray, IntArray

_ROPE_FRICTION: Final = 0.3
_BALL_INVERSE_MASS: Final = 0.25
_PRESSED_INVERSE_MASS: Final = 2.0


@compiled
def find_pairs(now: FloatArray, pairs: IntArray, n: int, apart: int, reach: float) -> int:
    """List the stretches, at least `apart` apart along the rope, that are nearer than `reach`."""
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


@compiled
def _move_apart(now: FloatArray, i: int, j: int, wi: float, wj: float, rest: float) -> None:
    """Bring two particles to a distance, each by its share of inverse mass."""
    d = math.sqrt(squared_distance(now, i, j))
    share = (d - rest) / (max(d, 1e-12) * (wi + wj))
    for c in range(3):
        move = share * (now[j, c] - now[i, c])
        now[i, c] += wi * move
        now[j, c] -= wj * move


@compiled
def bend(now: FloatArray, n: int, straighten: float, sharpest: float) -> None:
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


@compiled
def stretch(now: FloatArray, n: int, spacing: float) -> None:
    """Keep neighbours at their distance: one sweep forward, one back."""
    for q in range(2 * (n - 1)):
        i = q if q < n - 1 else 2 * (n - 1) - 1 - q
        _move_apart(now, i, i + 1, 1.0, 1.0, spacing)


@compiled
def neck(now: FloatArray, n: int, spacing: float, ball_radius: float) -> None:
    """Keep the ball at its distance, in line with the first stretch within a few degrees."""
    apart = BALL_DEPTH * ball_radius
    _move_apart(now, n, 0, _BALL_INVERSE_MASS, 1.0, apart)
    straight = 0.99 * (apart + spacing)
    if squared_distance(now, n, 1) < straight * straight:
        _move_apart(now, n, 1, _BALL_INVERSE_MASS, 1.0, straight)


@compiled
def touch(
    now: FloatArray, before: FloatArray, pairs: IntArray, count: int, held: int, contact: float
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


@compiled
def touch_ball(now: FloatArray, n: int, first: int, ball_radius: float, contact: float) -> None:
    """Push the ball and the stretches that are on it apart."""
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


@compiled
def ground(now: FloatArray, before: FloatArray, i: int, height: float, friction: float) -> None:
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
