"""Photographs as input frames of methods."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from pliant.spec.frame import Frame
from pliant.spec.io.photo import photo_size, read_depth, read_mask, read_photo
from pliant.spec.io.resizing import resize_nearest


def read_frame(
    picture: Path | str,
    mask: Path | str | None = None,
    depth: Path | str | None = None,
    max_side: int | None = None,
) -> Frame:
    """Read a picture, with a mask of the object in it and its depth, as a frame.

    Args:
        picture: The picture.
        mask: A picture of the same size that is black outside the object (a picture with a black
            background is its own mask), or None.
        depth: A depth image of the same size, as `read_depth` takes it, or None.
        max_side: The longer side of a larger picture is reduced to so many pixels, None leaves it.

    Raises:
        CallError: A file is missing.
        PliantError: A file cannot be read, the sizes differ, or the mask is black everywhere.

    Examples:
        >>> from PIL import Image
        >>> Image.new("RGB", (800, 600)).save("rope.png")
        >>> pliant.baselines.views.read_frame("rope.png", max_side=400).size
        (400, 300)
    """
    rgb = read_photo(picture, max_side)
    whole, size = photo_size(picture), (rgb.shape[1], rgb.shape[0])
    on = None if mask is None else resize_nearest(read_mask(mask, whole), size)
    depth_m = None if depth is None else resize_nearest(read_depth(depth, whole), size)
    frame = Frame(rgb=rgb, mask=on, depth_m=depth_m, key=str(picture))
    contents = hashlib.sha256(repr(size).encode())  # a camera may write to the same file again
    for array in (rgb, on, depth_m):
        contents.update(b"none" if array is None else np.ascontiguousarray(array).data)
    return frame.cached_as(f"{picture} {contents.hexdigest()}")
