"""A rope seen at a slant, brought to a view from straight above.

The widths along a mask tell the camera's tilt (`tilt.py`), and with it the homography K R K^-1
(Hartley and Zisserman, Multiple View Geometry, 8.4) to the image that a camera straight above would
take. There, arc lengths in pixels are in proportion to those of the rope.
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
class Rectified:
    """A view from straight above, or the view itself where it is one already.

    Attributes:
        view: The view.
        nadir: Where its camera looks straight down.
        homography: float64 (3, 3), from positions of the original to positions of `view`; None
            where they are equal.
    """

    view: Frame
    nadir: Nadir
    homography: FloatArray | None = None

    @classmethod
    def unchanged(cls, view: Frame) -> Rectified:
        """Return a view as it is, taken for one from straight above."""
        return cls(view, Nadir.of_frame(view))

    @property
    def tilted(self) -> bool:
        """Whether `view` is another image than the original."""
        return self.homography is not None

    def forward(self, uv_px: npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.float32]:
        """Return positions of the original in `view`, float32 (N, 2)."""
        if self.homography is None:
            return uv_px.astype(np.float32)
        return _mapped(self.homography, uv_px).astype(np.float32)

    def back(self, answers: Answers) -> Answers:
        """Return answers in the original, of answers in `view`; widths scale with the map."""
        if self.homography is None:
            return answers
        inverse = np.linalg.inv(self.homography)
        sigma, modes = answers.sigma_px, answers.modes
        if sigma is not None:
            sigma = (sigma * _magnification(inverse, answers.uv_px)).astype(np.float32)
        if modes is not None:
            modes = [_mapped_modes(inverse, rows) for rows in modes]
        return replace(
            answers,
            uv_px=_mapped(inverse, answers.uv_px).astype(np.float32),
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


def rectified(view: Frame) -> Rectified:
    """Return the view that a camera straight above the table would have of a rope.

    Args:
        view: The view. Without a mask, with too little of a rope or from almost straight above it
            stays as it is.
    """
    above = Nadir.of_frame(view)
    if view.mask is None or (tilt := slant(view.mask, above)) is None:
        return Rectified(view, above)
    shown = view.mask if view.objects is None else view.objects
    turned = _from_above(tilt, above)
    scale, shift_px = _fit(turned, shown)
    fit = np.array([[scale, 0, shift_px[0]], [0, scale, shift_px[1]], [0, 0, 1]])
    homography = fit @ turned
    return Rectified(_warped(view, homography), above.scaled(scale, shift_px), homography)


def _from_above(tilt: float, above: Nadir) -> FloatArray:
    """Return K R K^-1 of the rotation that turns the table's normal into the optical axis."""
    focal, (u, v) = above.focal_px, above.place_px
    camera = np.array([[focal, 0, u], [0, focal, v], [0, 0, 1]])
    angle = np.arctan(tilt)
    cosine, sine = np.cos(angle), np.sin(angle)
    rotation = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    return np.asarray(camera @ rotation @ np.linalg.inv(camera))


def _fit(homography: FloatArray, shown: Mask) -> tuple[float, FloatArray]:
    """Return the scale and then the shift that bring what is shown to the middle of the frame."""
    places = np.argwhere(shown)[:, ::-1] + 0.5
    mapped = _mapped(homography, places)
    low, high = mapped.min(axis=0), mapped.max(axis=0)
    size = np.array(shown.shape[::-1])
    usual = 1 / float(np.median(_magnification(homography, places)))
    scale = min(usual, float((TRACING.slant_fill * size / np.maximum(high - low, 1)).min()))
    return scale, np.asarray(size / 2 - scale * (low + high) / 2)


def _mapped(homography: FloatArray, uv_px: npt.NDArray[np.floating[Any]]) -> FloatArray:
    """Return float64 (N, 2)."""
    homogeneous = np.column_stack([uv_px, np.ones(len(uv_px))]) @ homography.T
    return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])


def _magnification(
    homography: FloatArray, uv_px: npt.NDArray[np.floating[Any]]
) -> npt.NDArray[np.float64]:
    """Return the root of the homography's Jacobian determinant, float64 (N,)."""
    weight = np.column_stack([uv_px, np.ones(len(uv_px))]) @ homography[2]
    return np.asarray(np.sqrt(np.abs(np.linalg.det(homography) / weight**3)))


def _mapped_modes(homography: FloatArray, rows: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    moved = rows.astype(np.float64)
    moved[:, 2] *= _magnification(homography, rows[:, :2])
    moved[:, :2] = _mapped(homography, rows[:, :2])
    return moved.astype(np.float32)


def _relative_depth(homography: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return the depth along the turned optical axis over that along the old one, (H, W).

    The last row of K R K^-1 times (u, v, 1) is the third coordinate of R K^-1 (u, v, 1).
    """
    row, column = np.indices(shape) + 0.5
    return np.asarray(homography[2, 0] * column + homography[2, 1] * row + homography[2, 2])


def _warped(view: Frame, homography: FloatArray) -> Frame:
    inverse = np.linalg.inv(homography)
    coefficients = (inverse / inverse[2, 2]).ravel()[:8].tolist()
    size = (view.rgb.shape[1], view.rgb.shape[0])

    def warp(
        values: npt.NDArray[Any], resample: Image.Resampling, outside: float = 0.0
    ) -> npt.NDArray[Any]:
        picture = Image.fromarray(values)
        perspective = Image.Transform.PERSPECTIVE
        warped = picture.transform(
            size, perspective, coefficients, resample, fillcolor=outside or None
        )
        return np.asarray(warped)

    def masked(mask: Mask | None) -> Mask | None:
        if mask is None:
            return None
        return warp(mask.astype(np.uint8) * 255, Image.Resampling.BILINEAR) > 127

    depth_m = view.depth_m
    if depth_m is not None:
        depth_m = (depth_m * _relative_depth(homography, depth_m.shape)).astype(np.float32)
        depth_m = warp(depth_m, Image.Resampling.NEAREST, np.inf)
    return Frame(
        rgb=warp(view.rgb, Image.Resampling.BILINEAR),
        mask=masked(view.mask),
        depth_m=depth_m,
        key=f"{view.key}/rectified" if view.key else "",
        objects=masked(view.objects),
    )
