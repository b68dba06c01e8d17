"""Any two pictures as views: photographs, with masks and depth where somebody has them."""

from __future__ import annotations

from pathlib import Path

from pliant.baselines.matcher import View
from pliant.spec.io.photo import read_depth, read_mask, read_photo


def read_view(
    picture: Path | str, mask: Path | str | None = None, depth: Path | str | None = None
) -> View:
    """Read a picture, with a mask of the object in it and its depth, as a view.

    Args:
        picture: The picture.
        mask: A picture of the same size that is black outside the object (a picture with a black
            background is its own mask), or None.
        depth: A depth image of the same size, as `read_depth` takes it, or None.

    Raises:
        CallError: A file is missing, the sizes differ, or the mask is black everywhere.
        PliantError: A file is no picture that can be read.
    """
    rgb = read_photo(picture)
    size = (rgb.shape[1], rgb.shape[0])
    return View(
        rgb=rgb,
        mask=None if mask is None else read_mask(mask, size),
        depth_m=None if depth is None else read_depth(depth, size),
        key=str(picture),
    )
