"""One picture of an object, as a method may see it, and a pair of them with queries."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.camera import Camera


@dataclass(frozen=True, eq=False, repr=False)
class Frame:
    """One picture, and what a method may know about it: nothing here is ground truth.

    A frame is made from arrays (a photograph), or belongs to a dataset (`RecordedFrame`).

    Attributes:
        rgb: uint8 (H, W, 3), sRGB.
        mask: bool (H, W), True where the queried object is visible, or None if not known.
        depth_m: float32 (H, W), planar z in metres, +inf is background, or None if not known.
        key: Stable name of the frame (`SEQUENCE/INDEX`), for caches of descriptors; empty for
            a frame that must not be cached.
        objects: bool (H, W), True where any object is visible (a rope's ball too), or None.
        camera: Intrinsics and pose, or None if not known.

    Examples:
        >>> frame = pliant.load("sample").frames("test")[0]
        >>> frame.size, frame.rgb.shape, frame.mask.dtype.name
        ((256, 192), (192, 256, 3), 'bool')
        >>> frame.without_masks().mask is None
        True
    """

    rgb: npt.NDArray[np.uint8]
    mask: npt.NDArray[np.bool_] | None = None
    depth_m: npt.NDArray[np.float32] | None = None
    key: str = ""
    objects: npt.NDArray[np.bool_] | None = None
    camera: Camera | None = None

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return self.rgb.shape[1], self.rgb.shape[0]

    def replace(self, **changes: Any) -> Frame:
        """Return a frame of this one's arrays with some attributes changed."""
        kept = (each.name for each in fields(Frame) if each.name not in changes)
        return Frame(**{name: getattr(self, name) for name in kept}, **changes)

    def without_masks(self) -> Frame:
        """Return the frame as a method sees it that is given no masks.

        It keeps its key, by which methods cache what they found: show one method frames with masks
        or frames without, not both.
        """
        return self.replace(mask=None, objects=None)

    def __repr__(self) -> str:
        return f"Frame({self.key!r}, {self.size[0]}x{self.size[1]})"


@dataclass(frozen=True, eq=False, repr=False)
class Pair:
    """Two frames, and the pixels of the first that are asked for in the second.

    Attributes:
        source: The frame that the queries are in.
        target: The frame to find them in.
        uv_a_px: float32 (N, 2), the query pixels, centre of the first pixel at (0.5, 0.5).

    Examples:
        >>> pair = pliant.load("sample").pairs("test")[0]
        >>> len(pair), pair.uv_a_px.shape
        (64, (64, 2))
    """

    source: Frame
    target: Frame
    uv_a_px: npt.NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.uv_a_px)

    def __repr__(self) -> str:
        return f"Pair({self.source.key} -> {self.target.key}, {len(self)} queries)"
