"""The strands of one rope, in a mask found in a picture that also shows cables or other ropes.

The network for masks finds everything that looks like a rope. The strands of its skeleton are
compared: those of one rope have one width, one tint, which a shadow does not change, about one
light and one texture. The rope is the largest group of strands that are alike, those at the ball
before others, and what meets it and looks like it. Gaps and holes that are narrow for the rope,
such as the second colour of a twisted one, do not divide strands.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from scipy import ndimage

from pliant.baselines.tracing import MaskShape, Skeleton, half_width_px
from pliant.models.don.ball import is_round
from pliant.models.don.table import log_colour
from pliant.spec.arrays import FloatArray, IntArray, Mask, Rgb
from pliant.spec.ball import without_small_holes
from pliant.spec.io.resizing import with_longer_side

# Set on validation pictures of ropes next to cloths, ropes and cables (240 and 24).
_SIDE: Final = 640  # pixels of the longer side of a picture as it is read here
_ALIKE: Final = 0.45  # distance of two strands of one rope
_LIGHT, _DETAIL, _WIDTH = 0.25, 0.2, 0.7  # weights of logarithms in it; the tint's is 1
_LEAST_DETAIL: Final = 0.02
_UNLIKE, _LONG = 0.7, 6.0  # distance and length, half widths, of a strand surely not the rope's
_ONE_ROPE: Final = 0.9  # of a mask that could be that of one rope; less belongs to another
_INNER: Final = 0.4  # half widths from the edge
_CROWDED: Final = 3.0  # times the rope's width, where several of its strands meet
_NARROW: Final = 0.5  # half widths; gaps of twice that are closed
_STRANDS: Final = 80
_LEAST_LENGTH: Final = 4.0  # of a strand whose look counts first, in half widths
_LEAST_STUB: Final = 3.0  # square half widths of a short one that is alone
_AT_BALL: Final = 3.0  # half widths between a ball and its rope
_BALL_WEIGHT: Final = 3.0  # of strands at a ball: a small one may be a speck of something else


def of_one_rope(rgb: Rgb, rope: Mask, ball: Mask | None) -> tuple[Mask, Mask | None]:
    """Return what belongs to one rope; a mask that is already one of a rope comes back itself.

    Args:
        rgb: uint8 (H, W, 3), sRGB.
        rope: bool (H, W), what looks like a rope.
        ball: bool (H, W), what looks like its ball, or None.

    Returns:
        bool (H, W), the rope, and the ball, or None where that is not round.
    """
    several = MaskShape.of(rope, None if ball is None else rope | ball).several_ropes
    shape = with_longer_side(rope.shape, _SIDE)
    small = resized(rope, shape)
    picture = smaller(rgb, shape)
    small_ball = None if ball is None else resized(ball, shape)
    if several and small_ball is not None and not is_round(small_ball):
        small_ball = ball = None
    kept, foreign = _kept(picture, small, small_ball)
    if not several and kept.sum() > _ONE_ROPE * small.sum():
        if not foreign.any():
            return rope, ball
        kept = ~foreign
    return rope & resized(kept, rope.shape), ball


def resized(mask: Mask, shape: tuple[int, ...]) -> Mask:
    """Return a mask at another size (height, width), with smooth edges."""
    grey = mask.astype(np.uint8) * 255
    return cv2.resize(grey, shape[::-1], interpolation=cv2.INTER_LINEAR) > 127


def smaller(rgb: Rgb, shape: tuple[int, ...]) -> Rgb:
    """Return a picture at a smaller size (height, width), each pixel the mean of those it shows."""
    return np.asarray(cv2.resize(rgb, shape[::-1], interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _kept(picture: Rgb, rope: Mask, ball: Mask | None) -> tuple[Mask, Mask]:
    """Return the pixels of the rope's own strands and crossings, and of what is surely not its."""
    body = _without_narrow_gaps(rope)
    if ball is not None:
        body &= ~ball
    none = np.zeros_like(rope)
    if not body.any():
        return rope, none
    depth: FloatArray = ndimage.distance_transform_edt(body)
    half_px = half_width_px(depth[body])
    skeleton = Skeleton.of(body, half_px, _STRANDS)
    if len(skeleton.strands) < 2:
        return rope, none
    places = [skeleton.in_mask(strand.line).astype(np.int64).T[::-1] for strand in skeleton.strands]
    half = np.array([np.median(depth[tuple(at)]) for at in places])
    length = np.array([len(strand.line) / skeleton.scale for strand in skeleton.strands])
    degree = np.bincount([node for strand in skeleton.strands for node in strand.nodes])
    alone = np.array([max(degree[list(each.nodes)]) == 1 for each in skeleton.strands])
    for k in np.flatnonzero(alone & (length < 2 * _LEAST_LENGTH * half)):
        half[k] = depth[tuple(places[k])].max()  # much of it is near its ends, which are less deep
    telling = length >= _LEAST_LENGTH * half
    if not telling.any() or (telling | alone).sum() < 2:
        return rope, none
    label = _nearest(places, body.shape)
    stub = alone & (np.bincount(label[body], minlength=len(half)) > _LEAST_STUB * half_px**2)
    inner = body & (depth > _INNER * half[label])
    look = _looks(picture, label, inner, half)
    apart = np.linalg.norm(look[:, None] - look, axis=2)
    width = np.log(half[:, None] / half)
    alike = np.hypot(apart, _WIDTH * width) < _ALIKE
    weight = alike @ (length * half) * telling
    if ball is not None and ball.any():
        away = ndimage.distance_transform_edt(~ball)
        beside = np.array([away[tuple(at)].min() <= _AT_BALL * half_px for at in places])
        weight[alike @ (beside & telling)] *= _BALL_WEIGHT
    best = int(weight.argmax())
    crowded = (width[:, best] > 0) & (width[:, best] < np.log(_CROWDED))
    fitting = alike[best] | (crowded & (apart[best] < _ALIKE))
    own = _with_neighbours(skeleton, alike[best] & (telling | stub), fitting)
    if telling.sum() < 2:  # nothing else is known of the strands that are connected
        own |= ~alone
    unlike = np.hypot(apart[best], _WIDTH * width[best]) > _UNLIKE
    foreign = ~own & (alone | unlike & (length > _LONG * half))
    return rope & own[label], rope & foreign[label]


