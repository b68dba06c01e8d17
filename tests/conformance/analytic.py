"""Scenes whose every answer can be worked out by hand: a straight tube, a ball, a cloth.

They share no code with the generator: rays are intersected with cylinders, spheres and
planes in closed form, and a point is seen if nothing is hit before it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray

SAME_M = 1e-9


@dataclass(frozen=True)
class Tube:
    """An open straight tube around the x axis: s along x, theta around it.

    The material's s is 0 at x = 0 and 1 at x = length; theta = atan2(z - height, y).
    """

    length: float
    radius: float
    height: float
    object_id: int = 1

    def position(self, s: FloatArray, theta: FloatArray) -> FloatArray:
        """Return world positions (N, 3) of surface points."""
        return np.stack(
            [
                s * self.length,
                self.radius * np.cos(theta),
                self.height + self.radius * np.sin(theta),
            ],
            axis=1,
        )

    def axis(self, s: FloatArray) -> FloatArray:
        """Return world positions (N, 3) of centre-line points."""
        return np.stack([s * self.length, 0 * s, 0 * s + self.height], axis=1)

    def hit(self, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Intersect both walls: y² + (z - height)² = radius²."""
        o = origin - np.array([0, 0, self.height])
        a = direction[:, 1] ** 2 + direction[:, 2] ** 2
        b = direction[:, 1] * o[1] + direction[:, 2] * o[2]
        c = o[1] ** 2 + o[2] ** 2 - self.radius**2
        found = np.full(len(direction), np.inf)
        material = np.zeros((len(direction), 2))
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(b * b - a * c)
            for t in ((-b + root) / a, (-b - root) / a):
                p = o + t[:, None] * direction
                s = p[:, 0] / self.length
                good = (t > 0) & (s >= 0) & (s <= 1) & (t < found)
                found[good] = t[good]
                theta = np.arctan2(p[:, 2], p[:, 1])
                material[good] = np.stack([s, theta], axis=1)[good]
        return found, material


