"""Learns over and under at crossings from the frames of a training split.

The truth says where the rope crosses itself and which passage the camera sees. Crossings are
jittered as traces err, colours are mixed, blurred and made noisy, and patches mirrored; two
minutes on one core are enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d
from torch.nn import functional

from pliant.baselines.tracing import self_crossings
from pliant.loaders.frame_store import FrameStore
from pliant.loaders.views import TrainingFrame
from pliant.models.don.crossings import LEAST_APART
from pliant.models.don.patch_training import fit_patches, recoloured
from pliant.models.networks.crossing_network import (
    CrossingNetwork,
    CrossingPatches,
    crossing_patches,
)
from pliant.spec.arrays import FloatArray, RealArray

_BINS: Final = 100
_MOST_FRAMES: Final = 4000
_LEAST_CROSSINGS: Final = 20
_LEAST_POINTS: Final = 2
_LEAST_DIFFERENCE: Final = 0.3  # in the shares of both passages' points that are seen
_NEAR: Final = 1.2
_PLACE_JITTER, _WAY_JITTER_RAD, _WIDTH_JITTER = 0.25, 0.1, 0.1
_EPOCHS: Final = 15


def fit_crossings(stores: Sequence[FrameStore], *, seed: int) -> CrossingNetwork | None:
    """Train a network for crossings.

    Args:
        stores: Frames of ropes at the dataset's own size.
        seed: Seed of all draws.

    Returns:
        The network; None where the frames show fewer than 20 crossings.
    """
    rng = np.random.default_rng(seed)
    share = _MOST_FRAMES // len(stores)
    found = [each for store in stores for each in _labelled(store, share, rng)]
    if sum(len(patches) for patches, _ in found) < _LEAST_CROSSINGS:
        return None
    patches = CrossingPatches.joined([patches for patches, _ in found])
    first_is_upper = torch.cat([label for _, label in found])
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = CrossingNetwork()

        def loss(rows: torch.Tensor) -> torch.Tensor:
            odds = network(_augmented(patches.rows(rows)))
            return functional.binary_cross_entropy_with_logits(odds, first_is_upper[rows])

        fit_patches(network, loss, len(first_is_upper), epochs=_EPOCHS)
        return network


def _labelled(
    store: FrameStore, most: int, rng: np.random.Generator
) -> Iterator[tuple[CrossingPatches, torch.Tensor]]:
    along = store.material[:, 0]
    for number in range(min(most, len(store))):
        frame = store.view(number)
        picture = frame.rgb.astype(np.float32) / 255
        line = _middle_line(frame, along)
        if line is None:
            continue
        length_px = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        half_px = 0.5 * float(frame.mask.sum()) / length_px
        place, ways, label = [], [], []
        for each in self_crossings(line, round(LEAST_APART * _BINS)):
            near = np.linalg.norm(frame.uv_px - each.place_px, axis=1) < _NEAR * half_px
            passages = [(k + 1) / _BINS for k in (each.first, each.second)]
            on = [near & (np.abs(along - at) < LEAST_APART) for at in passages]
            if min(points.sum() for points in on) < _LEAST_POINTS:
                continue
            seen = [float(frame.visible[points].mean()) for points in on]
            if abs(seen[0] - seen[1]) < _LEAST_DIFFERENCE:
                continue
            place.append(each.place_px + rng.normal(0, _PLACE_JITTER * half_px, 2))
            ways.append(_turned(each.ways, rng.normal(0, _WAY_JITTER_RAD, 2)))
            label.append(float(seen[0] > seen[1]))
        if label:
            widths = half_px * np.exp(rng.normal(0, _WIDTH_JITTER, len(label)))
            patches = crossing_patches(picture, np.stack(place), np.stack(ways), widths)
            yield patches, torch.tensor(label)


def _middle_line(frame: TrainingFrame, along: RealArray) -> FloatArray | None:
    """Return the rope's middle at 100 shares of its length, px; None if a stretch has no point."""
    bins = np.clip((along * _BINS).astype(np.int64), 0, _BINS - 1)
    count = np.bincount(bins, minlength=_BINS)
    if not count.all() or not np.isfinite(frame.uv_px).all():
        return None
    sums = [np.bincount(bins, frame.uv_px[:, axis], _BINS) for axis in (0, 1)]
    line = np.stack(sums, axis=1) / count[:, None]
    return np.asarray(gaussian_filter1d(line, 1.0, axis=0, mode="nearest"))


def _turned(ways: FloatArray, angle_rad: FloatArray) -> FloatArray:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y = ways.T
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)


def _augmented(patches: CrossingPatches) -> CrossingPatches:
    picture, angle = recoloured(patches.picture), patches.angle
    count = len(picture)
    each = (count, 1, 1, 1, 1)
    picture = torch.where(torch.rand(each) < 0.3, _blurred(picture), picture)
    # Each strand's patch on its own: mirrored across the strand, and walked the other way.
    own = (count, 2, 1, 1, 1)
    mirrored = torch.rand(own) < 0.5
    picture = torch.where(mirrored, picture.flip(3), picture)
    angle = torch.where(mirrored.flatten(1), -angle, angle)
    picture = torch.where(torch.rand(own) < 0.5, picture.flip(3, 4), picture)
    return CrossingPatches(picture, angle)


def _blurred(picture: torch.Tensor) -> torch.Tensor:
    kernel = torch.tensor([1.0, 2.0, 1.0]) / 4
    flat = functional.pad(picture.flatten(0, 2)[:, None], (1, 1, 1, 1), mode="replicate")
    return functional.conv2d(flat, torch.outer(kernel, kernel)[None, None]).view_as(picture)
