"""What every outside source is read into: frames, and where points are in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.answers import MAX_POSITION_PX
from pliant.spec.arrays import FloatArray, ImageArray, Mask
from pliant.spec.io.resizing import resize_rgb


@dataclass(frozen=True)
class Clip:
    """Frames of one object or scene, and the points known in them.

    Attributes:
        name: Where it comes from, for messages and records.
        size: (width, height) of its frames, px.
        frames: How many frames there are.
        read: Returns a frame, uint8 (H, W, 3), sRGB.
        uv_px: float64 (N, T, 2), positions from the image's corner (the first pixel's centre is
            at (0.5, 0.5)); NaN where the position is not known, or farther than any answer may be.
        visible: bool (N, T), where the point is seen, its position known and in the image.
        temporal: True for frames in time, False for independent configurations.
        pairs: The (source, target) frames that its source lists, None for no list.
        facts: JSON-able facts for the provenance: names of pictures and points, scales.
        read_mask: Returns the object in a frame, bool (H, W); None for no masks.
        read_depth: Returns a frame's depth, float32 (H, W), metres, +inf where it is not known;
            None for no depth.
    """

    name: str
    size: tuple[int, int]
    frames: int
    read: Callable[[int], ImageArray]
    uv_px: FloatArray
    visible: npt.NDArray[np.bool_]
    temporal: bool
    pairs: Sequence[tuple[int, int]] | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)
    read_mask: Callable[[int], Mask] | None = None
    read_depth: Callable[[int], npt.NDArray[np.float32]] | None = None

    def __post_init__(self) -> None:
        far = (np.abs(self.uv_px) > MAX_POSITION_PX).any(axis=2)  # trackers write any number there
        object.__setattr__(self, "uv_px", np.where(far[..., None], np.nan, self.uv_px))
        # A position that was rounded up to the border, or is beyond it, is not seen.
        object.__setattr__(self, "visible", self.visible & self.within())

    def within(self) -> npt.NDArray[np.bool_]:
        """Return where positions are known and are in the image, bool (N, T)."""
        u, v = self.uv_px[..., 0], self.uv_px[..., 1]
        # As float32, in which they are stored: a position just below the border may round up.
        low = (u >= 0) & (v >= 0)
        return low & (np.float32(u) < self.size[0]) & (np.float32(v) < self.size[1])


def resized(clip: Clip, size: tuple[int, int]) -> Clip:
    """Return a clip at another size: images resampled, positions scaled from the corner.

    Args:
        clip: The clip.
        size: (width, height), px.
    """
    if clip.size == size:
        return clip
    scale = np.array([size[0] / clip.size[0], size[1] / clip.size[1]])
    return replace(
        clip,
        size=size,
        read=lambda frame: resize_rgb(clip.read(frame), size),
        uv_px=clip.uv_px * scale,
    )
