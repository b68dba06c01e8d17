"""From settings and a seed to a scene object: the cloth tiers as the renderer takes them."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.generator.objects.cloth.configuration import Configurations
from pliant.generator.objects.cloth.episode import Episode
from pliant.generator.objects.cloth.grid import grid_faces, mapped_vertices
from pliant.generator.objects.cloth.surface import PART
from pliant.generator.objects.cloth.symmetry import SYMMETRIES
from pliant.generator.scene.scene_object import Part, Points, SceneObject
from pliant.generator.settings.cloth import ClothSettings

FloatArray = npt.NDArray[np.float64]


def cloth_tier(settings: ClothSettings, name: str) -> dict[str, Any]:
    """Return the tier as it stands in `dataset.json`.

    Args:
        settings: The tier's settings.
        name: Its name, such as `cloth-1`.

    Returns:
        A JSON object: kind, variant, objects with their material coordinates, symmetries.
    """
    coordinate = {
        "min": 0.0,
        "max": 1.0,
        "metres_per_unit": float(settings.side_m),
        "period": None,
    }
    return {
        "name": name,
        "kind": "cloth",
        "variant": settings.variant,
        "queried_object": 1,
        "objects": [
            {
                "id": 1,
                "name": PART,
                "material": [{"name": "u", **coordinate}, {"name": "v", **coordinate}],
            }
        ],
        "symmetries": [symmetry.as_dict() for symmetry in SYMMETRIES[settings.variant]],
    }


def sample_cloth(
    settings: ClothSettings,
    *,
    tier: str,
    seed: int,
    split: str,
    index: int,
    frames: int,
    temporal: bool,
) -> SceneObject:
    """Sample one sequence of a cloth tier; nothing is simulated before a pose is asked for.

    Args:
        settings: The tier's settings.
        tier: Its name.
        seed: The dataset's seed.
        split: Split of the sequence.
        index: Index of the sequence in tier and split.
        frames: Number of frames.
        temporal: True for an episode (frames in time, pick, lift, carry, release); False for
            independent configurations of the same cloth.

    Returns:
        The scene object. Asked for twice, a frame is the same.

    Raises:
        CallError: The tier names no level.
    """
    level = settings.level_of(tier)
    poses: Episode | Configurations
    if temporal:
        poses = Episode(settings, level, tier, seed, split, index)
    else:
        poses = Configurations(settings, level, tier, seed, split, index)
    return SceneObject(
        tier=tier,
        kind="cloth",
        shape=None,
        temporal=temporal,
        frames=frames,
        parts=(_part(settings),),
        points=_points(settings),
        pose=poses,
        size_m=settings.side_m,
        thickness_m=settings.thickness_m,
        info={
            "level": level,
            "coverage_band": list(settings.band_of(level)),
            "cloth": asdict(settings),
            "steps_per_second": settings.sheet().steps_per_second,
        },
        variant=settings.variant,
    )


def _part(settings: ClothSettings) -> Part:
    side = settings.render_a_side
    row, column = np.divmod(np.arange(side * side), side)
    rest = np.zeros((side * side, 3))
    rest[:, 0] = column / settings.render_cells
    rest[:, 1] = row / settings.render_cells
    return Part(
        object_id=1,
        name=PART,
        faces=grid_faces(side, side),
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