@dataclass(frozen=True)
class Ball:
    """A sphere; its material is longitude and height: (atan2(y, x), z / radius)."""

    centre: tuple[float, float, float]
    radius: float
    object_id: int = 2

    def position(self, longitude: FloatArray, height: FloatArray) -> FloatArray:
        """Return world positions (N, 3)."""
        ring = np.sqrt(1 - height**2)
        unit = np.stack([ring * np.cos(longitude), ring * np.sin(longitude), height], axis=1)
        return np.array(self.centre) + self.radius * unit

    def hit(self, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Intersect |p - centre| = radius, the near side."""
        o = origin - np.array(self.centre)
        a = (direction**2).sum(axis=1)
        b = direction @ o
        c = o @ o - self.radius**2
        with np.errstate(invalid="ignore"):
            t = (-b - np.sqrt(b * b - a * c)) / a
            good = t > 0
        found = np.where(good, t, np.inf)
        p = o + np.where(good, t, 0)[:, None] * direction
        material = np.stack(
            [np.arctan2(p[:, 1], p[:, 0]), np.clip(p[:, 2] / self.radius, -1, 1)], axis=1
        )
        return found, np.where(good[:, None], material, 0)


@dataclass(frozen=True)
class Sheet:
    """A square cloth folded once: two parallel halves joined by half a cylinder.

    The lower half lies at z = 0, u growing with x until the fold; after it the cloth comes
    back above, at z = gap. v is y. `flat` keeps it in one plane.
    """

    side: float
    gap: float
    flat: bool = False
    object_id: int = 1

    @property
    def _straight(self) -> float:
        """Length of each straight half: what the half circle leaves over."""
        return (self.side - np.pi * self.gap / 2) / 2

    def position(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Return world positions (N, 3)."""
        along = u * self.side
        y = v * self.side
        if self.flat:
            return np.stack([along, y, 0 * along], axis=1)
        half, radius = self._straight, self.gap / 2
        angle = np.clip((along - half) / radius, 0, np.pi)
        back = np.maximum(along - half - np.pi * radius, 0)
        x = np.minimum(along, half) + radius * np.sin(angle) - back
        z = radius - radius * np.cos(angle)
        return np.stack([x, y, z], axis=1)

    def hit(self, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Intersect the planes and the half cylinder, keep the nearest inside the square."""
        count = len(direction)
        found = np.full(count, np.inf)
        material = np.zeros((count, 2))
        half, radius = self._straight, self.gap / 2
        candidates: list[tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]] = []
        with np.errstate(invalid="ignore", divide="ignore"):
            for z in (0.0,) if self.flat else (0.0, self.gap):
                t = (z - origin[2]) / direction[:, 2]
                x = origin[0] + t * direction[:, 0]
                if self.flat:
                    candidates.append((t, x, (x >= 0) & (x <= self.side)))
                elif z == 0:
                    candidates.append((t, x, (x >= 0) & (x <= half)))
                else:
                    along = half + np.pi * radius + (half - x)
                    candidates.append((t, along, (x >= 0) & (x <= half)))
            if not self.flat:
                ox, oz = origin[0] - half, origin[2] - radius
                a = direction[:, 0] ** 2 + direction[:, 2] ** 2
                b = direction[:, 0] * ox + direction[:, 2] * oz
                root = np.sqrt(b * b - a * (ox * ox + oz * oz - radius**2))
                for t in ((-b - root) / a, (-b + root) / a):
                    x, z = ox + t * direction[:, 0], oz + t * direction[:, 2]
                    angle = np.arctan2(x, -z)
                    candidates.append((t, half + radius * angle, x > 0))
            for t, along, inside in candidates:
                y = origin[1] + t * direction[:, 1]
                good = inside & (t > 0) & (t < found) & (y >= 0) & (y <= self.side)
                found[good] = t[good]
                material[good] = np.stack([along, y], axis=1)[good] / self.side
        return found, np.clip(material, 0, 1)


@dataclass(frozen=True)
class View:
    """A camera.

    Attributes:
        K: float64 (3, 3).
        world_to_camera: float64 (4, 4).
        width: Pixels.
        height: Pixels.
    """

    K: FloatArray
    world_to_camera: FloatArray
    width: int
    height: int

    @classmethod
    def looking(
        cls, eye: FloatArray, target: FloatArray, focal_px: float, width: int, height: int
    ) -> View:
        """Return a camera at `eye` that sees `target` in the middle, image x near world x."""
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, down, forward])
        pose[:3, 3] = -pose[:3, :3] @ eye
        K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1]])
        return cls(K, pose, width, height)

    @property
    def eye(self) -> FloatArray:
        """The camera's world position (3,)."""
        R = self.world_to_camera[:3, :3]
        return np.asarray(-R.T @ self.world_to_camera[:3, 3])

    def rays(self, uv_px: FloatArray) -> FloatArray:
        """Return world directions (N, 3) whose camera-space z is 1."""
        local = np.stack(
            [
                (uv_px[:, 0] - self.K[0, 2]) / self.K[0, 0],
                (uv_px[:, 1] - self.K[1, 2]) / self.K[1, 1],
                np.ones(len(uv_px)),
            ],
            axis=1,
        )
        return np.asarray(local @ self.world_to_camera[:3, :3])

    def project(self, xyz_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pixels (N, 2) and depth (N,)."""
        local = xyz_m @ self.world_to_camera[:3, :3].T + self.world_to_camera[:3, 3]
        uv = local[:, :2] / local[:, 2:] * self.K[[0, 1], [0, 1]] + self.K[:2, 2]
        return uv, local[:, 2]


@dataclass(frozen=True)
class Scene:
    """Shapes seen together.

    Attributes:
        shapes: The objects.
        centreline_diameter: Diameter of the tube, for the rule of centre-line points.
        length: Length of the tube.
    """

    shapes: tuple[Tube | Ball | Sheet, ...]
    centreline_diameter: float = 0.0
    length: float = 1.0

    def trace(
        self, origin: FloatArray, direction: FloatArray
    ) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]:
        """Return the first hits of N rays.

        Returns:
            float64 (N,), multiples of the ray's direction, inf for none; material coordinates,
            float64 (N, 2), 0 for none; object ids, int64 (N,), 0 for none.
        """
        t = np.full(len(direction), np.inf)
        material = np.zeros((len(direction), 2))
        object_id = np.zeros(len(direction), np.int64)
        for shape in self.shapes:
            found, where = shape.hit(origin, direction)
            nearer = found < t
            t[nearer] = found[nearer]
            material[nearer] = where[nearer]
            object_id[nearer] = shape.object_id
        return t, material, object_id

    def image(self, view: View) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]:
        """Return depth (H, W), material (H, W, 2) and object ids (H, W) at pixel centres."""
        v, u = np.mgrid[: view.height, : view.width] + 0.5
        rays = view.rays(np.stack([u.ravel(), v.ravel()], axis=1))
        t, material, object_id = self.trace(view.eye, rays)
        # The rays' camera-space z is 1, so t is planar depth.
        return t.reshape(u.shape), material.reshape(*u.shape, 2), object_id.reshape(u.shape)

    def states(
        self,
        view: View,
        xyz_m: FloatArray,
        object_id: npt.NDArray[np.int64],
        s_of_line: FloatArray,
    ) -> list[str]:
        """Return the visibility state of points.

        Args:
            view: The camera.
            xyz_m: float64 (N, 3).
            object_id: int64 (N,), the points' objects.
            s_of_line: float64 (N,), s of a centre-line point; NaN for a surface point.
        """
        uv, depth = view.project(xyz_m)
        t, material, shown = self.trace(view.eye, view.rays(uv))
        states = []
        for index in range(len(xyz_m)):
            inside = 0 <= uv[index, 0] < view.width and 0 <= uv[index, 1] < view.height
            own = shown[index] == object_id[index]
            seen = t[index] >= depth[index] - SAME_M
            if not np.isnan(s_of_line[index]):
                gap = abs(material[index, 0] - s_of_line[index]) * self.length
                seen = own and gap <= self.centreline_diameter
            if not inside or depth[index] <= 0:
                states.append("out_of_frame")
            elif seen:
                states.append("visible")
            else:
                states.append("self_occluded" if own else "occluded")
        return states
