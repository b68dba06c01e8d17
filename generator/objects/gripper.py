"""A gripper on an arm, which episodes may show at the place where the object is held.

It is an object of the scene like any other: it casts shadows, it is in the surface images, and
points behind it are `occluded`. Nothing is asked about it and the physics does not know it. Between
two actions it is away: all of its vertices are at one vertex of the object, so it has no surface.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from pliant.generator import portable
from pliant.generator.scene.scene_object import GRIPPER, Part, Pose, SceneObject, quads
from pliant.spec.arrays import FloatArray, Int32Array

_COLOUR: Final = (0.055, 0.055, 0.06)
_FINGER_M: Final = (0.010, 0.022, 0.07)
_PALM_M: Final = (0.075, 0.05, 0.035)
_ARM_M: Final = (0.8, 0.06, 0.05)
_ARM_RISE_RAD: Final = (0.45, 0.8)
EXTENT_M: Final = 1.0
"""Bound of the rest coordinates: what material coordinate 1 stands for."""


def add_gripper(scene_object: SceneObject, rng: np.random.Generator) -> SceneObject:
    """Return an episode's scene object with a gripper that holds what the hand holds.

    Args:
        scene_object: An episode. The info of its poses says where the hand is.
        rng: Source of the arm's direction, which stays within 90 degrees over the episode.
    """
    rest, faces = _boxes(scene_object.thickness_m, rng.uniform(*_ARM_RISE_RAD))
    azimuth_rad = rng.uniform(-math.pi, math.pi)
    part = Part(
        object_id=max(each.object_id for each in scene_object.parts) + 1,
        name=GRIPPER,
        faces=faces,
        rest=rest,
        chart=_chart,
        strand=np.zeros(len(rest), np.int32),
        colour=_COLOUR,
    )

    def pose(frame: int) -> Pose:
        bare = scene_object.pose(frame)
        return replace(bare, vertices={**bare.vertices, GRIPPER: _placed(bare, rest, azimuth_rad)})

    return replace(scene_object, parts=(*scene_object.parts, part), pose=pose)


def _placed(pose: Pose, rest: FloatArray, azimuth_rad: float) -> FloatArray:
    """Return the gripper's vertices, float64 (V, 3), world metres."""
    hand_m = pose.info.get("hand_m", pose.info.get("hand"))
    if hand_m is None:
        first = next(iter(pose.vertices.values()))[:1]
        return np.repeat(first, len(rest), axis=0)
    place, yaw = np.asarray(hand_m, np.float64), azimuth_rad
    line = pose.centreline
    if line is not None:  # the rope lags behind the hand; the fingers are on both sides of it
        at = round(pose.info["picked_s"] * (len(line) - 1))
        place = line[at]
        along = line[min(at + 2, len(line) - 1)] - line[max(at - 2, 0)]
        across = math.atan2(along[1], along[0]) + 0.5 * math.pi
        yaw = across + math.pi * round((azimuth_rad - across) / math.pi)
    c, s = math.cos(yaw), math.sin(yaw)
    turned = np.stack([c * rest[:, 0] - s * rest[:, 1], s * rest[:, 0] + c * rest[:, 1]], axis=1)
    return np.column_stack([turned + place[:2], np.maximum(rest[:, 2] + place[2], 0.001)])


def _boxes(thickness_m: float, rise_rad: float) -> tuple[FloatArray, Int32Array]:
    """Return two fingers along z that open along x, the palm above, and the arm towards +x."""
    gap, tall = 0.5 * thickness_m + 0.001, _FINGER_M[2]
    bottom = -0.4 * thickness_m
    finger, palm = np.array(_FINGER_M), np.array([max(_PALM_M[0], 2.5 * thickness_m), *_PALM_M[1:]])
    top = bottom + tall
    arm = np.array([math.cos(rise_rad), 0.0, math.sin(rise_rad)])
    turn = np.array([arm, [0.0, 1.0, 0.0], [-arm[2], 0.0, arm[0]]])
    parts = [
        _box(np.array([side * (gap + 0.5 * finger[0]), 0.0, bottom + 0.5 * tall]), finger)
        for side in (-1.0, 1.0)
    ]
    parts.append(_box(np.array([0.0, 0.0, top + 0.5 * palm[2]]), palm))
    middle = np.array([0.0, 0.0, top + palm[2]]) + 0.5 * _ARM_M[0] * arm
    parts.append(_box(middle, np.array(_ARM_M), turn))
    faces = np.arange(4 * 24, dtype=np.int32).reshape(-1, 4).T  # four corners of each side
    return np.concatenate(parts), quads(*faces)


def _box(middle: FloatArray, size: FloatArray, axes: FloatArray | None = None) -> FloatArray:
    """Return the corners of the six sides of a box, outward, float64 (24, 3), metres."""
    corners = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            middle_of_side = side * np.eye(3)[axis]
            around = [-u - v, u - v, u + v, v - u]
            corners += [middle_of_side + each for each in (around if side > 0 else around[::-1])]
    scaled = 0.5 * np.array(corners) * size
    return np.asarray(middle + (scaled if axes is None else portable.product(scaled, axes)))


def _chart(rest: FloatArray) -> FloatArray:
    """Return height above the grasp and distance across: not unique, nothing is asked here."""
    return np.clip(np.stack([rest[:, 2] + 0.1, rest[:, 1] + 0.5], axis=1) / EXTENT_M, 0.0, 1.0)
