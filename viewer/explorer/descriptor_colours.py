"""Colours of descriptors: what a network sees, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt


def descriptor_colours(
    maps: Sequence[npt.NDArray[np.floating[Any]]], masks: Sequence[npt.NDArray[np.bool_]]
) -> list[npt.NDArray[np.float64]]:
    """Return descriptors on the object as RGB, by their first three principal components.

    Args:
        maps: float32 (h, w, D), descriptors of several frames.
        masks: bool (h, w), the object in each.

    Returns:
        float64 (h, w, 3), 0 to 1, white off the object; the same colours in all frames.
    """
    on = np.concatenate([m[mask] for m, mask in zip(maps, masks, strict=True)]).astype(np.float64)
    if len(on) == 0:
        return [np.ones((*mask.shape, 3)) for mask in masks]
    mean = on.mean(axis=0)
    _, _, directions = np.linalg.svd(on - mean, full_matrices=False)
    directions = directions[:3]
    if len(directions) < 3:  # fewer than three dimensions: the other channels are constant
        directions = np.vstack([directions, np.zeros((3 - len(directions), on.shape[1]))])
    low, high = np.percentile((on - mean) @ directions.T, [2, 98], axis=0)
    spread = np.where(high > low, high - low, 1.0)
    pictures = []
    for m, mask in zip(maps, masks, strict=True):
        colour = np.ones((*mask.shape, 3))
        projected = (m[mask].astype(np.float64) - mean) @ directions.T
        colour[mask] = np.clip((projected - low) / spread, 0.0, 1.0)
        pictures.append(colour)
    return pictures
