"""Independent configurations: simulate, look, and accept or begin again."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pliant.generator.objects.cloth.grid import grid_faces
from pliant.generator.objects.cloth.handling import CALM_SPEED_M_S, Handling
from pliant.generator.objects.cloth.levels import shape_cloth
from pliant.generator.objects.cloth.measure import shows_underside
from pliant.generator.objects.cloth.surface import Placement, cover_of, render_vertices
from pliant.generator.settings.cloth import ClothSettings
from pliant.spec.arrays import FloatArray
from pliant.spec.configuration import settings_to_dict
from pliant.spec.errors import GenerationError

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Configuration:
    """An accepted configuration.

    Attributes:
        handling: The cloth, calm, with the record of what was done to it.
        placement: Where it is in the world.
        vertices: float64 (V, 3), the rendered surface in the world, metres.
        info: JSON-able facts: coverage, hidden material, actions, tries.
    """

    handling: Handling
    placement: Placement
    vertices: FloatArray
    info: Mapping[str, Any]


def make_configuration(
    settings: ClothSettings, level: int, rng: np.random.Generator, underside: bool | None = None
) -> Configuration:
    """Simulate one configuration whose coverage is in the level's band.

    Args:
        settings: The tier's settings.
        level: 1, 2 or 3.
        rng: Source of every choice.
        underside: Whether it shows more of its underside; None takes either.

    Returns:
        A calm cloth that pokes through itself nowhere, its box centred over the origin.

    Raises:
        GenerationError: No try of `max_tries` gave one.
    """
    band = settings.band_of(level)
    refused: dict[str, int] = {}
    for attempt in range(settings.max_tries):
        made = _try_configuration(settings, level, band, rng, underside)
        if isinstance(made, Configuration):
            return replace(made, info={**made.info, "tries": attempt + 1, "refused": refused})
        refused[made] = refused.get(made, 0) + 1
        _log.debug("cloth level %d, try %d refused: %s", level, attempt + 1, made)
    raise GenerationError(
        f"no cloth of level {level} could be made in {settings.max_tries} tries",
        where="cloth.coverage_band",
        found=", ".join(f"{count} x {reason}" for reason, count in sorted(refused.items())),
        required=f"silhouette coverage from {band[0]:g} to {band[1]:g}",
        fix="Widen coverage_band, raise max_tries, or set sides to any",
    )


def _try_configuration(
    settings: ClothSettings,
    level: int,
    band: tuple[float, float],
    rng: np.random.Generator,
    underside: bool | None,
) -> Configuration | str:
    """Return a configuration, or why it was refused."""
    handling = Handling(settings, rng)
    if not shape_cloth(handling, level, band):
        return "coverage outside the band"
    speed_m_s = handling.calm()
    if not speed_m_s < CALM_SPEED_M_S:
        return "never calm"
    positions = handling.simulator.positions
    yaw_rad = float(rng.uniform(-settings.yaw_max_rad, settings.yaw_max_rad))
    placement = Placement.centred(positions, yaw_rad)
    vertices, pierced = render_vertices(settings, placement.apply(positions))
    if pierced:
        return "intersects itself"
    faces = grid_faces(settings.render_grid)
    if underside is not None and shows_underside(vertices, faces) != underside:
        return "the other side is up"
    cover = cover_of(settings, vertices)
    if not band[0] <= cover.coverage <= band[1]:
        return "coverage outside the band"
    info = {
        **settings_to_dict(cover),
        "actions": handling.record,
        "yaw_rad": yaw_rad,
        "mean_speed_m_s": speed_m_s,
        "steps": handling.simulator.steps,
    }
    return Configuration(handling, placement, vertices, info)
