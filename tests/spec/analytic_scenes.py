"""Random scenes in closed form: sheets, tubes and balls, met by rays without any mesh.

Nothing here is shared with the generator. A plane, a cylinder and a torus are intersected by
solving a polynomial; a wave by sign changes along the ray and bisection.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pliant.spec.arrays import FloatArray
from tests.conformance import base
from tests.conformance.analytic import Ball, Scene, Shape, Sheet, Tube, View
from tests.conformance.base import NamedPoints, Shot
from tests.dataset_files import coordinate, tier

STEPS = 400


@dataclass(frozen=True)
class Placed:
    """A shape, rotated and moved."""

    shape: Any
    rotation: FloatArray
    offset: FloatArray

    @property
    def object_id(self) -> int:
        return int(self.shape.object_id)

    def position(self, m0: FloatArray, m1: FloatArray) -> FloatArray:
        return np.asarray(self.shape.position(m0, m1) @ self.rotation.T + self.offset)

    def hit(self, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        found: tuple[FloatArray, FloatArray] = self.shape.hit(
            (origin - self.offset) @ self.rotation, direction @ self.rotation
        )
        return found


@dataclass(frozen=True)
class Bent:
    """A rectangular sheet bent around the y axis: part of a cylinder of some radius."""

    side: float
    radius: float
    object_id: int = 1

    def position(self, u: FloatArray, v: FloatArray) -> FloatArray:
        angle = (u - 0.5) * self.side / self.radius
        x, z = self.radius * np.sin(angle), self.radius * (np.cos(angle) - 1)
        return np.stack([x, (v - 0.5) * self.side, z], axis=1)

    def hit(self, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        o = origin + np.array([0, 0, self.radius])
        a = direction[:, 0] ** 2 + direction[:, 2] ** 2
        b = direction[:, 0] * o[0] + direction[:, 2] * o[2]
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(b * b - a * (o[0] ** 2 + o[2] ** 2 - self.radius**2))
            roots = np.stack([(-b - root) / a, (-b + root) / a], axis=1)
            p = o + roots[..., None] * direction[:, None]
            u = np.arctan2(p[..., 0], p[..., 2]) * self.radius / self.side + 0.5
            v = p[..., 1] / self.side + 0.5
        return first(roots, np.stack([u, v], axis=-1))


@dataclass(frozen=True)
class Wave:
    """A square sheet in the shape z = height * sin(k x + phase); u follows x, v follows y."""

    side: float
    height: float
    k: float
    phase: float
    object_id: int = 1

    def position(self, u: FloatArray, v: FloatArray) -> FloatArray:
        x = (u - 0.5) * self.side
        z = self.height * np.sin(self.k * x + self.phase)
        return np.stack([x, (v - 0.5) * self.side, z], axis=1)

    def hit(self, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        half = np.array([self.side / 2, self.side / 2, self.height]) + 1e-9
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(-half - origin) / direction, (half - origin) / direction])
        enter = np.nan_to_num(ends.min(axis=0), nan=-np.inf).max(axis=1)
        leave = np.nan_to_num(ends.max(axis=0), nan=np.inf).min(axis=1)
        meets = leave > np.maximum(enter, 0)
        t = np.full((len(direction), 8), np.inf)
        material = np.zeros((len(direction), 8, 2))
        ray = np.flatnonzero(meets)
        steps = np.linspace(0, 1, STEPS)
        times = enter[ray, None] + (leave - enter)[ray, None] * steps
        value = self._above(origin, direction[ray], times)
        which, at = np.nonzero(np.sign(value[:, 1:]) != np.sign(value[:, :-1]))
        slot = np.arange(len(which)) - np.searchsorted(which, which)
        keep = slot < 8
        which, at, slot = which[keep], at[keep], slot[keep]
        low, high = times[which, at][:, None], times[which, at + 1][:, None]
        rays = direction[ray[which]]
        side = np.sign(self._above(origin, rays, low))
        for _ in range(50):
            middle = (low + high) / 2
            same = np.sign(self._above(origin, rays, middle)) == side
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        t[ray[which], slot] = low[:, 0]
        p = origin + low * rays
        material[ray[which], slot] = p[:, :2] / self.side + 0.5
        return first(t, material)

    def _above(self, origin: FloatArray, direction: FloatArray, t: FloatArray) -> FloatArray:
        x = origin[0] + t * direction[:, 0, None]
        z = origin[2] + t * direction[:, 2, None]
        return np.asarray(z - self.height * np.sin(self.k * x + self.phase))


@dataclass(frozen=True)
class Arc:
    """An open tube bent to an arc in the plane z = 0: part of a torus around the z axis."""

    bend: float
    radius: float
    angle: float
    object_id: int = 1

    def position(self, s: FloatArray, theta: FloatArray) -> FloatArray:
        around = s * self.angle
        out = self.bend + self.radius * np.cos(theta)
        z = self.radius * np.sin(theta)
        return np.stack([out * np.cos(around), out * np.sin(around), z], axis=1)

    def hit(self, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        length = np.linalg.norm(direction, axis=1)
        d = direction / length[:, None]
        near = -(d @ origin)  # count t from the point nearest to the torus's centre
        o = origin + near[:, None] * d
        b = (o * d).sum(axis=1)
        c = (o * o).sum(axis=1) + self.bend**2 - self.radius**2
        a2, a1, a0 = (
            d[:, 0] ** 2 + d[:, 1] ** 2,
            2 * (o[:, 0] * d[:, 0] + o[:, 1] * d[:, 1]),
            o[:, 0] ** 2 + o[:, 1] ** 2,
        )
        # (t² + 2 b t + c)² = 4 bend² (a2 t² + a1 t + a0)
        four = 4 * self.bend**2
        coefficients = np.stack(
            [4 * b, 4 * b * b + 2 * c - four * a2, 4 * b * c - four * a1, c * c - four * a0], axis=1
        )
        companion = np.zeros((len(d), 4, 4))
        companion[:, 0] = -coefficients
        companion[:, [1, 2, 3], [0, 1, 2]] = 1
        roots = np.linalg.eigvals(companion)
        real = np.abs(roots.imag) < 1e-7
        t = np.where(real, roots.real, np.inf)
        with np.errstate(invalid="ignore"):
            p = o[:, None] + t[..., None] * d[:, None]
            s = np.mod(np.arctan2(p[..., 1], p[..., 0]), 2 * np.pi) / self.angle
            theta = np.arctan2(p[..., 2], np.hypot(p[..., 0], p[..., 1]) - self.bend)
        material = np.stack([np.where(real, s, 2.0), theta], axis=-1)
        return first((t + near[:, None]) / length[:, None], material, high=(1.0, np.pi))


def first(
    t: FloatArray, material: FloatArray, high: tuple[float, float] = (1.0, 1.0)
) -> tuple[FloatArray, FloatArray]:
    """Return the nearest of each ray's roots (N, K) that is on the material (N, K, 2)."""
    low = (0.0, -np.pi) if high[1] > 1 else (0.0, 0.0)
    with np.errstate(invalid="ignore"):
        inside = np.all((material >= low) & (material <= high), axis=2) & (t > 0) & np.isfinite(t)
    t = np.where(inside, t, np.inf)
    best = t.argmin(axis=1)
    rows = np.arange(len(t))
    found = t[rows, best]
    return found, np.where(np.isfinite(found)[:, None], material[rows, best], 0.0)


