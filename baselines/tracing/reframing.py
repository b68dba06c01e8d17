"""A picture brought to another frame by a homography, and answers in it brought back.

Networks and tracers work best on objects of the size, and seen from the direction, that they were
made for. `zoomed` enlarges a small object; `rectified` brings a rope to the view from straight
above.

A camera's tilt gives the homography K R K^-1 (Hartley and Zisserman, Multiple View Geometry, 8.4)
to the image that a camera straight above would take. There, lengths in pixels are in proportion to
those of an object that lies flat. The widths along a rope's mask tell the tilt (`tilt.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.baselines.tracing.settings import TRACING
from pliant.baselines.tracing.tilt import Nadir, slant
from pliant.spec.answers import Answers
from pliant.spec.arrays import FloatArray, Mask
from pliant.spec.frame import Frame


@dataclass(frozen=True)
class Reframed:
    """A view in another frame, or the view itself.

    Attributes:
        view: The view.
        nadir: Where its camera looks straight down.
        homography: float64 (3, 3), from positions of the original to positions of `view`; None
            where they are equal.
        original: The original; None where `view` is it.
        tilted: Whether the direction of the view has changed.
        turned: Whether it was turned, since the object is far from upright.
        settled: Whether it is known that no other quarter turn is right.
        segmented: Whether its masks were found, or corrected, in the picture.
    """

    view: Frame
    nadir: Nadir
    homography: FloatArray | None = None
    original: Frame | None = None
    tilted: bool = False
    turned: bool = False
    settled: bool = False
    segmented: bool = False

    @classmethod
    def unchanged(cls, view: Frame) -> Reframed:
        """Return a view unchanged, as one from straight above."""
        return cls(view, Nadir.of_frame(view))

    def zoomed(self, shown: Mask | None, least: float, wanted: float) -> Reframed:
        """Return a part of the view that a small object fills; any other view stays as it is.

        Args:
            shown: bool (h, w), where `view` shows the object, at any resolution; None or empty
                leaves the view as it is.
            least: Share of the frame's width or height, whichever is more, that the object's box
                takes at least in views that stay as they are.
            wanted: The share that it takes afterwards, at least `least`.
        """
        box = None if shown is None else _box(shown)
        if box is None:
            return self
        size = np.array(self.view.size)
        share = float((box[1] - box[0]).max())
        if share >= least:
            return self
        scale = wanted / share
        corner_px = ((box.mean(axis=0) - 0.5 / scale) * size).clip(0, (1 - 1 / scale) * size)
        shift_px = -scale * corner_px
        zoom = np.array([[scale, 0, shift_px[0]], [0, scale, shift_px[1]], [0, 0, 1]])
        return self._moved(zoom, self.nadir.scaled(scale, shift_px), "zoomed")

    def turned_by(self, angle_rad: float, shown: Mask, most: float) -> Reframed:
        """Return the view turned about the middle of an object, which ends in the frame's middle.

        Args:
            angle_rad: By how much, from right to down.
            shown: bool (h, w), not empty, where `view` shows the object, at any resolution.
            most: Share of the frame's width or height, whichever is more, that the turned object's
                box may take; a larger object is reduced.
        """
        size = np.array(self.view.size)
        rows, columns = np.nonzero(shown)
        places = (np.stack([columns, rows], axis=1) + 0.5) / shown.shape[::-1] * size
        cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        there = places @ turn.T
        low, high = there.min(axis=0), there.max(axis=0)
        scale = most / max(most, float(((high - low) / size).max()))  # one pixel has no extent
        matrix = np.eye(3)
        matrix[:2, :2] = scale * turn
        matrix[:2, 2] = size / 2 - scale * (low + high) / 2
        below = mapped(matrix, self.nadir.place_px[None])[0]
        nadir = Nadir(below, scale * self.nadir.focal_px, turn @ self.nadir.tilt)
        name = f"turned by {np.degrees(angle_rad):.0f}"
        return replace(self._moved(matrix, nadir, name), turned=True)

    def _moved(self, step: FloatArray, nadir: Nadir, name: str) -> Reframed:
        """Return the original under one map more, in one step from its own pixels."""
        original = self.original or self.view
        homography = step if self.homography is None else step @ self.homography
        seen = warped(original, homography, name, original.border_rgb)
        return Reframed(seen, nadir, homography, original, self.tilted, self.turned)

    def forward(self, uv_px: npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.float32]:
        """Return positions of the original in `view`, float32 (N, 2)."""
        if self.homography is None:
            return uv_px.astype(np.float32)
        return mapped(self.homography, uv_px).astype(np.float32)

    def back(self, answers: Answers) -> Answers:
        """Return answers in the original, of answers in `view`; widths scale with the map."""
        if self.homography is None:
            return answers
        inverse = np.linalg.inv(self.homography)
        sigma, modes = answers.sigma_px, answers.modes
        if sigma is not None:
            sigma = (sigma * magnification(inverse, answers.uv_px)).astype(np.float32)
        if modes is not None:
            modes = [_mapped_modes(inverse, rows) for rows in modes]
        return replace(
            answers,
            uv_px=mapped(inverse, answers.uv_px).astype(np.float32),
            sigma_px=sigma,
            modes=modes,
        )

    def back_image(self, values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Return values of the pixels of `view` at those of the original, NaN where it has none.

        Args:
            values: float32 (H, W).
        """
        if self.homography is None:
            return values
        height, width = values.shape
        row, column = np.indices((height, width)).reshape(2, -1) + 0.5
        u, v = np.floor(self.forward(np.stack([column, row], axis=1))).astype(np.int64).T
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        found = np.full(height * width, np.nan, np.float32)
        found[inside] = values[v[inside], u[inside]]
        return found.reshape(height, width)


