"""The named material points of a rope tier: the same vertices in every sequence."""

from __future__ import annotations

import math

import numpy as np

from pliant.generator.objects.rope.mesh import RopeMesh, rope_chart
from pliant.generator.objects.rope.tier import ROPE_ID
from pliant.generator.scene.scene_object import IntArray, Points
from pliant.generator.settings.rope import RopeSettings


def rope_points(settings: RopeSettings, mesh: RopeMesh) -> Points:
    """Return surface points on evenly spaced cross sections, then points on the centre line.

    Half of the stations are chosen and the other half are their mirror images, so that the
    reversal maps points onto points.

    Args:
        settings: How many stations, angles and centre-line points.
        mesh: The straight rope.

    Returns:
        The points. `partners` has one column without the ball and none with it.
    """
    half = settings.point_stations // 2
    rows = np.unique(
        np.floor((np.arange(half) + 0.5) * settings.rows / settings.point_stations).astype(int)
    )
    chosen = [_around(mesh, int(row), settings.point_angles) for row in rows]
    first = np.concatenate(chosen)
    second = np.concatenate([mesh.mirror[each] for each in chosen[::-1]])
    vertex = np.concatenate([first, second])
    order = np.arange(len(vertex))
    # Station k from the front is mirrored by station k from the back; within one, in order.
    sizes = [len(each) for each in chosen]
    starts = np.concatenate([np.zeros(1, int), np.cumsum(sizes)])
    partner = np.empty(len(vertex), dtype=np.int64)
    back_start = len(first)
    for k in range(len(chosen) - 1, -1, -1):
        here = order[starts[k] : starts[k + 1]]
        there = order[back_start : back_start + sizes[k]]
        partner[here], partner[there] = there, here
        back_start += sizes[k]

    count = settings.centreline_points
    along = np.linspace(0.0, 1.0, count)
    surface_material = rope_chart(settings.length_m)(mesh.rest[vertex])
    line_material = np.stack([along, np.zeros(count)], axis=1)
    line_partner = len(vertex) + np.arange(count)[::-1]
    partners = np.concatenate([partner, line_partner])[:, None]
    if settings.ball:
        partners = partners[:, :0]
    total = len(vertex) + count
    return Points(
        object_id=np.full(total, ROPE_ID, dtype=np.int32),
        vertex=np.concatenate([vertex, np.arange(count)]).astype(np.int32),
        centreline=np.arange(total) >= len(vertex),
        material=np.concatenate([surface_material, line_material]).astype(np.float32),
        partners=partners.astype(np.int32),
    )


def _around(mesh: RopeMesh, row: int, angles: int) -> IntArray:
    """Return the outer vertices of a cross section nearest to evenly spaced angles."""
    candidates = np.flatnonzero((mesh.row == row) & mesh.outer)
    theta = np.arctan2(mesh.rest[candidates, 2], mesh.rest[candidates, 1])
    free = np.ones(len(candidates), dtype=bool)
    picked = []
    for k in range(min(angles, len(candidates))):
        off = np.abs((theta - 2.0 * math.pi * k / angles + math.pi) % (2.0 * math.pi) - math.pi)
        best = int(np.argmin(np.where(free, off, np.inf)))
        free[best] = False
        picked.append(candidates[best])
    return np.array(picked, dtype=np.int32)
