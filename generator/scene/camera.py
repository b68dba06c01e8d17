"""How a camera is placed so that it sees the whole object.

The world is in metres with z up and the table at z = 0. Blender's axes are known to
`generator.rendering.blender` alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from pliant.generator import portable
from pliant.generator.scene.scene_object import Pose, SceneObject
from pliant.generator.settings.scene import CLEARANCE_M, MIN_MARGIN, CameraSettings
from pliant.spec.arrays import FloatArray
from pliant.spec.camera import Camera
from pliant.spec.errors import CallError

NEAR_M: Final = 1e-3
"""Surfaces nearer to the camera than this (planar z) are not seen."""

_HEADROOM_M: Final = 0.06
# How high an episode lifts things, about.

_AZIMUTH_DEG: Final = {"rope": (-180.0, 180.0), "cloth": (-20.0, 20.0)}
# With a cloth's own yaw of up to 20 degrees it stays within 45 of upright.

_WORKSPACE_SHARE: Final = 0.8
# Share of an episode's workspace that is framed: things rarely reach its rim.

_STEPS: Final = ((1.0, 60), (0.1, 400))
# Share of each correction that is taken, and rounds. Near objects in a wide view need small steps.

_BACK_OFF: Final = 0.9
_BACK_OFFS: Final = 24


def looking_at(
    eye_m: npt.ArrayLike,
    target_m: npt.ArrayLike,
    size: tuple[int, int],
    *,
    fov_deg: float = 45.0,
    up: npt.ArrayLike = (0.0, 1.0, 0.0),
) -> Camera:
    """Return the camera at `eye_m` whose centre pixel sees `target_m`.

    Args:
        eye_m: (3,), world metres.
        target_m: (3,), world metres.
        size: Width and height, px.
        fov_deg: Horizontal field of view, degrees.
        up: (3,), world direction that points up in the image; not along the view.
    """
    eye = np.asarray(eye_m, np.float64)
    rotation = _facing(np.asarray(target_m, np.float64) - eye, np.asarray(up, np.float64))
    return _placed(rotation, eye, size, fov_deg)


def seen_window(
    camera: Camera, uvz: FloatArray, margin_px: int = 0
) -> tuple[int, int, int, int] | None:
    """Return the pixels that an object can touch.

    Args:
        camera: The camera.
        uvz: float64 (V, 3), the object's projected vertices.
        margin_px: Added on each side.

    Returns:
        First and last column, first and last row (exclusive), or None if it is out of frame; all
        pixels if a vertex is behind the camera.
    """
    if uvz[:, 2].min() < NEAR_M:
        return 0, camera.width, 0, camera.height
    low = np.clip(np.floor(uvz[:, :2].min(axis=0)) - margin_px, 0, camera.size).astype(int)
    high = np.clip(np.floor(uvz[:, :2].max(axis=0)) + 1 + margin_px, 0, camera.size).astype(int)
    if (low >= high).any():
        return None
    return int(low[0]), int(high[0]), int(low[1]), int(high[1])


def sample_camera(
    rng: np.random.Generator,
    scene_object: SceneObject,
    settings: CameraSettings,
    size: tuple[int, int],
    poses: Sequence[Pose] = (),
) -> Camera:
    """Draw a camera that sees the whole object.

    Args:
        rng: Source of every random number.
        scene_object: The object; its first pose is taken where no poses are given. Of an episode
            that names its workspace (`workspace_m` in its info: extent in x and in y about the
            origin) the middle 80 % of it is framed too, so that the object stays in view.
        settings: The ranges.
        size: Width and height of the image, px.
        poses: Poses that must be wholly in the frame.

    Returns:
        A camera; every vertex of the poses projects at least 2 % inside the frame. Where `fill`
        and `shift` would put it into the object or below the table, both become smaller.

    Raises:
        CallError: `camera.distance_m` puts the camera into the object or below the table, or
            too near to see all of it.
    """
    seen = poses or (scene_object.pose(0),)
    points = np.concatenate(
        [
            pose.vertices[part.name]
            for pose in seen
            for part in scene_object.parts
            if part.colour is None
        ]
    ).astype(np.float64)
    if scene_object.temporal and "workspace_m" in scene_object.info:
        points = np.concatenate([points, _workspace_corners(scene_object.info["workspace_m"])])
    top = rng.random() < settings.top / (settings.top + settings.oblique)
    fov_deg = rng.uniform(*settings.fov_deg)
    fill = rng.uniform(*settings.fill)
    offset = rng.uniform(-1.0, 1.0, 2) * rng.uniform(*settings.shift)
    if top:
        elevation = 90.0 - rng.uniform(*settings.top_tilt_deg)
        turn = rng.uniform(-180.0, 180.0)
        roll = rng.uniform(*settings.top_roll_deg)
        up = np.array([0.0, 1.0, 0.0])
    else:
        elevation = rng.uniform(*settings.oblique_elevation_deg)
        turn = rng.uniform(*(settings.oblique_azimuth_deg or _AZIMUTH_DEG[scene_object.kind]))
        roll = rng.uniform(*settings.oblique_roll_deg)
        up = np.array([0.0, 0.0, 1.0])
        if elevation > 89.0:
            up = _direction(0.0, turn + 180.0)
    toward = _direction(elevation, turn)
    c, s = math.cos(math.radians(roll)), math.sin(math.radians(roll))
    rolled = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]
    rotation = portable.product(rolled, _facing(-toward, up))
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    if settings.distance_m is not None:
        eye = middle + toward * rng.uniform(*settings.distance_m)
        return _checked(_placed(rotation, eye, size, fov_deg), eye, points)
    for _ in range(_BACK_OFFS):
        framed = _framed(points, middle, rotation, size, fov_deg, fill, offset)
        if framed is not None and _fault(framed, points) is None:
            return framed
        fill, offset = _BACK_OFF * fill, _BACK_OFF * offset
    raise CallError(
        "no camera sees the whole object",
        where="camera",
        found=f"{elevation:.0f} degrees above the table, field of view {fov_deg:.0f} degrees",
        fix="Lower fov_deg, or raise oblique_elevation_deg.",
    )


def _checked(camera: Camera, eye: FloatArray, points: FloatArray) -> Camera:
    """Return a camera at a distance that was given; refuse one that does not see all points."""
    fault = _fault(camera, points)
    if fault is not None:
        raise CallError(
            fault,
            where="camera.distance_m",
            found=f"eye at {eye.round(3).tolist()} m",
            fix="Give a larger distance, or none, to have it chosen by camera.fill.",
        )
    return camera


def _workspace_corners(extent_m: Sequence[float]) -> FloatArray:
    """Return the corners of the box an episode moves in, float64 (8, 3), metres."""
    x, y = extent_m
    signs = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (0.0, 1.0)])
    share = _WORKSPACE_SHARE
    return np.asarray(signs * [share * x, share * y, _HEADROOM_M])


def _direction(elevation_deg: float, azimuth_deg: float) -> FloatArray:
    """Return the unit vector at an elevation over the table; azimuth 0 is -y."""
    elevation, azimuth = math.radians(elevation_deg), math.radians(azimuth_deg)
    flat = math.cos(elevation)
    return np.array([math.sin(azimuth) * flat, -math.cos(azimuth) * flat, math.sin(elevation)])


def _facing(forward: FloatArray, up: FloatArray) -> FloatArray:
    """Return the world-to-camera rotation that looks along `forward`."""
    z = forward / portable.norm(forward)
    x = np.cross(z, up)
    x /= portable.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _placed(rotation: FloatArray, eye: FloatArray, size: tuple[int, int], fov_deg: float) -> Camera:
    width, height = size
    focal = width / 2 / math.tan(math.radians(fov_deg) / 2)
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = -portable.product(eye, rotation.T)
    K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    return Camera(K, pose, size)


def _framed(
    points: FloatArray,
    middle: FloatArray,
    rotation: FloatArray,
    size: tuple[int, int],
    fov_deg: float,
    fill: float,
    offset: FloatArray,
) -> Camera | None:
    """Back away from the object until its box takes `fill` of the frame, `offset` off centre.

    Returns:
        The camera, or None where it would have to be nearer than `CLEARANCE_M`.
    """
    frame = np.asarray(size, np.float64)
    local = portable.product(points - middle, rotation.T)
    nearest = -local[:, 2].min() + CLEARANCE_M
    focal = frame[0] / 2 / math.tan(math.radians(fov_deg) / 2)
    for share, rounds in _STEPS:
        distance = nearest + float(np.ptp(local, axis=0).max())
        sideways = np.zeros(2)
        for _ in range(rounds):
            depth = local[:, 2] + distance
            uv = focal * (local[:, :2] + sideways) / depth[:, None]
            low, high = uv.min(axis=0), uv.max(axis=0)
            ratio = float(((high - low) / (frame * fill)).max())
            room = np.maximum(frame - (high - low) - 2 * MIN_MARGIN * frame, 0.0) / 2
            off = offset * room - (low + high) / 2
            sideways += share * off * distance / focal
            error = max(abs(ratio - 1), float(np.abs(off).max()) / frame[0])
            if error < 1e-3:
                break
            distance = max(nearest, distance * (1 + 0.8 * share * (ratio - 1)))
        if error < 1e-2:
            shift = np.array([sideways[0], sideways[1], distance])
            return _placed(rotation, middle - portable.product(shift, rotation), size, fov_deg)
    return None


def _fault(camera: Camera, points: FloatArray) -> str | None:
    """Return what keeps a camera from seeing the whole object from outside and above, or None."""
    eye = camera.centre_m
    low, high = points.min(axis=0) - CLEARANCE_M, points.max(axis=0) + CLEARANCE_M
    if bool(((eye > low) & (eye < high)).all()):
        return "the camera stands inside the object"
    if eye[2] < CLEARANCE_M:
        return "the camera stands below the table"
    uvz = camera.project(points)
    margin = np.array(camera.size) * MIN_MARGIN * 0.99
    inside = (uvz[:, :2] >= margin) & (uvz[:, :2] <= camera.size - margin)
    if not bool(inside.all()) or float(uvz[:, 2].min()) < NEAR_M:
        return "the camera does not see the whole object"
    return None
