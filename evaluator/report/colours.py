"""Pictures of a frame's surface: index colours, one for each material point, and depth."""

from __future__ import annotations

import functools
import json
from importlib import resources
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import Rgb
from pliant.spec.io.exr import Surface
from pliant.spec.model import Tier

_CORNERS = np.array(
    [[[0.15, 0.20, 0.75], [0.10, 0.75, 0.85]], [[0.85, 0.15, 0.35], [0.98, 0.85, 0.20]]]
)
# Colours of a cloth's corners: [u][v], mixed in between.


def material_colours(
    m0: npt.NDArray[Any], m1: npt.NDArray[Any], tier: Tier
) -> npt.NDArray[np.float64]:
    """Return index colours: one colour for one material point, in every frame.

    Args:
        m0: (N,), first material coordinate of the queried object.
        m1: (N,), second material coordinate.
        tier: The tier.

    Returns:
        float64 (N, 3), sRGB 0 to 1. A rope is coloured along its length, a little darker on one
        side of theta; a cloth by its four corners.
    """
    first, second = tier.queried.material
    a = np.clip((m0 - first.min) / (first.max - first.min), 0.0, 1.0)
    if tier.kind == "rope":
        colours = _mapped("turbo", 0.04 + 0.92 * a)
        return colours * (0.84 + 0.16 * np.cos(np.asarray(m1, np.float64)))[:, None]
    b = np.clip((m1 - second.min) / (second.max - second.min), 0.0, 1.0)
    a, b = a[:, None], b[:, None]
    low = (1 - b) * _CORNERS[0, 0] + b * _CORNERS[0, 1]
    high = (1 - b) * _CORNERS[1, 0] + b * _CORNERS[1, 1]
    mixed: npt.NDArray[np.float64] = (1 - a) * low + a * high
    return mixed


def index_image(surface: Surface, tier: Tier) -> Rgb:
    """Return the index colours of a frame; other objects grey, the rest near black."""
    out = np.full((*surface.object_id.shape, 3), 18, np.uint8)
    out[surface.object_id > 0] = 120
    on = surface.object_id == tier.queried_object
    out[on] = np.rint(255 * material_colours(surface.m0[on], surface.m1[on], tier)).astype(np.uint8)
    return out


def depth_image(depth_m: npt.NDArray[np.float32]) -> Rgb:
    """Return the depth of a frame, uint8 (H, W, 3): near is bright; its own range is spread out.

    Args:
        depth_m: float32 (H, W), metres, +inf is background.
    """
    out = np.full((*depth_m.shape, 3), 18, np.uint8)
    on = np.isfinite(depth_m)
    if not on.any():
        return out
    depth = depth_m[on].astype(np.float64)
    low, high = depth.min(), depth.max()
    near = (high - depth) / max(high - low, 1e-9)
    out[on] = np.rint(255 * _mapped("magma", 0.15 + 0.8 * near)).astype(np.uint8)
    return out


def _mapped(name: str, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the colours of values from 0 to 1, float64 (N, 3), by a map of `colour_maps.json`.

    The maps are those of matplotlib: magma by N. Smith and S. van der Walt (CC0), turbo by
    A. Mikhailov (Apache-2.0).
    """
    table = _colour_maps()[name]
    return table[np.clip((values * len(table)).astype(np.int64), 0, len(table) - 1)]


@functools.cache
def _colour_maps() -> dict[str, npt.NDArray[np.float64]]:
    path = resources.files("pliant.evaluator.report") / "colour_maps.json"
    return {name: np.array(colours) for name, colours in json.loads(path.read_bytes()).items()}
