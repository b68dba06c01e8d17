"""An object seen at a slant, brought to a view from straight above.

A camera's tilt gives the homography K R K^-1 (Hartley and Zisserman, Multiple View Geometry, 8.4)
to the image that a camera straight above would take. There, lengths in pixels are in proportion to
those of an object that lies flat. The widths along a rope's mask tell the tilt (`tilt.py`).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pliant.baselines.tracing.reframing import Reframed, magnification, mapped, warped
from pliant.baselines.tracing.settings import TRACING
from pliant.baselines.tracing.tilt import Nadir, slant
from pliant.spec.arrays import FloatArray, Mask
from pliant.spec.frame import Frame


def rectified(view: Frame) -> Reframed:
    """Return the view that a camera straight above the table would have of a rope.

    Args:
        view: The view. Without a mask, with too little of a rope or from almost straight above it
            stays as it is.
    """
    above = Nadir.of_frame(view)
    if view.mask is None or (tilt := slant(view.mask, above)) is None:
        return Reframed(view, above)
    return untilted(view, tilt, view.mask if view.objects is None else view.objects)


def untilted(
    view: Frame, tilt: float, shown: Mask, outside_rgb: tuple[int, ...] = (0, 0, 0)
) -> Reframed:
    """Return the view that a camera straight above would have, for a known tilt.

    Args:
        view: The view; its camera is not rolled.
        tilt: Tangent of the angle between the optical axis and the table's normal, positive where
            the lower part of the image is nearer.
        shown: bool (h, w), not empty, where the view shows the object, at any resolution. It ends
            in the middle of the frame.
        outside_rgb: Colour of what is outside the view.
    """
    above = Nadir.of_frame(view)
    turned = _turned_down(tilt, above)
    scale, shift_px = _fit(turned, shown, np.array(view.size))
    fit = np.array([[scale, 0, shift_px[0]], [0, scale, shift_px[1]], [0, 0, 1]])
    homography = fit @ turned
    seen = warped(view, homography, f"untilted by {tilt:.3f}", outside_rgb)
    return Reframed(seen, above.scaled(scale, shift_px), homography, view, tilted=True)


def _turned_down(tilt: float, above: Nadir) -> FloatArray:
    """Return K R K^-1 of the rotation that turns the table's normal into the optical axis."""
    focal, (u, v) = above.focal_px, above.place_px
    camera = np.array([[focal, 0, u], [0, focal, v], [0, 0, 1]])
    angle = np.arctan(tilt)
    cosine, sine = np.cos(angle), np.sin(angle)
    rotation = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    return np.asarray(camera @ rotation @ np.linalg.inv(camera))


def _fit(
    homography: FloatArray, shown: Mask, size: npt.NDArray[np.int64]
) -> tuple[float, FloatArray]:
    """Return the scale, and the shift after it, that centre the visible object in the frame."""
    places = (np.argwhere(shown)[:, ::-1] + 0.5) * size / shown.shape[::-1]
    there = mapped(homography, places)
    low, high = there.min(axis=0), there.max(axis=0)
    usual = 1 / float(np.median(magnification(homography, places)))
    scale = min(usual, float((TRACING.slant_fill * size / np.maximum(high - low, 1)).min()))
    return scale, np.asarray(size / 2 - scale * (low + high) / 2)
