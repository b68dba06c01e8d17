"""What `dataset.json` says about a rope tier."""

from __future__ import annotations

import math
from typing import Final

from pliant.generator.settings.rope import RopeSettings
from pliant.spec.model import MaterialCoordinate, MaterialObject, Symmetry, Tier

ROPE_ID: Final = 1
BALL_ID: Final = 2

REVERSAL: Final = Symmetry("reversal", ((-1.0, 0.0), (0.0, -1.0)), (1.0, 0.0))
"""(s, theta) -> (1 - s, -theta): the rope looked at from its other end."""


def rope_tier(settings: RopeSettings, name: str = "rope") -> Tier:
    """Return the tier of a rope: objects, material coordinates, symmetries.

    Args:
        settings: The tier's settings.
        name: Tier name.
    """
    along = MaterialCoordinate("s", 0.0, 1.0, settings.length_m)
    rope = MaterialObject(ROPE_ID, "rope", (along, _angle("theta", settings.radius_m)))
    if not settings.ball:
        return Tier(name, "rope", "plain", ROPE_ID, (rope,), (REVERSAL,))
    radius_m = settings.ball_radius_m
    polar = MaterialCoordinate("polar", 0.0, math.pi, radius_m)
    ball = MaterialObject(BALL_ID, "ball", (polar, _angle("azimuth", radius_m)))
    return Tier(name, "rope", "plain", ROPE_ID, (rope, ball))


def _angle(name: str, radius_m: float) -> MaterialCoordinate:
    return MaterialCoordinate(name, -math.pi, math.pi, radius_m, 2.0 * math.pi)
