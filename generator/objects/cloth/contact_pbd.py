"""Self-contact by positions on a pair list that cannot miss a pair.

All pairs nearer than the contact distance plus a margin are listed. No two masses can meet
that are not on the list until one of them has moved half the margin, and then the list is
created again. In each step every listed pair that is nearer than its target is parted to it at
once (position-based dynamics: Müller et al. 2007), with Coulomb friction between layers.

The target of a pair is min(d, 0.98 x its rest distance in the sheet): masses that are
neighbours in the material are nearer than d by nature, and contact must not fight their
springs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pliant.generator.compiled import compiled
from pliant.generator.objects.cloth.cells import grid_over
from pliant.generator.objects.cloth.grid import flat_positions
from pliant.generator.objects.cloth.simulator import Sheet
from pliant.spec.arrays import FloatArray, Int32Array

REST_SHARE = 0.98
"""A pair's target is at most this share of its rest distance."""

FRICTIONLESS_STEPS = 2.9
"""Masses within this many grid steps in the material are one layer: no friction between them."""

MARGIN_STEPS = 0.75
"""The pair list looks this many grid steps farther than the contact distance."""


class Pairs(NamedTuple):
    """A list of pairs of masses, with room for more.

    Attributes:
        first: int32 (room,).
        second: int32 (room,).
        target_m: float64 (room,), pairs nearer than this are parted to it.
        friction: float64 (room,), Coulomb's coefficient, 0 for none.
    """

    first: Int32Array
    second: Int32Array
    target_m: FloatArray
    friction: FloatArray

    @classmethod
    def with_room(cls, room: int) -> Pairs:
        """Return an empty list."""
        first, second = np.zeros(room, np.int32), np.zeros(room, np.int32)
        return cls(first, second, np.zeros(room), np.zeros(room))


class Layers(NamedTuple):
    """How two layers of a sheet touch.

    Attributes:
        distance_m: d, the distance at which two layers touch.
        friction: Coulomb's coefficient between layers.
        layer_m: Masses nearer than this in the sheet rub without friction.
        margin_m: How much farther than d the list looks.
    """

    distance_m: float
    friction: float
    layer_m: float
    margin_m: float


