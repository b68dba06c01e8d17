"""`FrameDataset`: every frame of a tier once, in order."""

from __future__ import annotations

import numpy as np
import torch
from torch.utils.data import Dataset as TorchDataset

from pliant.loaders.frame_store import FrameStore
from pliant.loaders.inputs import InputKind, NetworkInput


class FrameDataset(TorchDataset[dict[str, torch.Tensor]]):
    """Every frame of a tier and split, with all its surface points.

    A sample holds `image` float32 (C, h, w), `mask` bool (h, w), `uv_px` float32 (P, 2) in
    working pixels (0 where unknown), `visible` bool (P,) and `material` float32 (P, 2).

    Args:
        store: The frames.
        input: `rgb`, `grey`, `depth` or `rgbd`.
    """

    def __init__(self, store: FrameStore, input: InputKind = "rgb") -> None:
        self.store = store
        self.input = NetworkInput(input)

    def __len__(self) -> int:
        return len(self.store)

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        if not 0 <= index < len(self):
            raise IndexError(index)
        view = self.store.view(index)
        known = np.isfinite(view.uv_px).all(axis=-1)
        return {
            "image": torch.from_numpy(self.input.image(view.rgb, view.depth_m)),
            "mask": torch.from_numpy(np.array(view.mask)),
            "uv_px": torch.from_numpy(np.where(known[:, None], view.uv_px, np.float32(0))),
            "visible": torch.from_numpy(view.visible & known),
            "material": torch.from_numpy(self.store.material),
        }
