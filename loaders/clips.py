"""`ClipDataset`: T frames of an episode in a row, with the tracks of material points."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import Dataset as TorchDataset

from pliant.loaders.augment import AugmentSettings, rotation_about_centre, warp_view
from pliant.loaders.frame_store import FrameStore
from pliant.loaders.inputs import InputKind, NetworkInput
from pliant.loaders.order import sample_generator
from pliant.loaders.recolouring import recolour
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError


class ClipDataset(TorchDataset[dict[str, torch.Tensor]]):
    """Clips of episodes, drawn by number from the seed like the samples of `PairDataset`.

    A sample holds `image` float32 (T, C, h, w), `mask` bool (T, h, w), `uv_px` float32
    (T, Q, 2) and `visible` bool (T, Q): the tracks of Q surface points that are visible in the
    first frame, in working pixels (0 where unknown); `frames` int64 (T,).

    Args:
        dataset: The dataset.
        tier: Name of a tier.
        split: Name of a split.
        length: Frames in a clip T, >= 2.
        step: Episode frames from one clip frame to the next, >= 1.
        step_max: With it, each clip draws its step from `step` to this; episodes too short for
            a step give none of that step.
        queries: Tracks in a clip Q.
        input: `rgb`, `grey`, `depth` or `rgbd`.
        size: (w, h) of the network's input.
        seed: Seed of the draws.
        stream: Keeps datasets of one run apart.
        augmentation: Random changes, the same for all frames of a clip, or None. Its
            background setting does not apply: a backdrop that stays still is part of a clip.
        cache: Folder for decoded frames, or None.
        limit: Use the first so many sequences only.

    Raises:
        CallError: No episode is long enough.
    """

    def __init__(
        self,
        dataset: Dataset,
        tier: str,
        split: str,
        *,
        length: int = 4,
        step: int = 1,
        step_max: int | None = None,
        queries: int = 48,
        input: InputKind = "rgb",
        size: tuple[int, int] = (160, 120),
        seed: int = 0,
        stream: int = 0,
        augmentation: AugmentSettings | None = None,
        cache: Path | None = None,
        limit: int | None = None,
    ) -> None:
        steps = range(step, max(step, step_max or step) + 1)
        if length < 2 or step < 1 or queries < 1:
            raise CallError("a clip needs length >= 2, step >= 1 and queries >= 1")
        self.store = FrameStore(dataset, tier, split, size, cache=cache, limit=limit)
        self.length, self.queries = length, queries
        self.input = input
        self.seed, self.stream = seed, stream
        self.augmentation = augmentation
        starts = {each: self._starts((length - 1) * each) for each in steps}
        self.starts = {each: numbers for each, numbers in starts.items() if numbers}
        if not self.starts:
            span = (length - 1) * step
            raise CallError(
                f"tier {tier}, split {split} has no episode of {span + 1} frames",
                path=dataset.root,
                fix="Generate with --episodes and more --frames, or ask for shorter clips.",
            )

    def _starts(self, span: int) -> list[int]:
        """Return the frames with `span` frames of their episode after them."""
        return [
            number
            for number, ref in enumerate(self.store.frames)
            if ref.sequence.temporal and ref.frame + span < ref.sequence.frames
        ]

    def __len__(self) -> int:
        return max(map(len, self.starts.values()))

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        """Draw clip number `index` (any number >= 0)."""
        rng = sample_generator(self.seed, index, self.stream)
        steps = list(self.starts)
        step = steps[int(rng.integers(len(steps)))] if len(steps) > 1 else steps[0]
        start = self.starts[step][int(rng.integers(len(self.starts[step])))]
        frames = start + step * np.arange(self.length)
        views = [self.store.view(int(frame)) for frame in frames]
        candidates = np.flatnonzero(views[0].visible)
        if len(candidates) == 0:
            candidates = np.arange(self.store.points)
        drawn = rng.choice(candidates, self.queries, replace=len(candidates) < self.queries)
        views = [replace(v, uv_px=v.uv_px[drawn], visible=v.visible[drawn]) for v in views]
        if self.augmentation is not None:
            settings = self.augmentation
            angle = np.radians(rng.uniform(-settings.rotate_deg, settings.rotate_deg))
            factor = float(np.exp(rng.uniform(-1, 1) * np.log1p(settings.scale)))
            affine = rotation_about_centre(self.store.size, float(angle), factor)
            tint = int(rng.integers(2**62))
            for number, view in enumerate(views):
                moved = warp_view(view, affine)
                same_tint = np.random.default_rng(tint)  # one light for the whole clip
                rgb = recolour(same_tint, moved.rgb, settings.colour, 0.0)
                rgb = recolour(rng, rgb, 0.0, settings.noise)
                views[number] = replace(moved, rgb=rgb)
        uv = np.stack([view.uv_px for view in views])
        known = np.isfinite(uv).all(axis=-1)
        images = [NetworkInput(self.input).image(view.rgb, view.depth_m) for view in views]
        return {
            "image": torch.from_numpy(np.stack(images)),
            "mask": torch.from_numpy(np.stack([view.mask for view in views])),
            "uv_px": torch.from_numpy(np.where(known[..., None], uv, np.float32(0))),
            "visible": torch.from_numpy(np.stack([view.visible for view in views]) & known),
            "frames": torch.from_numpy(frames),
        }
