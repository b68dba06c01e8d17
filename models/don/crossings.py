"""Over and under: which strand is on top where a rope crosses itself, for the traces of a view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import torch

from pliant.baselines.tracing import Trace, overlap, self_crossings
from pliant.models.networks.crossing_network import CrossingNetwork, crossing_patches
from pliant.spec.arrays import BoolArray
from pliant.spec.frame import Frame

CROSSINGS: Final = "crossings.safetensors"
"""The weights of a run's `CrossingNetwork`."""

LEAST_APART: Final = 0.04
"""Passages nearer along the rope, as a share of its length, do not count as a crossing."""

_MOST_CROSSINGS: Final = 12  # a trace with more runs along itself


def with_overlaps(
    network: CrossingNetwork, view: Frame, mask: BoolArray, traces: Sequence[Trace]
) -> list[Trace]:
    """Return traces that know which of their parts cover others.

    Args:
        network: Trained.
        view: The image.
        mask: bool (h, w), the rope, at any size.
        traces: Its readings, in pixels of the image.
    """
    picture = view.rgb.astype(np.float32) / 255
    factor = picture.shape[1] / mask.shape[1]
    area_px2 = float(mask.sum()) * factor**2
    found = []
    for trace in traces:
        stations = len(trace.uv_px)
        half_px = 0.5 * area_px2 / trace.length_px
        met = self_crossings(trace.uv_px, round(LEAST_APART * stations))
        if len(met) > _MOST_CROSSINGS:
            met = []
        found.append((half_px, met))
    every = [(half_px, crossing) for half_px, met in found for crossing in met]
    if not every:
        return list(traces)
    patches = crossing_patches(
        picture,
        np.stack([crossing.place_px for _, crossing in every]),
        np.stack([crossing.ways for _, crossing in every]),
        np.array([half_px for half_px, _ in every]),
    )
    with torch.inference_mode():
        odds = iter(network(patches).tolist())
    known = []
    for trace, (half_px, met) in zip(traces, found, strict=True):
        spacing_px = trace.length_px / (len(trace.uv_px) - 1)
        overlaps = tuple(
            overlap(
                each,
                first_is_upper=next(odds) > 0,
                half_px=half_px,
                spacing_px=spacing_px,
                stations=len(trace.uv_px),
            )
            for each in met
        )
        known.append(replace(trace, overlaps=overlaps))
    return known