def _nearest(places: list[IntArray], shape: tuple[int, ...]) -> IntArray:
    """Return the number of the strand, given its (rows, columns), nearest to each pixel."""
    label = np.zeros(shape, dtype=np.int64)
    for number, at in enumerate(places):
        label[tuple(at)] = number + 1
    nearest = ndimage.distance_transform_edt(
        label == 0, return_distances=False, return_indices=True
    )
    return np.asarray(label[tuple(nearest)] - 1)


def _looks(picture: Rgb, label: IntArray, inner: Mask, half: FloatArray) -> FloatArray:
    """Return what each strand looks like, weighted for distances between strands.

    Args:
        picture: uint8 (H, W, 3), sRGB.
        label: int64 (H, W), the number of the strand that a pixel belongs to.
        inner: bool (H, W), pixels away from edges.
        half: float64 (N,), half of the strands' widths, pixels.

    Returns:
        float64 (N, 5): the mean tint, which a shadow does not change; the mean light; the
        logarithm of the light's variation within a strand, such as that of a twisted rope.
    """
    light, tint = log_colour(picture)
    sigma_px = max(1.0, float(np.median(half)))
    detail = light - cv2.GaussianBlur(light, (0, 0), sigma_px)
    count = np.maximum(np.bincount(label[inner], minlength=len(half)), 1)

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(label[inner], values[inner], minlength=len(half)) / count

    varied = np.log(np.sqrt(mean(detail**2)) + _LEAST_DETAIL)
    means = [mean(tint[..., channel]) for channel in range(3)]
    return np.stack([*means, _LIGHT * mean(light), _DETAIL * varied], axis=1)


def _without_narrow_gaps(rope: Mask) -> Mask:
    """Return a mask without the gaps and holes in it that are narrow for its strands."""
    half_px = half_width_px(ndimage.distance_transform_edt(rope)[rope])
    reach = max(1, round(_NARROW * half_px))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    padded = np.pad(rope, 2 * reach).astype(np.uint8)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc)
    return without_small_holes(closed[2 * reach : -2 * reach, 2 * reach : -2 * reach] > 0)


def _with_neighbours(skeleton: Skeleton, own: Mask, fitting: Mask) -> Mask:
    """Return some strands and those fitting ones that are connected with them, bool (strands,)."""
    while True:
        nodes = {node for k in np.flatnonzero(own) for node in skeleton.strands[k].nodes}
        meeting = [bool(nodes & set(strand.nodes)) for strand in skeleton.strands]
        grown = own | (fitting & meeting)
        if (grown == own).all():
            return own
        own = grown