def mapped(homography: FloatArray, uv_px: npt.NDArray[np.floating[Any]]) -> FloatArray:
    """Return positions (N, 2) under a homography, float64 (N, 2)."""
    homogeneous = np.column_stack([uv_px, np.ones(len(uv_px))]) @ homography.T
    return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])


def magnification(homography: FloatArray, uv_px: npt.NDArray[np.floating[Any]]) -> FloatArray:
    """Return the root of the homography's Jacobian determinant at places (N, 2), float64 (N,)."""
    weight = np.column_stack([uv_px, np.ones(len(uv_px))]) @ homography[2]
    return np.asarray(np.sqrt(np.abs(np.linalg.det(homography) / weight**3)))


def warped(
    view: Frame,
    homography: FloatArray,
    name: str,
    outside_rgb: tuple[int, ...] = (0, 0, 0),
) -> Frame:
    """Return a view in another frame of the same size.

    Args:
        view: The view.
        homography: float64 (3, 3), from its positions to those of the result.
        name: What is appended to its key.
        outside_rgb: Colour of what is outside the view.
    """
    inverse = np.linalg.inv(homography)
    coefficients = (inverse / inverse[2, 2]).ravel()[:8].tolist()

    def warp(
        values: npt.NDArray[Any],
        resample: Image.Resampling,
        outside: float | tuple[int, ...] = 0.0,
    ) -> npt.NDArray[Any]:
        picture = Image.fromarray(values)
        perspective = Image.Transform.PERSPECTIVE
        moved = picture.transform(
            view.size, perspective, coefficients, resample, fillcolor=outside or None
        )
        return np.asarray(moved)

    def masked(mask: Mask | None) -> Mask | None:
        if mask is None:
            return None
        return warp(mask.astype(np.uint8) * 255, Image.Resampling.BILINEAR) > 127

    depth_m = view.depth_m
    if depth_m is not None:
        depth_m = (depth_m * _relative_depth(homography, depth_m.shape)).astype(np.float32)
        depth_m = warp(depth_m, Image.Resampling.NEAREST, np.inf)
    return view.replace(
        variant=name,
        rgb=warp(view.rgb, Image.Resampling.BILINEAR, outside_rgb),
        mask=masked(view.mask),
        depth_m=depth_m,
        objects=masked(view.objects),
        camera=None,
    )


def _box(shown: Mask) -> FloatArray | None:
    """Return the first and last corner of a mask's box as shares of its sides, float64 (2, 2)."""
    rows, columns = (np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0))
    if len(rows) == 0:
        return None
    corners = np.array([[columns[0], rows[0]], [columns[-1] + 1, rows[-1] + 1]])
    return np.asarray(corners / shown.shape[::-1])


def _mapped_modes(homography: FloatArray, rows: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    moved = rows.astype(np.float64)
    moved[:, 2] *= magnification(homography, rows[:, :2])
    moved[:, :2] = mapped(homography, rows[:, :2])
    return moved.astype(np.float32)


def _relative_depth(homography: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return the depth along the turned optical axis over that along the old one, (H, W).

    The last row of K R K^-1 times (u, v, 1) is the third coordinate of R K^-1 (u, v, 1).
    """
    row, column = np.indices(shape) + 0.5
    return np.asarray(homography[2, 0] * column + homography[2, 1] * row + homography[2, 2])


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