@dataclass
class PairContact:
    """The contact of one cloth: settings, and the pair list it keeps between steps.

    Attributes:
        rest: float64 (N, 3), the sheet at rest, metres.
        layers: How layers touch.
        rebuilds: How often the list was made.
    """

    rest: FloatArray
    layers: Layers
    rebuilds: int = 0
    _listed_at: FloatArray | None = None
    _count: int = 0
    _pairs: Pairs = field(default_factory=lambda: Pairs.with_room(0))

    @classmethod
    def of(cls, sheet: Sheet, distance_m: float, friction: float = 0.3) -> PairContact:
        """Return the contact of a sheet.

        Args:
            sheet: The sheet.
            distance_m: Distance at which two layers touch.
            friction: Coulomb's coefficient between layers.
        """
        step_m = sheet.spacing_m
        rest = flat_positions(sheet.grid, sheet.side_m)
        return cls(
            rest, Layers(distance_m, friction, FRICTIONLESS_STEPS * step_m, MARGIN_STEPS * step_m)
        )

    def collide(self, positions: FloatArray, previous: FloatArray, free: FloatArray) -> None:
        """Part the masses that are too near; relist first if the list may have aged.

        Args:
            positions: float64 (N, 3), metres; changed in place.
            previous: float64 (N, 3), metres, before the step: friction works on the slip.
            free: float64 (N,), 0 for a pinned or held mass.
        """
        if self._listed_at is None or moved_farther(
            positions, self._listed_at, 0.5 * self.layers.margin_m
        ):
            self._list_pairs(positions)
        part_pairs(positions, previous, free, self._pairs, self._count)

    def _list_pairs(self, positions: FloatArray) -> None:
        while True:
            count = list_pairs(positions, self.rest, self.layers, self._pairs)
            if count <= len(self._pairs.first):
                break
            self._pairs = Pairs.with_room(count + count // 2)
        self._count = count
        self._listed_at = positions.copy()
        self.rebuilds += 1


@compiled
def moved_farther(positions: FloatArray, reference: FloatArray, distance_m: float) -> bool:
    """Whether any mass is farther than a distance from where it was."""
    limit = distance_m * distance_m
    for i in range(positions.shape[0]):
        square = 0.0
        for c in range(3):
            square += (positions[i, c] - reference[i, c]) ** 2
        if not square <= limit:
            return True
    return False


@compiled
def list_pairs(positions: FloatArray, rest: FloatArray, layers: Layers, pairs: Pairs) -> int:
    """List every pair of masses nearer than d + margin, by a grid over their box.

    Args:
        positions: float64 (N, 3), metres.
        rest: float64 (N, 3), metres.
        layers: How layers touch.
        pairs: Filled as far as there is room.

    Returns:
        Number of pairs; where it exceeds the room, the list is incomplete.
    """
    reach_m = layers.distance_m + layers.margin_m
    count = positions.shape[0]
    low, edge, cells = grid_over(positions, reach_m, 64.0 * count + 1024.0)
    # Masses in the order of their cells, so that a cell's are neighbours in memory.
    start = np.zeros(cells[0] * cells[1] * cells[2] + 1, np.int32)
    key = np.empty(count, np.int32)
    for i in range(count):
        x = min(int((positions[i, 0] - low[0]) / edge), cells[0] - 1)
        y = min(int((positions[i, 1] - low[1]) / edge), cells[1] - 1)
        z = min(int((positions[i, 2] - low[2]) / edge), cells[2] - 1)
        key[i] = (x * cells[1] + y) * cells[2] + z
        start[key[i] + 1] += 1
    for k in range(start.shape[0] - 1):
        start[k + 1] += start[k]
    place = start[:-1].copy()
    mass = np.empty(count, np.int32)
    sorted_key = np.empty(count, np.int32)
    at_x, at_y, at_z = np.empty(count), np.empty(count), np.empty(count)
    for i in range(count):
        q = place[key[i]]
        place[key[i]] += 1
        mass[q] = i
        sorted_key[q] = key[i]
        at_x[q], at_y[q], at_z[q] = positions[i, 0], positions[i, 1], positions[i, 2]

    # Half of the 27 cells about each mass, so that a pair is met once: what follows it in its
    # own column of cells, and four of the eight columns around. A third of what is looked at is
    # near; every place is written down and those that are not near are written over, which costs
    # less than a branch that is hard to predict.
    found = 0
    near = np.empty(count, np.int32)
    square_reach = reach_m * reach_m
    firsts, seconds, targets_m, frictions = pairs
    room = firsts.shape[0]
    for p in range(count):
        z = sorted_key[p] % cells[2]
        column = sorted_key[p] // cells[2]
        x = column // cells[1]
        y = column % cells[1]
        hits = 0
        for side in range(5):
            nx = x + (0 if side < 2 else 1)
            ny = y + (0, 1, -1, 0, 1)[side]
            if nx >= cells[0] or ny < 0 or ny >= cells[1]:
                continue
            base = (nx * cells[1] + ny) * cells[2]
            begin = p + 1 if side == 0 else start[base + max(z - 1, 0)]
            end = start[base + min(z + 1, cells[2] - 1) + 1]
            for q in range(begin, end):
                dx, dy, dz = at_x[p] - at_x[q], at_y[p] - at_y[q], at_z[p] - at_z[q]
                near[hits] = q
                hits += dx * dx + dy * dy + dz * dz < square_reach
        i = mass[p]
        for hit in range(min(hits, room - found)):
            j = mass[near[hit]]
            square = 0.0
            for c in range(3):
                square += (rest[i, c] - rest[j, c]) ** 2
            apart = math.sqrt(square)
            firsts[found + hit] = i
            seconds[found + hit] = j
            targets_m[found + hit] = min(layers.distance_m, REST_SHARE * apart)
            frictions[found + hit] = layers.friction if apart > layers.layer_m else 0.0
        found += hits
    return found


@compiled
def part_pairs(
    positions: FloatArray, previous: FloatArray, free: FloatArray, pairs: Pairs, count: int
) -> None:
    """Part each pair that is nearer than its target, and brake its slip.

    A pair at distance l < target is moved apart along its line by target - l, shared by the
    free ends; the tangential slip since `previous` is then shortened by at most
    friction x (target - l).

    Args:
        positions: float64 (N, 3), metres; changed in place.
        previous: float64 (N, 3), metres.
        free: float64 (N,), 1 free, 0 pinned or held.
        pairs: The list.
        count: Listed pairs.
    """
    firsts, seconds, targets_m, frictions = pairs
    for q in range(count):
        i = firsts[q]
        j = seconds[q]
        dx = positions[i, 0] - positions[j, 0]
        dy = positions[i, 1] - positions[j, 1]
        dz = positions[i, 2] - positions[j, 2]
        square = dx * dx + dy * dy + dz * dz
        target = targets_m[q]
        if square >= target * target or square == 0.0:
            continue
        movable = free[i] + free[j]
        if movable == 0.0:
            continue
        distance = math.sqrt(square)
        depth = target - distance
        nx = dx / distance
        ny = dy / distance
        nz = dz / distance
        share_i = free[i] / movable
        share_j = free[j] / movable
        positions[i, 0] += depth * nx * share_i
        positions[i, 1] += depth * ny * share_i
        positions[i, 2] += depth * nz * share_i
        positions[j, 0] -= depth * nx * share_j
        positions[j, 1] -= depth * ny * share_j
        positions[j, 2] -= depth * nz * share_j
        if frictions[q] == 0.0:
            continue
        sx = (positions[i, 0] - previous[i, 0]) - (positions[j, 0] - previous[j, 0])
        sy = (positions[i, 1] - previous[i, 1]) - (positions[j, 1] - previous[j, 1])
        sz = (positions[i, 2] - previous[i, 2]) - (positions[j, 2] - previous[j, 2])
        normal = sx * nx + sy * ny + sz * nz
        sx -= normal * nx
        sy -= normal * ny
        sz -= normal * nz
        slip = math.sqrt(sx * sx + sy * sy + sz * sz)
        if slip == 0.0:
            continue
        brake = min(1.0, frictions[q] * depth / slip)
        positions[i, 0] -= brake * sx * share_i
        positions[i, 1] -= brake * sy * share_i
        positions[i, 2] -= brake * sz * share_i
        positions[j, 0] += brake * sx * share_j
        positions[j, 1] += brake * sy * share_j
        positions[j, 2] += brake * sz * share_j
