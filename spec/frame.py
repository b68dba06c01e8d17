"""A frame as input of a method, and a pair of frames with queries."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, fields
from typing import Any, Final, Self

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import border
from pliant.spec.camera import Camera

_CHANGES: Final = itertools.count()


@dataclass(frozen=True, eq=False, repr=False)
class Frame:
    """One picture and the other inputs of a method. It contains no ground truth.

    A frame is made from arrays (a photograph), or belongs to a dataset (`RecordedFrame`).

    Attributes:
        rgb: uint8 (H, W, 3), sRGB.
        mask: bool (H, W), True where the queried object is visible, or None if not known.
        depth_m: float32 (H, W), planar z in metres, +inf is background, or None if not known.
        key: Name of the frame (`SEQUENCE/INDEX` in a dataset), or empty.
        objects: bool (H, W), True where any object is visible (a rope's ball too), or None.
        camera: Intrinsics and pose, or None if not known.
        cache_key: Name of the contents, under which methods cache computed features: its
            key, for a frame that is made from arrays. A frame without one is not cached.

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
    cache_key: str = field(init=False)

    def __post_init__(self) -> None:
        self.cached_as(self.key)

    def cached_as(self, cache_key: str) -> Self:
        """Give a frame that was just made another `cache_key`, and return it."""
        object.__setattr__(self, "cache_key", cache_key)
        return self

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return self.rgb.shape[1], self.rgb.shape[0]

    @property
    def border_rgb(self) -> tuple[int, ...]:
        """The mean colour of the border, used as fill colour outside of a warped picture."""
        return tuple(int(value) for value in border(self.rgb).mean(axis=0).round())

    def replace(self, *, variant: str = "", **changes: Any) -> Frame:
        """Return a frame of this one's arrays with some attributes changed.

        Its `cache_key` is a new `key` if there is one among the changes; else that of this frame
        with the variant, or with a number of its own if changes have no name.

        Args:
            variant: Name of the changes: they are the same wherever this frame has this variant.
            changes: Attributes and their new values.
        """
        cache_key = self.cache_key
        if "key" in changes:
            cache_key = changes["key"]
        elif changes and cache_key:
            cache_key = f"{cache_key}/{variant or next(_CHANGES)}"
        names = (each.name for each in fields(Frame) if each.init)
        kept = {name: getattr(self, name) for name in names if name not in changes}
        return Frame(**kept, **changes).cached_as(cache_key)

    def without_masks(self) -> Frame:
        """Return the frame without its masks."""
        return self.replace(variant="without masks", mask=None, objects=None)

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
