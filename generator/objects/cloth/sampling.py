"""From settings and a seed to a scene object: the cloth tiers as the renderer takes them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.cloth.configuration import make_configuration
from pliant.generator.objects.cloth.episode import Episode
from pliant.generator.objects.cloth.grid import grid_faces, mapped_vertices
from pliant.generator.objects.cloth.surface import PART
from pliant.generator.scene.scene_object import Part, Points, Pose, SceneObject
from pliant.generator.seeding import RandomStreams, Stream
from pliant.generator.settings.cloth import ClothSettings
from pliant.spec.arrays import FloatArray
from pliant.spec.configuration import settings_to_dict
from pliant.spec.model import (
    RECTANGLE_SYMMETRIES,
    SQUARE_MIRRORS,
    SQUARE_ROTATIONS,
    MaterialCoordinate,
    MaterialObject,
    Symmetry,
    Tier,
)

CLOTH_ID: Final = 1


def symmetries_of(settings: ClothSettings) -> tuple[Symmetry, ...]:
    """Return the maps of (u, v) under which a cloth looks the same, without the identity."""
    if settings.variant != "plain":
        # Prints have no symmetry. A towel's wide stripe is near one end, the narrow one along one
        # side, on both faces, in exchanged colours. From the back they are a mirror image, so the
        # picture says which face is up.
        return ()
    # Both faces alike: turning the cloth over about an axis in its plane mirrors (u, v).
    square = settings.grid.proportion == 1
    return SQUARE_ROTATIONS + SQUARE_MIRRORS if square else RECTANGLE_SYMMETRIES


def describe(config: GenerateConfig, tier: str) -> Tier:
    """Return a cloth tier of a dataset: object, material coordinates, symmetries."""
    settings = _settings_of(config, tier)
    lengths_m = {"u": settings.side_m, "v": settings.length_v_m}
    u, v = (MaterialCoordinate(name, 0.0, 1.0, float(m)) for name, m in lengths_m.items())
    cloth = MaterialObject(CLOTH_ID, PART, (u, v))
    symmetries = symmetries_of(settings)
    return Tier(tier, "cloth", settings.variant, CLOTH_ID, (cloth,), symmetries)


def _settings_of(config: GenerateConfig, tier: str) -> ClothSettings:
    """Return the settings of a tier: a towel has level 2 unless one is given, and any angle."""
    if tier != "towel":
        return config.cloth
    level = config.cloth.level or 2
    return config.cloth.replace(variant="towel", level=level, yaw_max_rad=math.pi)


def sample(config: GenerateConfig, streams: RandomStreams) -> SceneObject:
    """Sample one sequence of a cloth tier; nothing is simulated before a pose is asked for.

    Args:
        config: The dataset's config: episodes (pick, lift, carry, release), or independent
            configurations of the same cloth.
        streams: The sequence and its random numbers.

    Returns:
        The scene object. Asked for twice, a frame is the same.
    """
    tier = streams.task.tier
    settings = _settings_of(config, tier)
    level = settings.level or int(tier[-1])
    parts, points = cloth_parts(settings)

    def still(frame: int) -> Pose:
        rng = streams.generator(Stream.CLOTH_CONFIGURATION, frame)
        underside = streams.task.index % 2 == 1 if settings.sides == "alternate" else None
        made = make_configuration(settings, level, rng, underside)
        return Pose(vertices={PART: made.vertices}, info=made.info)

    return SceneObject(
        tier=tier,
        kind="cloth",
        shape=None,
        temporal=config.episodes,
        frames=config.frames,
        parts=parts,
        points=points,
        pose=Episode(settings, level, streams).pose if config.episodes else still,
        size_m=settings.side_m,
        thickness_m=settings.thickness_m,
        info={
            "level": level,
            "coverage_band": list(settings.band_of(level)),
            "cloth": settings_to_dict(settings),
            "steps_per_second": settings.sheet().steps_per_second,
        },
        variant=settings.pattern,
        proportion=settings.grid.proportion,
    )


def cloth_parts(settings: ClothSettings) -> tuple[tuple[Part, ...], Points]:
    """Return the mesh of a cloth and its named material points."""
    grid, tracked, every = settings.render_grid, settings.tracked_grid, settings.tracked_every
    row, column = np.divmod(np.arange(grid.vertices), grid.columns)
    rest = np.zeros((grid.vertices, 3))
    rest[:, 0] = column / (grid.columns - 1)
    rest[:, 1] = row / (grid.rows - 1)
    part = Part(
        object_id=CLOTH_ID,
        name=PART,
        faces=grid_faces(grid),
        rest=rest,
        chart=_chart,
        strand=np.zeros(grid.vertices, dtype=np.int32),
        double_sided=True,
    )
    count = tracked.vertices
    row, column = np.divmod(np.arange(count), tracked.columns)
    symmetries = symmetries_of(settings)
    partners = [mapped_vertices(tracked, each.matrix, each.offset) for each in symmetries]
    last = np.array([tracked.columns - 1, tracked.rows - 1], np.float32)
    points = Points(
        object_id=np.ones(count, dtype=np.int32),
        vertex=(row * every * grid.columns + column * every).astype(np.int32),
        centreline=np.zeros(count, dtype=bool),
        material=np.stack([column, row], axis=1).astype(np.float32) / last,
        partners=np.array(partners, np.int32).reshape(-1, count).T,
    )
    return (part,), points


def _chart(rest: FloatArray) -> FloatArray:
    """A cloth's rest coordinates are (u, v, 0)."""
    return np.asarray(rest[:, :2], dtype=np.float64)
