"""Settings of `pliant generate` drawn at random: every tier, size and option, all small."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, Literal, TypeVar, get_args, get_origin

import numpy as np

from pliant.generator.config import TIER_KINDS, GenerateConfig
from pliant.generator.settings import ClothSettings, DepthCameraSettings, NoiseSettings
from pliant.spec.configuration import Settings, SettingsError, settings_from

CHANGED: Final = 0.3
"""Share of the settings that are not left at their defaults."""

CLOTH_KEPT: Final = ("points_a_side", "tracked_a_side", "coverage_band", "max_tries")

LOOK_KEPT: Final = ("least_contrast", "object_value", "table_value")
"""With others of these no colour may stand out from the table, which `generate` refuses."""

S = TypeVar("S", bound=Settings)


def draw_config(rng: np.random.Generator) -> GenerateConfig:
    """Return settings of a dataset of a few tiny images that need no Blender."""
    episodes = bool(rng.random() < 0.3)
    frames = int(rng.integers(2, 4)) if episodes else int(rng.integers(1, 3))
    style = str(rng.choice(["raster", "real-depth"]))
    tiers = [tier for tier in TIER_KINDS if rng.random() < 0.25]
    queries = {
        "pairs_per_sequence": int(rng.integers(1, 5)),
        "queries_per_pair": int(rng.integers(1, 40)),
        "splits": ["test"] if rng.random() < 0.5 else ["val", "test"],
        "kind": "track" if episodes and rng.random() < 0.3 else "pairs",
    }
    if episodes and queries["kind"] == "pairs" and rng.random() < 0.3:
        queries["skips"] = [1]
    base = {
        "tiers": tiers or [str(rng.choice(list(TIER_KINDS)))],
        "splits": {"train": int(rng.integers(2)), "val": int(rng.integers(2)), "test": 1},
        "frames": frames,
        "episodes": episodes,
        "width": int(rng.integers(16, 120)),
        "height": int(rng.integers(16, 90)),
        "seed": int(rng.integers(2**63)),
        "style": style,
        "gripper": bool(episodes and rng.random() < 0.5),
        "queries": queries,
    }
    config = settings_from(GenerateConfig, base)
    rope = changed(config.rope, rng)
    if rope.loop_radius_m[0] < config.rope.loop_radius_m[0]:  # an end may not fit through these
        rope = rope.replace(loop_radius_m=config.rope.loop_radius_m)
    sections: dict[str, Settings] = {
        "rope": rope,
        "look": changed(config.look, rng, *LOOK_KEPT),
        "camera": changed(config.camera, rng),
    }
    cloth = changed(_small_cloth(rng), rng, *CLOTH_KEPT)
    sections["cloth"] = cloth.replace(sides="any") if episodes else cloth
    if rng.random() < 0.4:
        sections["noise"] = changed(NoiseSettings(), rng)
    if style == "real-depth" and rng.random() < 0.5:
        sections["depth_camera"] = changed(DepthCameraSettings(), rng)
    return config.replace(**sections)


def _small_cloth(rng: np.random.Generator) -> ClothSettings:
    cells = int(rng.choice([8, 12, 16]))
    doublings = int(rng.integers(2))
    return ClothSettings(
        points_a_side=cells + 1,
        doublings=doublings,
        tracked_a_side=int(rng.choice([cells // 4, cells])) + 1,
        coverage_band=(0.0, 1.2),  # masses this far apart do not fold as tightly as a level wants
        sides="alternate" if rng.random() < 0.3 else "any",
    )


def changed(settings: S, rng: np.random.Generator, *kept: str) -> S:
    """Return settings of which some are others; a change that the class refuses is not made.

    Args:
        settings: Where to start.
        rng: Source of randomness.
        kept: Names of settings that stay.
    """
    for name, field in type(settings).model_fields.items():
        if name in kept or rng.random() > CHANGED:
            continue
        try:
            settings = settings.replace(
                **{name: _other(getattr(settings, name), field.annotation, rng)}
            )
        except SettingsError:
            continue
    return settings


def _other(value: Any, annotation: Any, rng: np.random.Generator) -> Any:
    """Return another value like a given one: up to twice or half a number, a name less."""
    if get_origin(annotation) is Literal:
        return str(rng.choice(get_args(annotation)))
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return round(value * 2 ** rng.uniform(-1, 1))
    if isinstance(value, float):
        return value * 2 ** rng.uniform(-1, 1)
    if isinstance(value, tuple):
        found = tuple(sorted(_other(each, None, rng) for each in value))
        return found if rng.random() < 0.6 else (found[0], found[0])
    if isinstance(value, Mapping):
        absent = rng.choice([*value, ""])
        others = {name: _other(each, None, rng) for name, each in value.items()}
        return {name: each for name, each in others.items() if name != absent}
    return value