def turn(rng: np.random.Generator) -> FloatArray:
    """Return a random rotation (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q if np.linalg.det(q) > 0 else q[:, ::-1])


def _material(kind: str, shape: Any) -> list[dict[str, Any]]:
    if kind == "sheet":
        side = shape.side
        return [coordinate("u", 0.0, 1.0, side), coordinate("v", 0.0, 1.0, side)]
    if kind == "ball":
        return [
            coordinate("longitude", -np.pi, np.pi, shape.radius, 2 * np.pi),
            coordinate("height", -1.0, 1.0, shape.radius),
        ]
    length = shape.length if isinstance(shape, Tube) else shape.bend * shape.angle
    return [
        coordinate("s", 0.0, 1.0, length),
        coordinate("theta", -np.pi, np.pi, shape.radius, 2 * np.pi),
    ]


def _shape(rng: np.random.Generator, kind: str, object_id: int) -> Any:
    if kind == "ball":
        x, y, z = rng.uniform(-0.15, 0.15, 3).tolist()
        return Ball((x, y, z), float(rng.uniform(0.01, 0.12)), object_id)
    if kind == "tube":
        radius = float(np.exp(rng.uniform(np.log(0.002), np.log(0.05))))
        if rng.random() < 0.5:
            return Tube(float(rng.uniform(0.2, 0.6)), radius, 0.0, object_id)
        bend = float(rng.uniform(max(0.08, 1.5 * radius), 0.25))
        return Arc(bend, radius, float(rng.uniform(0.5, 5.5)), object_id)
    side = float(rng.uniform(0.2, 0.5))
    choice = rng.integers(4)
    if choice == 0:
        return Sheet(side, 0.01, True, object_id)
    if choice == 1:
        return Bent(side, float(rng.uniform(0.5, 3) * side / np.pi), object_id)
    if choice == 2:
        return Sheet(side, float(rng.uniform(0.02, 0.3) * side), False, object_id)
    k = float(rng.uniform(0.5, 3) * 2 * np.pi / side)
    return Wave(side, float(rng.uniform(0.1, 0.8) / k), k, float(rng.uniform(0, 6)), object_id)


def write_random_dataset(root: Path, seed: int) -> None:
    """Write a dataset of one sequence of two frames: a sheet or a tube, often with an occluder."""
    rng = np.random.default_rng(seed)
    main = "sheet" if rng.random() < 0.5 else "tube"
    kinds = [main]
    if rng.random() < 0.5:
        kinds.append(str(rng.choice(["sheet", "tube", "ball"])))
    shapes = [_shape(rng, kind, number + 1) for number, kind in enumerate(kinds)]
    described = tier(
        "cloth-1" if main == "sheet" else "rope-bare",
        "cloth" if main == "sheet" else "rope",
        {
            f"object-{shape.object_id}": _material(kind, shape)
            for kind, shape in zip(kinds, shapes, strict=True)
        },
    )
    points = _points(kinds)
    shots = []
    for _ in range(2):
        placed: list[Shape] = [
            shape
            if isinstance(shape, Ball)
            else Placed(shape, turn(rng), rng.uniform(-0.1, 0.1, 3))
            for shape in shapes
        ]
        eye = turn(rng)[0] * rng.uniform(0.5, 1.1)
        view = View.looking(
            eye, rng.uniform(-0.05, 0.05, 3), base.FOCAL_PX, base.WIDTH, base.HEIGHT
        )
        shots.append(Shot(Scene(tuple(placed)), view))
    row = base.write_sequence(root, described, "train", 0, points, shots)
    base.write_dataset(root, "analytic", [row], [described])


def _points(kinds: list[str]) -> NamedPoints:
    """Return a grid of points of each object, with the corners of the sheets."""
    parts, ids = [], []
    for number, kind in enumerate(kinds):
        if kind == "sheet":
            m0, m1 = np.meshgrid(np.linspace(0, 1, 11), np.linspace(0, 1, 11))
        elif kind == "tube":
            m0, m1 = np.meshgrid(np.linspace(0.001, 0.999, 25), np.arange(8) * np.pi / 4 - 3)
        else:
            m0, m1 = np.meshgrid(np.linspace(-3, 3, 6), np.linspace(-0.95, 0.95, 5))
        parts.append(np.stack([m0.ravel(), m1.ravel()], axis=1))
        ids += [number + 1] * m0.size
    material = np.concatenate(parts)
    count = len(material)
    return NamedPoints(
        np.array(ids), np.zeros(count, np.bool_), material, np.zeros((count, 0), np.int64)
    )
