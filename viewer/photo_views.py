"""Two photographs as methods see them: masks that are not given are found where that is certain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from pliant.baselines.pixels import lies_on
from pliant.baselines.views import read_frame
from pliant.spec.arrays import Mask, border
from pliant.spec.ball import separate_ball
from pliant.spec.errors import CallError
from pliant.spec.frame import Frame
from pliant.spec.io.photo import photo_size, read_mask
from pliant.spec.io.resizing import resize_nearest

Positions = Sequence[tuple[float, float]]

_DIFFERS: Final = 16  # grey levels by which an object differs from its background
_FLAT: Final = 0.8
"""Least share of the background, and of the border, that has one colour exactly.

A white background after JPEG has 0.91, a dark table under even light 0.06; on a table, shadows
would be taken for the object.
"""

_BLOCK_PX: Final = 8  # side of a block of JPEG, in which an edge changes the background's colour
_LEAST_OBJECT: Final = 0.0005  # of the picture; less is noise
_LEAST_PART: Final = 0.02  # of the largest part
_INVERTED: Final = 0.9  # share of the border that few objects cover, and most backgrounds


@dataclass(frozen=True)
class PhotoFiles:
    """The files of one photograph.

    Attributes:
        picture: The picture.
        mask: A picture that is black outside the object, or None.
        objects: A picture that is black outside the object and what is attached to it, such as a
            rope's ball, or None.
        depth: Its depth image, or None.
    """

    picture: Path
    mask: Path | None = None
    objects: Path | None = None
    depth: Path | None = None


@dataclass(frozen=True)
class PhotoView:
    """A photograph as methods see it.

    Attributes:
        view: The picture, perhaps reduced, with its masks.
        size: (width, height) of the picture itself.
        notes: What was done to get the masks, in sentences.
    """

    view: Frame
    size: tuple[int, int]
    notes: Sequence[str] = ()

    @property
    def scale(self) -> npt.NDArray[np.float64]:
        """(u, v), pixels of the picture per pixel of the view."""
        height, width = self.view.rgb.shape[:2]
        return np.array([self.size[0] / width, self.size[1] / height])


def read_photo_view(
    files: PhotoFiles, max_side: int | None = None, asked_px: Positions = ()
) -> PhotoView:
    """Read a photograph with its masks.

    Without a mask, a background of one colour gives one. A ball at the end of a rope is separated
    from a mask that contains it.

    Args:
        files: The files.
        max_side: The longer side of a larger picture is reduced to so many pixels.
        asked_px: Pixels of the picture that the object must show: a mask that is found but misses
            one of them is not used.

    Raises:
        CallError: A file is missing.
        PliantError: A file cannot be read, or is not of the picture's size.
    """
    view = read_frame(files.picture, files.mask, files.depth, max_side)
    photo = PhotoView(view, photo_size(files.picture))
    if files.objects is not None:
        return _with_objects(photo, files.objects)
    name, notes = files.picture.name, []
    mask, why = view.mask, "the mask"
    if mask is not None and border(mask).mean() > _INVERTED:
        notes.append(
            f"{name}: the mask covers the border of the picture. If it is black on the object, and "
            "not outside, invert it."
        )
    if mask is None:
        mask, why = object_on_one_colour(view.rgb), "it"
        asked = (np.array(asked_px, np.float64).reshape(-1, 2) / photo.scale).astype(np.float32)
        if mask is None or not lies_on(asked, mask).all():
            return photo
        share = np.count_nonzero(mask) / mask.size
        notes.append(
            f"{name}: the background has one colour, so what differs from it is the object "
            f"({share:.1%} of the picture)."
        )
    rope, ball = separate_ball(mask)
    if ball is not None:
        notes.append(f"{name}: a ball at the rope's end was separated from {why}.")
    # A background of one colour hides no ball: a rope without one is then known to have none.
    objects = None if ball is None and view.mask is not None else mask
    return replace(photo, view=view.replace(mask=rope, objects=objects), notes=tuple(notes))


def object_on_one_colour(rgb: npt.NDArray[np.uint8]) -> Mask | None:
    """Return where a picture differs from a background of one colour.

    Args:
        rgb: uint8 (H, W, 3).

    Returns:
        bool (H, W), or None where the background is not of one colour or nothing differs from it.
    """
    gap = np.abs(rgb - np.median(border(rgb), axis=0)).max(axis=2)
    differs = gap > _DIFFERS
    background = gap[~differs]
    flatness = min(np.mean(part == 0) for part in (border(gap), background) if part.size)
    if flatness < _FLAT or not differs.any():
        return None
    # What is enclosed by the object is a dark or bright place of the object itself, unless
    # half as much of it has the background's exact colour as of the background around the object.
    holes, count = ndimage.label(~differs)
    outside = ~differs & np.isin(holes, border(holes))
    around = outside & ndimage.binary_dilation(differs, np.ones((3, 3)), iterations=_BLOCK_PX)
    flat = np.ones(count + 1)  # label 0 is the object itself
    flat[1:] = ndimage.mean(gap == 0, holes, range(1, count + 1))
    differs |= (flat < np.mean(gap[around] == 0) / 2)[holes]
    parts, _ = ndimage.label(differs, np.ones((3, 3)))
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    if sizes.max() < _LEAST_OBJECT * differs.size:
        return None
    return np.asarray((sizes >= _LEAST_PART * sizes.max())[parts])


def _with_objects(photo: PhotoView, path: Path) -> PhotoView:
    """Return a photograph with a mask of the object and all that is attached to it."""
    view = photo.view
    height, width = view.rgb.shape[:2]
    objects = resize_nearest(read_mask(path, photo.size), (width, height))
    if view.mask is None:
        raise CallError(
            "a mask of all objects (--objects-…) needs the object's own mask (--mask-…)", path=path
        )
    return replace(photo, view=view.replace(objects=objects | view.mask))
