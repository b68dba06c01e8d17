"""The layers of a picture: colour, depth, index colours, mask, and what a method makes of it.

Heat maps are small pictures that a browser lays over the target.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.baselines.matcher import Heat
from pliant.evaluator.report.colours import depth_image, index_image, material_colours
from pliant.spec.arrays import FloatArray, Rgb
from pliant.spec.frame import Frame
from pliant.spec.io.photo import encoded
from pliant.spec.queries import RecordedPair
from pliant.spec.sequence import RecordedFrame
from pliant.viewer.drawing import dimmed, heat_range
from pliant.viewer.explorer.live import LiveMethod
from pliant.viewer.explorer.submissions import Method
from pliant.viewer.explorer.truth import TruthFinder

FRAME_LAYERS: Final = ("rgb", "depth", "index", "mask")
"""Layers of a frame alone."""

METHOD_LAYERS: Final = ("descriptors", "canonical", "error")
"""Layers that a method makes; `error` is of a pair and is drawn on the source."""

ERROR_SCALE_PX: Final = (1.0, 100.0)
"""Errors at the two ends of the colours, which are logarithmic."""

_ERROR_POINTS: Final = 500
_DARK: Final = 18
_HIDDEN_GREY: Final = 165

_WIDEST_PX: Final = 320


def frame_layer(frame: RecordedFrame, layer: str) -> Rgb | None:
    """Return a layer of a frame, uint8 (H, W, 3), or None where the dataset does not have it.

    Args:
        frame: The frame.
        layer: One of `FRAME_LAYERS`.
    """
    if layer == "rgb":
        return frame.rgb
    if layer == "mask":
        if frame.mask is None:
            return None
        out = np.full((*frame.mask.shape, 3), _DARK, np.uint8)
        if frame.objects is not None:
            out[frame.objects] = 110
        out[frame.mask] = 235
        return out
    if layer == "depth":
        return None if frame.depth_m is None else depth_image(frame.depth_m)
    surface = frame.surface
    return None if surface is None else index_image(surface, frame.sequence.described)


def method_layer(
    truth: TruthFinder, method: Method, pair: RecordedPair, layer: str, *, of_target: bool
) -> Rgb | None:
    """Return a layer that a method makes, uint8 (H, W, 3), or None where it has none.

    Args:
        truth: The truth of any pixel.
        method: The method.
        pair: The frames; the colours of descriptors are those of both.
        layer: One of `METHOD_LAYERS`.
        of_target: Whether the target is shown; `error` is of the source alone.
    """
    if not isinstance(method, LiveMethod):
        return None
    if layer == "error":
        return None if of_target else _error_map(truth, method, pair)
    if layer == "descriptors":
        return _descriptor_colours(method, (pair.source, pair.target), int(of_target))
    return _canonical_colours(method, pair.target if of_target else pair.source)


def _descriptor_colours(method: LiveMethod, views: Sequence[Frame], shown: int) -> Rgb | None:
    """Return the first three principal components of both views' descriptors as colours."""
    found = [described for view in views if (described := method.descriptors(view)) is not None]
    if len(found) < 2:
        return None
    maps, masks = zip(*found, strict=True)
    rgb = np.rint(255 * descriptor_colours(maps, masks)[shown]).astype(np.uint8)
    rgb[~masks[shown]] = _DARK
    return _enlarged(rgb, views[shown])


def _canonical_colours(method: LiveMethod, frame: RecordedFrame) -> Rgb | None:
    """Return what the method's canonical head reads off each pixel, in index colours."""
    found = method.canonical(frame)
    if found is None:
        return None
    material, mask = found
    rgb = np.full((*mask.shape, 3), _DARK, np.uint8)
    m = material[mask]
    colours = material_colours(m[:, 0], m[:, 1], frame.sequence.described)
    rgb[mask] = np.rint(255 * colours)
    return _enlarged(rgb, frame)


def _enlarged(rgb: Rgb, view: Frame) -> Rgb:
    return np.asarray(Image.fromarray(rgb).resize(view.size, Image.Resampling.NEAREST))


