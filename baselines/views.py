"""The frames of a dataset, and any two photographs, as methods see them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from pliant.baselines.lru_cache import LRUCache
from pliant.baselines.matcher import View
from pliant.spec.frame import Frame
from pliant.spec.io.photo import read_depth, read_mask, read_photo
from pliant.spec.io.resizing import resize_nearest


class ViewReader:
    """Reads frames as views and keeps the last few.

    A frame without a surface image has the mask and the depth that were recorded with it, if any.

    Args:
        capacity: Number of frames kept.
        masks: Whether the views have masks; without, a method sees the image and the depth alone.
    """

    def __init__(self, capacity: int = 4, *, masks: bool = True) -> None:
        self._views: LRUCache[View] = LRUCache(capacity)
        self._masks = masks

    def view(self, frame: Frame) -> View:
        """Return a frame's view.

        Raises:
            SpecError: One of the frame's files is damaged.
            CallError: The sequence has no such frame.
        """
        return self._views.get(frame.key, lambda: self._read(frame))

    def _read(self, frame: Frame) -> View:
        view = read_view_of(frame)
        return view if self._masks else replace(view, mask=None, objects=None)


def read_view_of(frame: Frame) -> View:
    """Return a frame as a method sees it; see `ViewReader`."""
    surface = frame.surface
    ids = frame.object_ids if surface is None else surface.object_id
    return View(
        rgb=frame.rgb,
        mask=None if ids is None else frame.queried_in(ids),
        depth_m=frame.depth_m if surface is None else surface.depth_m,
        key=frame.key,
        objects=None if ids is None else ids > 0,
    )


def read_view(
    picture: Path | str,
    mask: Path | str | None = None,
    depth: Path | str | None = None,
    max_side: int | None = None,
) -> View:
    """Read a picture, with a mask of the object in it and its depth, as a view.

    Args:
        picture: The picture.
        mask: A picture of the same size that is black outside the object (a picture with a black
            background is its own mask), or None.
        depth: A depth image of the same size, as `read_depth` takes it, or None.
        max_side: The longer side of a larger picture is reduced to so many pixels, None leaves it.

    Raises:
        CallError: A file is missing, the sizes differ, or the mask is black everywhere.
        PliantError: A file is not a picture that can be read.
    """
    rgb = read_photo(picture)
    size = (rgb.shape[1], rgb.shape[0])
    on = None if mask is None else read_mask(mask, size)
    depth_m = None if depth is None else read_depth(depth, size)
    if max_side is not None and max(size) > max_side:
        width, height = (max(1, round(side * max_side / max(size))) for side in size)
        small = width, height
        rgb = np.asarray(Image.fromarray(rgb).resize(small, Image.Resampling.BOX))
        on = None if on is None else resize_nearest(on, small)
        depth_m = None if depth_m is None else resize_nearest(depth_m, small)
    return View(rgb=rgb, mask=on, depth_m=depth_m, key=str(picture))
