"""Masks of an object in an image without any: the network's foreground, sharpened by colour.

A network knows about where the object is: a `MaskNetwork`, or else the descriptor network, whose
foreground is coarser. Nearby, every pixel is compared with the table around the
object, r = I / I_table in linear light: a shadow darkens all channels alike, so log r is then
negative and has no chroma. What is not a shadow is divided by GrabCut (Rother et al. 2004) in the
chroma and the mean of log r; where the network is sure, whatever the colour. In a grey picture, and
on a table with a pattern of many colours, the network decides alone. `ball.py` tells the ball from
the rope.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import cv2
import numpy as np
from scipy import ndimage, special

from pliant.baselines.conditions import noise_of
from pliant.models.don.ball import BallNetwork, ball_in
from pliant.models.don.one_cloth import of_one_cloth
from pliant.models.don.one_rope import of_one_rope, resized, smaller
from pliant.models.don.table import log_ratio_to_table
from pliant.spec.arrays import Float32Array, FloatArray, Mask, Rgb
from pliant.spec.ball import separate_ball
from pliant.spec.io.resizing import with_longer_side

_WORKING_SIDE: Final = 320
_SURE, _CERTAIN, _POSSIBLE = 0.95, 0.45, 0.12  # foreground probabilities of the network
_DECIDED: Final = 0.9  # certainty
_NEVER: Final = 0.001  # least probability
_LEAST_ROPE: Final = 0.2
_MARGIN_PX: Final = 4
_DARKEST: Final = -2.5
_NO_CHROMA, _CHROMA = 0.2, 0.4  # of log r: below a shadow, above an object
_COLOURLESS: Final = 0.1  # of log r: the chroma of a grey picture
_AS_COLOURFUL: Final = 0.5  # chroma of the table's pattern, of the object's: colour says too little
_NO_LIGHT, _LIGHT = 0.1, 0.5  # of the mean of log r, likewise
_ROUNDS: Final = 2
_LEAST_PART: Final = 0.05  # of the largest part
_LEAST_KNOWN_PART: Final = 0.02  # such as the end of a rope that is seen on a cover's other side
_KNOWN: Final = 0.5  # mean probability
_LEAST_PIXELS: Final = 40


def rope_masks(
    rgb: Rgb, rope: Float32Array, objects: Float32Array, ball: BallNetwork | None
) -> tuple[Mask, Mask | None] | None:
    """Return where the rope is seen, and where the rope or its ball is.

    Args:
        rgb: uint8 (H, W, 3), sRGB.
        rope: float32 (h, w), a network's probability that a pixel shows the rope.
        objects: float32 (h, w), that it shows the rope or its ball.
        ball: Finds the ball; without it, a ball is what is thick and round.

    Returns:
        Two bool (H, W); None instead of the second where no ball is found, which may be there all
        the same; None where nothing stands out from the table.
    """
    shape = rgb.shape[:2]
    seen = shown(rgb, np.maximum(rope, objects))
    if seen is None:
        return None
    if ball is None:
        disc = seen & ~separate_ball(seen)[0]
    else:
        disc = ball_in(picture_as(seen, rgb), seen, ball)
    found = resized(seen & ~disc, shape)
    if max(rope.shape) > _WORKING_SIDE:  # it knows the edges better than the smaller picture
        found &= cv2.resize(rope, shape[::-1], interpolation=cv2.INTER_LINEAR) > _LEAST_ROPE
    found, kept = of_one_rope(rgb, found, resized(disc, shape) if disc.any() else None)
    return found, None if kept is None else found | kept


def picture_as(mask: Mask, rgb: Rgb) -> Float32Array:
    """Return a picture at the size of a mask (h, w), float32 (h, w, 3), 0 to 1."""
    return np.asarray(smaller(rgb, mask.shape), dtype=np.float32) / 255


def cloth_mask(rgb: Rgb, cloth: Float32Array) -> Mask | None:
    """Return where one cloth is seen, bool (H, W), or None where nothing stands out from the table.

    Args:
        rgb: uint8 (H, W, 3), sRGB.
        cloth: float32 (h, w), the network's probability that a pixel shows the cloth.
    """
    seen = shown(rgb, cloth, _LEAST_PART)
    if seen is None:
        return None
    seen = np.asarray(ndimage.binary_fill_holes(seen))
    return resized(of_one_cloth(smaller(rgb, seen.shape), seen), rgb.shape[:2])


def cloth_probability(masks: Float32Array, descriptors: Callable[[], Float32Array]) -> Float32Array:
    """Return the mask probabilities of a network for masks; where it is not certain, of two.

    Prints and tables unlike those of its training make it uncertain. The descriptor network has
    other errors there, so the mean of their log odds is better than either.

    Args:
        masks: float32 (h, w), of the network for masks, that a pixel shows the cloth.
        descriptors: Computes those of the descriptor network, float32 (h', w'), where needed.
    """
    certainty = _certainty(masks)
    if certainty > _DECIDED:
        return masks
    coarse = descriptors()
    if certainty == 0.0:  # it finds nothing
        return coarse
    finer = cv2.resize(coarse, masks.shape[::-1], interpolation=cv2.INTER_LINEAR)
    both = np.stack([masks, finer]).clip(_NEVER, 1 - _NEVER)
    return np.asarray(special.expit(special.logit(both).mean(axis=0)), dtype=np.float32)


def _certainty(likely: Float32Array) -> float:
    """Return how far probabilities that are not small are from one half, 0 to 1."""
    possible = likely[likely > _POSSIBLE]
    return float(np.abs(2 * possible - 1).mean()) if possible.size else 0.0


def shown(rgb: Rgb, likely: Float32Array, least_known: float = _LEAST_KNOWN_PART) -> Mask | None:
    """Return where objects are seen, or None where there are none.

    Args:
        rgb: uint8 (H, W, 3), sRGB.
        likely: float32 (h, w), the probability that a pixel shows one.
        least_known: Least area of parts whose mean probability is above 0.5, of the largest part.

    Returns:
        bool, with 320 pixels along its longer side.
    """
    size = with_longer_side(rgb.shape[:2], _WORKING_SIDE)[::-1]
    p: FloatArray = cv2.resize(likely, size, interpolation=cv2.INTER_LINEAR).astype(np.float64)
    near = ndimage.binary_dilation(p > _POSSIBLE, np.ones((3, 3)), iterations=_MARGIN_PX)
    if not (p > _CERTAIN).any() or near.all():
        return None
    objects = _without_specks(_cut(smaller(rgb, p.shape), p, near), p, least_known)
    return objects if objects.sum() >= _LEAST_PIXELS else None


def _cut(rgb: Rgb, p: FloatArray, near: Mask) -> Mask:
    """Return the foreground: what GrabCut finds, or the network where colours do not help."""
    light, tint = log_ratio_to_table(rgb, ~near)
    chroma = np.linalg.norm(tint, axis=-1)
    if np.percentile(chroma[near], 90) < _COLOURLESS and np.abs(light[near]).max() > _NO_LIGHT:
        return p > 0.5  # in a grey picture, all that is darker than the table looks like shadow
    # A table with grain, noise or a pattern varies by itself: what an object is must exceed that.
    usual_chroma = np.percentile(chroma[~near], 90)
    if usual_chroma > max(_NO_CHROMA, _AS_COLOURFUL * np.median(chroma[p > _CERTAIN])):
        return p > 0.5
    usual_light = np.percentile(np.abs(light[~near]), 95)
    shadow = (chroma < max(_NO_CHROMA, 1.3 * usual_chroma)) & (light > _DARKEST)
    shadow &= light < max(_NO_LIGHT, usual_light)
    stands_out = (chroma > max(_CHROMA, 3 * usual_chroma)) | (light > max(_LIGHT, 2 * usual_light))
    labels = np.full(near.shape, cv2.GC_BGD, dtype=np.uint8)
    labels[near] = cv2.GC_PR_BGD
    labels[(p > _CERTAIN) | (near & stands_out)] = cv2.GC_PR_FGD
    labels[shadow] = cv2.GC_BGD
    labels[p > _SURE] = cv2.GC_FGD  # a strand with the table's colour would count as a shadow
    if not np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD)).any():
        return np.zeros_like(near)
    features = [tint[..., 0] * 80 + 128, tint[..., 2] * 80 + 128, light * 40 + 80]
    image = np.stack(features, axis=-1).clip(0, 255).astype(np.uint8)
    table, rope = np.zeros((1, 65)), np.zeros((1, 65))  # GrabCut's mixtures
    cv2.setRNGSeed(0)
    cv2.grabCut(image, labels, (0, 0, 1, 1), table, rope, _ROUNDS, cv2.GC_INIT_WITH_MASK)
    return np.asarray((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD))


def _without_specks(mask: Mask, p: FloatArray, least_known: float) -> Mask:
    """Return a mask without its small parts; those that the network knows may be smaller."""
    parts, count = ndimage.label(mask, np.ones((3, 3)))
    if count == 0:
        return mask
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    known = ndimage.mean(p, parts, np.arange(count + 1)) > _KNOWN
    least = np.where(known, least_known, _LEAST_PART)
    return np.asarray((sizes > least * sizes.max())[parts])


_LIMIT: Final = 3.0  # grey levels; cameras in good light have 1 to 2
_BLUR_PX: Final = 1.0


def denoised(rgb: Rgb) -> Rgb:
    """Return a picture smoothed by a median and a Gaussian, or as it is where it has no noise.

    GrabCut compares single pixels, and noise makes the table as colourful as an object.

    Args:
        rgb: uint8 (H, W, 3), sRGB.
    """
    if noise_of(rgb) < _LIMIT:
        return rgb
    smooth = cv2.GaussianBlur(cv2.medianBlur(rgb, 3), (0, 0), _BLUR_PX)
    return np.asarray(smooth, dtype=np.uint8)
