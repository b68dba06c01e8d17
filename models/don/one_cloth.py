"""One cloth, in a mask found in a picture that also shows other cloths next to it.

The network for masks finds everything that looks like a cloth. A part in another colour may be a
print, the underside or another cloth. A print ends where its cloth ends: the outline is straight
where the part meets the rest. Another cloth is mostly outside of the outline of the first, which
has two concave corners there.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from scipy import ndimage

from pliant.models.don.table import log_colour
from pliant.spec.arrays import Float32Array, Mask, Rgb

# Set on 560 validation pictures: 200 with other objects next to cloths, 360 without; pixels are
# those of a picture of 320x240.
_ALIKE: Final = 0.4  # distance of two colours of one cloth
_LIGHT: Final = 0.4  # weight of the logarithm of light in it; the tint's is 1
_SAMPLES: Final = 400
_SMOOTHING_PX: Final = 5
_THIN_PX: Final = 2  # thinner parts are shadows of folds and lines of prints
_EDGE_PX: Final = 3  # between two colours
_LEAST, _MOST = 0.05, 0.5  # area of another cloth, of the mask
_CONVEX: Final = 0.7  # its area, of its convex hull's
_FREE: Final = 0.55  # of its border, on the outline of the mask
_CORNER_PX: Final = 10
_CONCAVE: Final = 0.58  # of a disc at a corner, in the mask; a straight outline has 0.5
_WHOLE: Final = 0.9  # of what remains, in one piece


def of_one_cloth(rgb: Rgb, mask: Mask) -> Mask:
    """Return a mask without the parts that are other cloths.

    Args:
        rgb: uint8 (H, W, 3), sRGB.
        mask: bool (H, W), what looks like a cloth; not empty.

    Returns:
        bool (H, W).
    """
    parts, _ = ndimage.label(_in_another_colour(rgb, mask))
    areas = np.bincount(parts.ravel())
    for label in np.argsort(-areas[1:]) + 1:
        part = parts == label
        if _LEAST < areas[label] / mask.sum() < _MOST and _is_convex(part):
            mask = _without(mask, part)
    return mask


def _in_another_colour(rgb: Rgb, mask: Mask) -> Mask:
    """Return the parts that do not have the colour that most of the mask has."""
    light, tint = log_colour(np.asarray(cv2.medianBlur(rgb, _SMOOTHING_PX), dtype=np.uint8))
    colour = np.concatenate([tint, _LIGHT * light[..., None]], axis=-1)
    samples = colour[mask][:: max(1, int(mask.sum()) // _SAMPLES)]
    alike = np.linalg.norm(samples[:, None] - samples, axis=-1) < _ALIKE
    usual = samples[alike.sum(axis=1).argmax()]
    other = mask & (np.linalg.norm(colour - usual, axis=-1) > _ALIKE)
    return np.asarray(ndimage.binary_opening(other, np.ones((3, 3)), iterations=_THIN_PX))


def _is_convex(part: Mask) -> bool:
    hull = cv2.convexHull(np.argwhere(part).astype(np.int32))
    # The hull's corners are pixel centres: half of its length, and 1, is missing (Pick).
    area = cv2.contourArea(hull) + cv2.arcLength(hull, True) / 2 + 1
    return bool(part.sum() > _CONVEX * area)


def _without(mask: Mask, part: Mask) -> Mask:
    """Return a mask without a part, if that is another cloth."""
    near = _dilated(part, _EDGE_PX)
    remaining = mask & ~near
    pieces, count = ndimage.label(remaining)
    if count == 0:  # the rest is a thin border
        return mask
    rest = pieces == np.bincount(pieces.ravel())[1:].argmax() + 1
    if rest.sum() < _WHOLE * remaining.sum():
        return mask
    outline = mask & ~ndimage.binary_erosion(mask)
    border = part & ~ndimage.binary_erosion(part)
    free = (outline & near).sum() / border.sum()
    corners = outline & _dilated(part, _EDGE_PX + 1) & _dilated(rest, _EDGE_PX)
    if free < _FREE or not corners.any() or _filled(mask)[corners].mean() < _CONCAVE:
        return mask
    return np.asarray(rest)


def _dilated(mask: Mask, distance_px: int) -> Mask:
    return np.asarray(ndimage.binary_dilation(mask, iterations=distance_px))


def _filled(mask: Mask) -> Float32Array:
    """Return how much of a disc around each pixel is in a mask, float32 (H, W)."""
    rows, columns = np.mgrid[-_CORNER_PX : _CORNER_PX + 1, -_CORNER_PX : _CORNER_PX + 1]
    disc = (np.hypot(rows, columns) <= _CORNER_PX).astype(np.float32)
    inside = cv2.filter2D(mask.astype(np.float32), -1, disc / disc.sum())
    return np.asarray(inside, dtype=np.float32)
