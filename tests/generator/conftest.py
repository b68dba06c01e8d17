"""Two small scene objects, written out here: a looped tube with a ball, and a folded sheet.

The maker of `runner/standin.py` is here too, because several folders use it.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from pliant.generator.objects.rope.mesh import ball_chart, ball_mesh
from pliant.generator.scene.camera import looking_at
from pliant.generator.scene.scene_object import Part, Points, Pose, SceneObject
from pliant.spec.camera import Camera

LENGTH_M = 1.0
RADIUS_M = 0.012
SIDE_M = 0.5


def tube_scene_object(rows: int = 160, ring: int = 12) -> SceneObject:
    """A tube that crosses over itself once, and a ball at its start."""
    s = np.linspace(0.0, 1.0, rows)
    t = 2.7 * s - 1.35  # the curve (t^3 - t, t^2) crosses itself at t = -1 and t = 1
    height = RADIUS_M + 0.05 * np.exp(-(((t - 1) / 0.25) ** 2))
    line = np.stack([0.25 * (t**3 - t), 0.25 * (t**2 - 0.9), height], axis=1)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    above = np.cross(side, tangent)
    theta = 2 * np.pi * np.arange(ring) / ring
    a, b = RADIUS_M * np.cos(theta), RADIUS_M * np.sin(theta)
    rest = np.stack(np.broadcast_arrays(s[:, None] * LENGTH_M, a[None], b[None]), axis=-1)
    vertices = line[:, None] + a[None, :, None] * side[:, None] + b[None, :, None] * above[:, None]
    index = np.arange(rows * ring).reshape(rows, ring)
    after = np.roll(index, -1, axis=1)
    wall = np.concatenate(
        [
            np.stack([index[:-1], after[1:], after[:-1]], axis=-1).reshape(-1, 3),
            np.stack([index[:-1], index[1:], after[1:]], axis=-1).reshape(-1, 3),
        ]
    )
    caps = [[index[0, 0], index[0, k], index[0, k + 1]] for k in range(1, ring - 1)]
    caps += [[index[-1, 0], index[-1, k + 1], index[-1, k]] for k in range(1, ring - 1)]
    rope = Part(
        object_id=1,
        name="rope",
        faces=np.concatenate([wall, caps]).astype(np.int32),
        rest=rest.reshape(-1, 3),
        chart=lambda r: np.stack([r[:, 0] / LENGTH_M, np.arctan2(r[:, 2], r[:, 1])], axis=1),
        strand=np.zeros(rows * ring, np.int32),
    )
    ball_rest, ball_faces = ball_mesh(0.025)
    ball = Part(
        object_id=2,
        name="ball",
        faces=ball_faces,
        rest=ball_rest,
        chart=ball_chart,
        strand=np.zeros(len(ball_rest), np.int32),
    )
    surface = np.arange(0, rows * ring, 3, dtype=np.int32)
    middle = np.arange(0, rows, 4, dtype=np.int32)
    count = len(surface) + len(middle)
    material = np.concatenate(
        [rope.chart(rope.rest[surface]), np.stack([s[middle], 0 * s[middle]], axis=1)]
    )
    points = Points(
        object_id=np.ones(count, np.int32),
        vertex=np.concatenate([surface, middle]),
        centreline=np.arange(count) >= len(surface),
        material=material.astype(np.float32),
        partners=np.zeros((count, 0), np.int32),
    )

    def pose(frame: int) -> Pose:
        shift = np.array([0.004 * frame, 0.002 * frame, 0.0])
        flat = vertices.reshape(-1, 3) + shift
        ball_at = line[0] + shift + [0.01, 0.0, 0.025 - RADIUS_M]
        return Pose({"rope": flat, "ball": ball_rest + ball_at}, line + shift)

    return SceneObject(
        tier="rope",
        kind="rope",
        shape="loop",
        temporal=True,
        frames=8,
        parts=(rope, ball),
        points=points,
        pose=pose,
        size_m=LENGTH_M,
        thickness_m=2 * RADIUS_M,
    )


def sheet_scene_object(cells: int = 60) -> SceneObject:
    """A wavy sheet whose corner is folded over."""
    u, v = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    rest = np.stack([u, v, 0 * u], axis=-1).reshape(-1, 3)
    x, y = (rest[:, 0] - 0.5) * SIDE_M, (rest[:, 1] - 0.5) * SIDE_M
    z = 0.006 * np.sin(24 * x + 9 * y) + 0.004 * np.sin(31 * y - 5 * x) + 0.012
    beyond = np.maximum((x + y) / np.sqrt(2) - 0.14, 0.0)
    bent = np.minimum(beyond / 0.016, np.pi)
    back = 0.016 * np.sin(bent) - np.maximum(beyond - 0.016 * np.pi, 0.0) - beyond
    x, y = x + back / np.sqrt(2), y + back / np.sqrt(2)
    z = z * np.cos(bent) ** 2 + 0.016 * (1 - np.cos(bent)) + 0.004 * (bent >= np.pi)
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    cloth = Part(
        object_id=1,
        name="cloth",
        faces=faces.astype(np.int32),
        rest=rest,
        chart=lambda r: r[:, :2].copy(),
        strand=np.zeros(len(rest), np.int32),
        double_sided=True,
    )
    tracked = np.arange(0, len(rest), 7, dtype=np.int32)
    points = Points(
        object_id=np.ones(len(tracked), np.int32),
        vertex=tracked,
        centreline=np.zeros(len(tracked), bool),
        material=rest[tracked, :2].astype(np.float32),
        partners=np.zeros((len(tracked), 0), np.int32),
    )
    vertices = np.stack([x, y, z], axis=1)
    return SceneObject(
        tier="cloth-2",
        kind="cloth",
        shape=None,
        temporal=False,
        frames=4,
        parts=(cloth,),
        points=points,
        pose=lambda frame: Pose({"cloth": vertices + np.array([0.003 * frame, 0, 0])}),
        size_m=SIDE_M,
        thickness_m=0.002,
    )


@pytest.fixture(scope="session")
def tube() -> SceneObject:
    return tube_scene_object()


@pytest.fixture(scope="session")
def sheet() -> SceneObject:
    return sheet_scene_object()


@pytest.fixture(scope="session")
def oblique() -> Camera:
    return looking_at((0.2, -0.75, 0.7), (0.0, 0.0, 0.0), (320, 240), fov_deg=48.0)


@pytest.fixture(scope="session")
def standin() -> ModuleType:
    """The stand-in maker."""
    from tests.generator.runner import standin as module

    return module