def _error_map(truth: TruthFinder, method: LiveMethod, pair: RecordedPair) -> Rgb | None:
    """Return the source in grey, with the error of points that the target shows as colours.

    Points that the target hides are light grey.
    """
    view = pair.source
    if view.mask is None:
        return None
    uv = _grid(view.mask, _ERROR_POINTS)
    true_px = truth.places(pair.at(uv))
    keep = np.isfinite(true_px[:, 0])
    if not keep.any():
        return None
    answers = method.answers(pair.at(uv[keep]))
    error = np.full(len(uv), np.nan)
    error[keep] = np.linalg.norm(answers - true_px[keep], axis=1)
    out = dimmed(view.rgb)
    rows, columns = np.nonzero(view.mask)
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(uv).query(np.stack([columns, rows], axis=1) + 0.5)
    shown = error[nearest]
    known = np.isfinite(shown)
    out[rows, columns] = _HIDDEN_GREY
    out[rows[known], columns[known]] = error_colours(shown[known])
    return out


def error_colours(error_px: FloatArray) -> Rgb:
    """Return the colours of errors, uint8 (N, 3): logarithmic between the ends of the scale."""
    from matplotlib import colormaps

    low, high = np.log(ERROR_SCALE_PX)
    share = (np.log(np.maximum(error_px, 1e-6)) - low) / (high - low)
    return np.rint(255 * colormaps["turbo"](0.06 + 0.9 * share.clip(0, 1))[:, :3]).astype(np.uint8)


def _grid(mask: npt.NDArray[np.bool_], count: int) -> FloatArray:
    """Return about `count` pixel centres spread over a mask, float64 (N, 2)."""
    step = max(1, round(float(np.sqrt(np.count_nonzero(mask) / count))))
    rows, columns = np.nonzero(mask)
    on = (rows % step == 0) & (columns % step == 0)
    return np.stack([columns[on], rows[on]], axis=1) + 0.5


def png(rgb: Rgb) -> bytes:
    """Return a picture as a PNG."""
    return encoded(Image.fromarray(rgb), "PNG", compress_level=1)


def heat_png(heat: Heat) -> bytes:
    """Return a heat map as a palette PNG: no belief is transparent, the peak is opaque.

    Args:
        heat: The heat map, of the size of the target.

    Returns:
        A PNG of at most 320 pixels in width.
    """
    step = -(-heat.values.shape[1] // _WIDEST_PX)
    values = heat.values[step // 2 :: step, step // 2 :: step]
    level = np.zeros(values.shape, np.uint8)  # 0 where the method does not look
    known = np.isfinite(values)
    if known.any():
        low, high = heat_range(replace(heat, values=values))
        share = (values[known].astype(np.float64) - low) / max(high - low, 1e-12)
        level[known] = np.rint(1 + 254 * share.clip(0, 1))
    colours, alpha = _palette()
    picture = Image.fromarray(level, "P")
    picture.putpalette(colours)
    return encoded(picture, "PNG", transparency=alpha, compress_level=1)


@cache
def _palette() -> tuple[bytes, bytes]:
    """Return 256 colours of the map `inferno`, and their opacity."""
    from matplotlib import colormaps

    share = np.linspace(0, 1, 255)
    rgb: npt.NDArray[np.uint8] = np.zeros((256, 3), np.uint8)
    rgb[1:] = np.rint(255 * colormaps["inferno"](0.15 + 0.85 * share)[:, :3])
    alpha = np.zeros(256, np.uint8)
    alpha[1:] = np.rint(70 + 165 * share)
    return rgb.tobytes(), alpha.tobytes()


def descriptor_colours(
    maps: Sequence[npt.NDArray[np.floating[Any]]], masks: Sequence[npt.NDArray[np.bool_]]
) -> list[npt.NDArray[np.float64]]:
    """Return descriptors on the object as RGB, by their first three principal components.

    Args:
        maps: float32 (h, w, D), descriptors of several frames.
        masks: bool (h, w), the object in each.

    Returns:
        float64 (h, w, 3), 0 to 1, white off the object; the same colours in all frames.
    """
    on = np.concatenate([m[mask] for m, mask in zip(maps, masks, strict=True)]).astype(np.float64)
    if len(on) == 0:
        return [np.ones((*mask.shape, 3)) for mask in masks]
    centred = on - on.mean(axis=0)
    directions = np.linalg.svd(centred, full_matrices=False)[2][:3]
    projected = np.zeros((len(on), 3))  # of fewer than three dimensions, the others are constant
    projected[:, : len(directions)] = centred @ directions.T
    low, high = np.percentile(projected, [2, 98], axis=0)
    colours = np.clip((projected - low) / np.where(high > low, high - low, 1.0), 0.0, 1.0)
    pictures = [np.ones((*mask.shape, 3)) for mask in masks]
    ends = np.cumsum([np.count_nonzero(mask) for mask in masks])
    for picture, mask, own in zip(pictures, masks, np.split(colours, ends[:-1]), strict=True):
        picture[mask] = own
    return pictures
