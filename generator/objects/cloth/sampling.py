"""From settings and a seed to a scene object: the cloth tiers as the renderer takes them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.cloth.configuration import Configurations
from pliant.generator.objects.cloth.episode import Episode
from pliant.generator.objects.cloth.grid import grid_faces, mapped_vertices
from pliant.generator.objects.cloth.surface import PART
from pliant.generator.scene.scene_object import Part, Points, SceneObject
from pliant.generator.seeding import RandomStreams
from pliant.generator.settings.cloth import ClothSettings, Variant
from pliant.spec.arrays import FloatArray
from pliant.spec.configuration import settings_to_dict
from pliant.spec.model import (
    SQUARE_MIRRORS,
    SQUARE_ROTATIONS,
    MaterialCoordinate,
    MaterialObject,
    Symmetry,
    Tier,
)

CLOTH_ID: Final = 1

SYMMETRIES: Final[dict[Variant, tuple[Symmetry, ...]]] = {
    # Both faces alike: turning the cloth over about an axis in its plane mirrors (u, v).
    "plain": SQUARE_ROTATIONS + SQUARE_MIRRORS,
    # A wide stripe is near one end, a narrow one along one side, on both faces, in exchanged
    # colours. From the back they are a mirror image, so the picture says which face is up.
    "towel": (),
}
"""Variant -> the maps of (u, v) under which the cloth looks the same, without the identity."""


def cloth_tier(settings: ClothSettings, name: str) -> Tier:
    """Return the tier of a cloth: objects, material coordinates, symmetries.

    Args:
        settings: The tier's settings.
        name: Its name, such as `cloth-1`.
    """
    side_m = float(settings.side_m)
    material = (
        MaterialCoordinate("u", 0.0, 1.0, side_m),
        MaterialCoordinate("v", 0.0, 1.0, side_m),
    )
    cloth = MaterialObject(CLOTH_ID, PART, material)
    variant = settings.variant
    return Tier(name, "cloth", variant, CLOTH_ID, (cloth,), SYMMETRIES[variant])


def describe(config: GenerateConfig, tier: str) -> Tier:
    """Return a cloth tier of a dataset."""
    return cloth_tier(_settings_of(config, tier), tier)


def sample(config: GenerateConfig, streams: RandomStreams) -> SceneObject:
    """Draw one sequence of a dataset's cloth tier, as `sample_cloth` does."""
    settings = _settings_of(config, streams.task.tier)
    return sample_cloth(settings, streams, config.frames, temporal=config.episodes)


def _settings_of(config: GenerateConfig, tier: str) -> ClothSettings:
    """Return the settings of a tier: a towel has level 2 unless one is given, and any angle."""
    if tier != "towel":
        return config.cloth
    level = config.cloth.level or 2
    return config.cloth.replace(variant="towel", level=level, yaw_max_rad=math.pi)


def sample_cloth(
    settings: ClothSettings, streams: RandomStreams, frames: int = 1, *, temporal: bool = False
) -> SceneObject:
    """Sample one sequence of a cloth tier; nothing is simulated before a pose is asked for.

    Args:
        settings: The tier's settings.
        streams: The sequence and its random numbers.
        frames: Number of frames.
        temporal: True for an episode (frames in time, pick, lift, carry, release); False for
            independent configurations of the same cloth.

    Returns:
        The scene object. Asked for twice, a frame is the same.

    Raises:
        CallError: The tier names no level.
    """
    tier = streams.task.tier
    level = settings.level_of(tier)
    make_poses = Episode if temporal else Configurations
    parts, points = cloth_parts(settings)
    return SceneObject(
        tier=tier,
        kind="cloth",
        shape=None,
        temporal=temporal,
        frames=frames,
        parts=parts,
        points=points,
        pose=make_poses(settings, level, streams),
        size_m=settings.side_m,
        thickness_m=settings.thickness_m,
        info={
            "level": level,
            "coverage_band": list(settings.band_of(level)),
            "cloth": settings_to_dict(settings),
            "steps_per_second": settings.sheet().steps_per_second,
        },
        variant=settings.variant,
    )


def cloth_parts(settings: ClothSettings) -> tuple[tuple[Part, ...], Points]:
    """Return the mesh of a cloth and its named material points."""
    return (_part(settings),), _points(settings)


def _part(settings: ClothSettings) -> Part:
    side = settings.render_a_side
    row, column = np.divmod(np.arange(side * side), side)
    rest = np.zeros((side * side, 3))
    rest[:, 0] = column / settings.render_cells
    rest[:, 1] = row / settings.render_cells
    return Part(
        object_id=CLOTH_ID,
        name=PART,
        faces=grid_faces(side),
        rest=rest,
        chart=_chart,
        strand=np.zeros(side * side, dtype=np.int32),
        double_sided=True,
    )


def _chart(rest: FloatArray) -> FloatArray:
    """A cloth's rest coordinates are (u, v, 0)."""
    return np.asarray(rest[:, :2], dtype=np.float64)


def _points(settings: ClothSettings) -> Points:
    side, tracked = settings.render_a_side, settings.tracked_a_side
    every = settings.render_cells // (tracked - 1)
    row, column = np.divmod(np.arange(tracked * tracked), tracked)
    partners = [
        mapped_vertices(tracked, symmetry.matrix, symmetry.offset)
        for symmetry in SYMMETRIES[settings.variant]
    ]
    count = tracked * tracked
    return Points(
        object_id=np.ones(count, dtype=np.int32),
        vertex=(row * every * side + column * every).astype(np.int32),
        centreline=np.zeros(count, dtype=bool),
        material=np.stack([column, row], axis=1).astype(np.float32) / np.float32(tracked - 1),
        partners=np.stack(partners, axis=1).astype(np.int32)
        if partners
        else np.zeros((count, 0), dtype=np.int32),
    )
