"""What `dataset.json` says about a rope tier."""

from __future__ import annotations

import math
from typing import Any

from pliant.generator.settings.rope import RopeSettings

ROPE_ID = 1
BALL_ID = 2


def rope_tier(settings: RopeSettings, name: str = "rope") -> dict[str, Any]:
    """Return the tier object of a rope: objects, material coordinates, symmetries.

    Args:
        settings: The tier's settings.
        name: Tier name.

    Returns:
        A JSON object of `dataset.json`'s `tiers`.
    """
    objects = [
        {
            "id": ROPE_ID,
            "name": "rope",
            "material": [
                _coordinate("s", 0.0, 1.0, settings.length_m, None),
                _coordinate("theta", -math.pi, math.pi, settings.radius_m, 2.0 * math.pi),
            ],
        }
    ]
    symmetries = []
    if settings.ball:
        radius = settings.ball_radius_m
        objects.append(
            {
                "id": BALL_ID,
                "name": "ball",
                "material": [
                    _coordinate("polar", 0.0, math.pi, radius, None),
                    _coordinate("azimuth", -math.pi, math.pi, radius, 2.0 * math.pi),
                ],
            }
        )
    else:
        symmetries.append(
            {"name": "reversal", "matrix": [[-1.0, 0.0], [0.0, -1.0]], "offset": [1.0, 0.0]}
        )
    return {
        "name": name,
        "kind": "rope",
        "variant": "plain",
        "queried_object": ROPE_ID,
        "objects": objects,
        "symmetries": symmetries,
    }


def _coordinate(
    name: str, low: float, high: float, metres_per_unit: float, period: float | None
) -> dict[str, Any]:
    return {
        "name": name,
        "min": low,
        "max": high,
        "metres_per_unit": metres_per_unit,
        "period": period,
    }
