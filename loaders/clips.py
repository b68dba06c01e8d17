"""Frames in a row with the tracks of material points: clips of episodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from pliant.loaders.augment import (
    AugmentSettings,
    check_augmentation,
    rotation_about_centre,
    warp_view,
)
from pliant.loaders.frame_store import FrameStore, check_store
from pliant.loaders.inputs import NetworkInput
from pliant.loaders.order import DrawnSamples, sample_generator
from pliant.loaders.recolouring import recolour
from pliant.loaders.views import TrainingFrame, draw_points
from pliant.spec.calls import check_type, check_whole
from pliant.spec.errors import CallError

_COLOUR = NetworkInput()
_OF_PAIRS = ("recolour", "mask_faults", "mask_damage", "mask_drop", "picture_drop", "symmetric")
"""Settings of augmentation that clips do not have."""


class ClipDataset(DrawnSamples):
    """Clips of episodes, drawn by number from the seed like the samples of `PairDataset`.

    A sample holds `image` float32 (T, C, h, w), `mask` bool (T, h, w), `uv_px` float32
    (T, Q, 2) and `visible` bool (T, Q): the tracks of Q surface points that are visible in the
    first frame before augmentation, in working pixels (0 where unknown); `frames` int64 (T,).

    Args:
        store: The frames.
        length: Frames in a clip T, >= 2.
        step: Episode frames from one clip frame to the next, >= 1.
        step_max: With it, each clip draws its step from `step` to this; episodes too short for
            a step give none of that step.
        queries: Tracks in a clip Q.
        input: The channels of its images.
        seed: Seed of the draws.
        augmentation: Random changes, the same for all frames of a clip, or None. Clips are
            rotated and scaled about the centre, and have colour and noise.

    Raises:
        CallError: No episode is long enough, or another change is asked for.

    Examples:
        >>> episodes = {"tiers": ["rope"], "splits": {"train": 1}, "style": "raster", "width": 160}
        >>> episodes |= {"height": 120, "episodes": True, "frames": 4}
        >>> clips = pliant.loaders.ClipDataset(pliant.stream(episodes).samples.store, length=3)
        >>> clips[0]["image"].shape[0]
        3
    """

    def __init__(
        self,
        store: FrameStore,
        *,
        length: int = 4,
        step: int = 1,
        step_max: int | None = None,
        queries: int = 48,
        input: NetworkInput = _COLOUR,
        seed: int = 0,
        augmentation: AugmentSettings | None = None,
    ) -> None:
        check_store(store)
        check_whole("length", length, 2)
        check_whole("step", step, 1)
        check_whole("step_max", step if step_max is None else step_max, step)
        check_whole("queries", queries, 1)
        check_type("input", input, NetworkInput)
        check_whole("seed", seed)
        check_augmentation(augmentation)
        others = [name for name in _OF_PAIRS if augmentation and getattr(augmentation, name)]
        if others:
            raise CallError(
                "clips do not have this augmentation",
                where="augmentation",
                found=", ".join(others),
                required="rotate_deg, scale, colour and noise",
            )
        self.store = store
        self.length, self.queries = length, queries
        self.input = input
        self.seed, self.augmentation = seed, augmentation
        steps = range(step, (step_max or step) + 1)
        starts = {each: self._starts((length - 1) * each) for each in steps}
        self.starts = {each: numbers for each, numbers in starts.items() if numbers}
        if not self.starts:
            raise CallError(
                f"{store.where} has no episode of {(length - 1) * step + 1} frames",
                path=store.root,
                fix="Generate with --episodes and more --frames, or ask for shorter clips.",
            )

    def _starts(self, span: int) -> list[int]:
        """Return the frames with `span` frames of their episode after them."""
        return [
            number
            for number, ref in enumerate(self.store.frames)
            if ref.sequence.temporal and ref.index + span < ref.sequence.frames
        ]

    def __len__(self) -> int:
        return max(map(len, self.starts.values()))

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        """Draw clip number `index` (any number >= 0)."""
        rng = sample_generator(self.seed, index)
        steps = list(self.starts)
        step = steps[int(rng.integers(len(steps)))] if len(steps) > 1 else steps[0]
        start = self.starts[step][int(rng.integers(len(self.starts[step])))]
        frames = start + step * np.arange(self.length)
        views = [self.store.view(int(frame)) for frame in frames]
        drawn = draw_points(rng, views[0].visible, self.queries)
        views = [replace(v, uv_px=v.uv_px[drawn], visible=v.visible[drawn]) for v in views]
        if self.augmentation is not None:
            views = self._augmented(rng, views, self.augmentation)
        uv = np.stack([view.uv_px for view in views])
        known = np.isfinite(uv).all(axis=-1)
        images = [self.input.image(v.rgb, v.depth_m, v.mask, v.objects) for v in views]
        return {
            "image": torch.from_numpy(np.stack(images)),
            "mask": torch.from_numpy(np.stack([view.mask for view in views])),
            "uv_px": torch.from_numpy(np.where(known[..., None], uv, np.float32(0))),
            "visible": torch.from_numpy(np.stack([view.visible for view in views]) & known),
            "frames": torch.from_numpy(frames),
        }

    def _augmented(
        self, rng: np.random.Generator, views: list[TrainingFrame], settings: AugmentSettings
    ) -> list[TrainingFrame]:
        """Return the frames moved and tinted alike, each with its own noise."""
        angle = float(np.radians(rng.uniform(-settings.rotate_deg, settings.rotate_deg)))
        factor = float(np.exp(rng.uniform(-1, 1) * np.log1p(settings.scale)))
        affine = rotation_about_centre(self.store.size, angle, factor)
        tint = int(rng.integers(2**62))
        changed = []
        for view in views:
            moved = warp_view(view, affine)
            same_tint = np.random.default_rng(tint)
            rgb = recolour(same_tint, moved.rgb, settings.colour, 0.0)
            changed.append(replace(moved, rgb=recolour(rng, rgb, 0.0, settings.noise)))
        return changed
