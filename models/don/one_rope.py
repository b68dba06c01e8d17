"""The strands of one rope, in a mask found in a picture that also shows cables or other ropes.

The network for masks finds everything that looks like a rope. Where its mask cannot be that of one
rope, the strands of its skeleton are compared: those of one rope have one width and one colour
relative to the table around them, so that the edge of a shadow may cross them. The rope is the
largest group of strands that are alike, those at the ball before others.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from scipy import ndimage

from pliant.baselines.tracing import MaskShape, Skeleton, half_width_px
from pliant.models.don.table import log_ratio_to_table
from pliant.spec.arrays import Float32Array, FloatArray, Mask, Rgb
from pliant.spec.io.resizing import with_longer_side

# Set on 24 validation pictures of ropes next to cloths, ropes and cables.
_SIDE: Final = 640  # pixels of the longer side of a picture as it is read here
_ALIKE_WIDTH: Final = 1.35
_ALIKE_COLOUR: Final = 1.0  # distance of tint and light, log r
_STRANDS: Final = 80
_LEAST_LENGTH: Final = 4.0  # of a strand whose colour counts, in half widths
_AT_BALL: Final = 3.0  # half widths between a ball and its rope
_BALL_WEIGHT: Final = 10.0  # of strands at a ball: a small one may be a speck of something else
_ROUND: Final = 1.45  # area of a ball over that of the largest disc in it
_BODY: Final = 1.7  # half widths around a strand that are its own


def of_one_rope(rgb: Rgb, rope: Mask, ball: Mask | None) -> tuple[Mask, Mask | None]:
    """Return what belongs to one rope; a mask that is already one of a rope comes back itself.

    Args:
        rgb: uint8 (H, W, 3), sRGB.
        rope: bool (H, W), what looks like a rope.
        ball: bool (H, W), what looks like its ball, or None.

    Returns:
        bool (H, W), the rope, and the ball, or None where that is not round.
    """
    if not MaskShape.of(rope, None if ball is None else rope | ball).several_ropes:
        return rope, ball
    shape = with_longer_side(rope.shape, _SIDE)
    small = resized(rope, shape)
    picture = np.asarray(cv2.resize(rgb, shape[::-1], interpolation=cv2.INTER_AREA), np.uint8)
    small_ball = None if ball is None else resized(ball, shape)
    if small_ball is not None and not _is_round(small_ball):
        small_ball = ball = None
    kept = _kept(picture, small, small_ball)
    return rope & resized(kept, rope.shape), ball


def resized(mask: Mask, shape: tuple[int, ...]) -> Mask:
    """Return a mask at another size (height, width), with smooth edges."""
    grey = mask.astype(np.uint8) * 255
    return cv2.resize(grey, shape[::-1], interpolation=cv2.INTER_LINEAR) > 127


def _is_round(ball: Mask) -> bool:
    radius = float(ndimage.distance_transform_edt(np.pad(ball, 1)).max())
    return bool(ball.sum() <= _ROUND * np.pi * radius**2)


def _kept(picture: Rgb, rope: Mask, ball: Mask | None) -> Mask:
    """Return the pixels of the rope's own strands, and of its crossings."""
    depth: FloatArray = ndimage.distance_transform_edt(rope)
    half_px = half_width_px(depth[rope])
    skeleton = Skeleton.of(rope, half_px, _STRANDS) if rope.any() else None
    if skeleton is None or len(skeleton.strands) < 2:
        return rope
    colour = _colour(picture, rope, half_px)
    places = [skeleton.in_mask(strand.line).astype(np.int64).T[::-1] for strand in skeleton.strands]
    half = np.array([np.median(depth[tuple(at)]) for at in places])
    strand_colour = np.array([np.median(colour[tuple(at)], axis=0) for at in places])
    length = np.array([len(strand.line) / skeleton.scale for strand in skeleton.strands])
    telling = length >= _LEAST_LENGTH * half
    if telling.sum() < 2:
        return rope
    alike = np.abs(np.log(half[:, None] / half)) < np.log(_ALIKE_WIDTH)
    alike &= np.linalg.norm(strand_colour[:, None] - strand_colour, axis=2) < _ALIKE_COLOUR
    weight = alike @ (length * half) * telling
    if ball is not None and ball.any():
        away = ndimage.distance_transform_edt(~ball)
        beside = np.array([away[tuple(at)].min() <= _AT_BALL * half_px for at in places])
        weight[alike @ (beside & telling)] *= _BALL_WEIGHT
    best = int(weight.argmax())
    own = alike[best] & telling
    nodes = {node for k in np.flatnonzero(own) for node in skeleton.strands[k].nodes}
    own |= alike[best] & [bool(nodes & set(strand.nodes)) for strand in skeleton.strands]
    if own.all():
        return rope
    return rope & _drawn(skeleton, own, rope.shape, float(half[best]))


def _colour(rgb: Rgb, rope: Mask, half_px: float) -> Float32Array:
    """Return the rope's mean colour around every pixel, relative to the table.

    Returns:
        float32 (H, W, 4), the tint and the light of `log_ratio_to_table`, which do not change
        where a shadow begins.
    """
    light, tint = log_ratio_to_table(rgb, ~rope)
    side = max(3, int(half_px))
    differs = np.concatenate([tint, light[..., None]], axis=2).astype(np.float32)
    shown = cv2.blur(rope.astype(np.float32), (side, side))
    seen = cv2.blur(differs * rope[..., None], (side, side))
    return np.asarray(seen / np.maximum(shown, 1e-3)[..., None])


def _drawn(skeleton: Skeleton, own: Mask, shape: tuple[int, ...], half_px: float) -> Mask:
    """Return some strands at their width, joined where they meet: bool, of a shape."""
    lines = []
    ends: dict[int, list[FloatArray]] = {}
    for k in np.flatnonzero(own):
        strand = skeleton.strands[k]
        line = skeleton.in_mask(strand.line)
        lines.append(line)
        for end in (0, 1):
            ends.setdefault(strand.nodes[end], []).append(line[-end])
    for meeting in ends.values():
        middle = np.mean(meeting, axis=0)
        lines += [np.stack([end, middle]) for end in meeting]
    canvas = np.zeros(shape, np.uint8)
    width = round(2 * (_BODY * half_px + 1))
    drawn = [(line - 0.5).round().astype(np.int32) for line in lines]
    cv2.polylines(canvas, drawn, isClosed=False, color=(1,), thickness=width)
    return canvas > 0
