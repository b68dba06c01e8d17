"""Augmentations: colour, noise, rotation, masks; the truth moves with the pixels.

All geometry is one affine map of pixel coordinates, applied to the image by interpolation
and to the points exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.loaders.mask_damage import damaged, faulty
from pliant.loaders.recolouring import recolour, recolour_regions
from pliant.loaders.views import TrainingFrame
from pliant.spec.arrays import FloatArray, IndexArray, Mask, RealArray, Rgb
from pliant.spec.calls import check_type
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds, Share
from pliant.spec.model import Symmetry


class AugmentSettings(Settings):
    """What may happen to a training frame. Zero switches each off.

    Attributes:
        rotate_deg: Rotation about the object's centre, uniform within plus or minus this.
        scale: Relative size, log-uniform within 1/(1 + scale) to 1 + scale.
        margin: A moved object is made smaller where it must be to stay in the image, and laid
            anywhere in it, this share of the image's height (a rope's ball, a shadow) between
            its points and the border.
        colour: Gain, offset and gamma of each channel vary by about this share.
        noise: Standard deviation of pixel noise, uniform from 0 to this (of 255).
        recolour: Probability that the queried object, the other objects and the background each
            get other colours, so that a network learns no material.
        mask_faults: Probability that the masks given to the network are eroded, dilated or have
            holes; the masks that the losses use stay exact.
        mask_damage: Probability that they are damaged more: a ragged contour, larger holes, a
            second object in them, missing ends, a rope's ball in its own mask.
        mask_drop: Probability that the network gets no mask, and again that it gets the queried
            object's alone.
        picture_drop: Probability that the picture given to the network is one grey. A frame whose
            masks are dropped keeps its picture.
        symmetric: Probability that a cloth whose sides look alike is turned by a random number of
            quarter turns (with unequal sides: of half turns) and perhaps mirrored, and
            its material points renamed, so that it is upright again: another shape of a cloth from
            the same frame.
    """

    rotate_deg: Annotated[float, Bounds(0, 180)] = 180.0
    scale: Share = 0.0
    margin: Annotated[float, Bounds(0, 0.5, below=True)] = 0.06
    colour: Share = 0.2
    noise: Annotated[float, Bounds(0, 128, "of 255")] = 4.0
    recolour: Share = 0.0
    mask_faults: Share = 0.0
    mask_damage: Share = 0.0
    mask_drop: Annotated[float, Bounds(0, 0.5)] = 0.0
    picture_drop: Share = 0.0
    symmetric: Share = 0.0


def check_augmentation(augmentation: object) -> None:
    """Refuse what is neither `AugmentSettings` nor None.

    Raises:
        CallError: It is something else.
    """
    check_type(
        "augmentation",
        augmentation,
        (AugmentSettings, type(None)),
        required="AugmentSettings(...) or None",
    )


def rotation_about_centre(
    size: tuple[int, int], angle_rad: float, scale: float = 1.0
) -> FloatArray:
    """Return the map of pixel coordinates that turns an image about its centre.

    Args:
        size: (w, h).
        angle_rad: Positive turns u towards v (clockwise on the screen).
        scale: Relative size.

    Returns:
        float64 (2, 3): new (u, v) = M (u, v, 1).
    """
    cos, sin = scale * math.cos(angle_rad), scale * math.sin(angle_rad)
    linear = np.array([[cos, -sin], [sin, cos]])
    centre = np.array(size) / 2.0
    return np.column_stack([linear, centre - linear @ centre])


def placement_in_image(
    rng: np.random.Generator,
    points_px: RealArray,
    size: tuple[int, int],
    angle_rad: float,
    scale: float,
    margin_px: float,
    first: FloatArray | None = None,
) -> FloatArray:
    """Return a map that turns points about their middle and lays them anywhere in the image.

    A rope across a wide image, turned upright about the image's centre, would lose both ends
    and with them what tells one from the other.

    Args:
        rng: Source of randomness.
        points_px: float (P, 2), P >= 1, what must stay in the image.
        size: (w, h).
        angle_rad: Positive turns u towards v.
        scale: Relative size wanted; smaller where the points do not fit.
        margin_px: What stays free between the points and the border.
        first: float64 (2, 2), an orthogonal map before the turn, or None.

    Returns:
        float64 (2, 3): new (u, v) = M (u, v, 1).
    """
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    turn = np.array([[cos, -sin], [sin, cos]])
    if first is not None:
        turn = turn @ first
    turned = points_px.astype(np.float64) @ turn.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    free = np.array(size) - 2 * margin_px
    factor = min(scale, *(free / np.maximum(high - low, 1e-9)))
    room = (free - factor * (high - low)).clip(0) / 2
    middle = np.array(size) / 2 + rng.uniform(-1, 1, 2) * room
    return np.column_stack([factor * turn, middle - factor * (low + high) / 2])


def warp_view(view: TrainingFrame, affine: FloatArray) -> TrainingFrame:
    """Return a frame moved by an affine map of its pixel coordinates.

    The image is interpolated bilinearly, mask and depth take the nearest pixel, the points
    are mapped exactly; a point that leaves the image is no longer visible. What comes in from
    outside has the mean colour of the image's border and no object.

    Args:
        view: The frame.
        affine: float64 (2, 3), new (u, v) = M (u, v, 1).
    """
    height, width = view.mask.shape
    inverse = _inverse(affine)
    # Pillow evaluates the map at pixel centres (x + 0.5, y + 0.5): our own convention.
    coefficients = tuple(float(value) for value in inverse.ravel())
    size = (width, height)

    def moved(
        array: npt.NDArray[Any], method: int, outside: float | tuple[int, ...]
    ) -> Image.Image:
        return Image.fromarray(array).transform(
            size, Image.Transform.AFFINE, coefficients, resample=method, fillcolor=outside
        )

    nearest = Image.Resampling.NEAREST
    rgb = np.asarray(moved(view.rgb, Image.Resampling.BILINEAR, view.border_rgb))
    masks = np.asarray(moved(view.mask + 2 * view.objects.astype(np.uint8), nearest, 0))
    depth_m = np.asarray(moved(view.depth_m, nearest, math.inf))
    uv = (view.uv_px.astype(np.float64) @ affine[:, :2].T + affine[:, 2]).astype(np.float32)
    inside = (uv >= 0).all(axis=1) & (uv < size).all(axis=1)
    return replace(
        view,
        rgb=rgb,
        mask=(masks & 1) > 0,
        objects=(masks & 2) > 0,
        depth_m=depth_m,
        uv_px=uv,
        visible=view.visible & inside,
    )


def _inverse(affine: FloatArray) -> FloatArray:
    """Return the inverse map, float64 (2, 3), in closed form."""
    (a, b, _), (c, d, _) = affine
    linear = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return np.column_stack([linear, -linear @ affine[:, 2]])


def symmetry_in_image(symmetry: Symmetry) -> FloatArray:
    """Return how an upright cloth moves in the image where a symmetry moves its material.

    Upright is with the first material coordinate to the right and the second one up, as
    generated cloths are.

    Args:
        symmetry: One of the square's.

    Returns:
        float64 (2, 2), orthogonal, for directions (u, v) in the image.
    """
    up = np.diag([1.0, -1.0])
    return up @ np.array(symmetry.matrix, float) @ up


def renamed(view: TrainingFrame, partners: IndexArray) -> TrainingFrame:
    """Return a frame in which each surface point has the name of its partner.

    Args:
        view: The frame.
        partners: int (P,), a permutation: the new row of each point.
    """
    rows = np.argsort(partners)
    return replace(view, uv_px=view.uv_px[rows], visible=view.visible[rows])


def draw_placement(
    rng: np.random.Generator,
    views: Sequence[TrainingFrame],
    settings: AugmentSettings,
    first: FloatArray | None = None,
) -> FloatArray | None:
    """Draw one map of pixel coordinates for all of some frames.

    Args:
        rng: Source of randomness.
        views: The frames; what any of them shows of the object stays in the image.
        settings: What may happen.
        first: float64 (2, 2), an orthogonal map before any other, or None.

    Returns:
        float64 (2, 3), new (u, v) = M (u, v, 1); None where nothing is to move.
    """
    if settings.rotate_deg == 0 and settings.scale == 0 and first is None:
        return None
    height, width = views[0].mask.shape
    angle = math.radians(rng.uniform(-settings.rotate_deg, settings.rotate_deg))
    factor = math.exp(rng.uniform(-1, 1) * math.log1p(settings.scale))
    seen = np.concatenate([view.uv_px[view.visible] for view in views])
    if len(seen) == 0:
        return rotation_about_centre((width, height), angle, factor)
    margin_px = settings.margin * height
    return placement_in_image(rng, seen, (width, height), angle, factor, margin_px, first)


def augment(
    rng: np.random.Generator,
    view: TrainingFrame,
    settings: AugmentSettings,
    affine: FloatArray | None,
) -> TrainingFrame:
    """Return a randomly changed frame, its truth changed along.

    Args:
        rng: Source of randomness.
        view: The frame.
        settings: What may happen.
        affine: float64 (2, 3), the map that moves the frame (`draw_placement`), or None.
    """
    if affine is not None:
        view = warp_view(view, affine)
    rgb = view.rgb
    if settings.recolour > 0 and rng.random() < settings.recolour:
        rgb = recolour_regions(rng, rgb, view.mask, view.objects)
    return replace(view, rgb=recolour(rng, rgb, settings.colour, settings.noise))


def given_masks(
    rng: np.random.Generator, view: TrainingFrame, settings: AugmentSettings
) -> tuple[Mask | None, Mask | None]:
    """Return the masks that the network is given in a training step.

    Args:
        rng: Source of randomness.
        view: The frame with its exact masks.
        settings: How often masks are missing or faulty.

    Returns:
        The queried object's mask and the mask of all objects, bool (h, w) each, or None.
    """
    mask, objects = view.mask, view.objects
    if settings.mask_faults > 0 and rng.random() < settings.mask_faults:
        mask, objects = faulty(rng, mask, objects)
    if settings.mask_damage > 0 and rng.random() < settings.mask_damage:
        mask, objects = damaged(rng, mask, objects)
    if settings.mask_drop > 0:
        draw = rng.random()
        if draw < settings.mask_drop:
            return None, None
        if draw < 2 * settings.mask_drop:
            return mask, None
    return mask, objects


def given_picture(
    rng: np.random.Generator,
    rgb: Rgb,
    mask: Mask | None,
    settings: AugmentSettings,
) -> Rgb:
    """Return the picture that the network is given in a training step.

    Args:
        rng: Source of randomness.
        rgb: uint8 (h, w, 3).
        mask: bool (h, w), the mask that it is given, or None: the picture is then all it has.
        settings: How often the picture is missing.
    """
    if mask is None or settings.picture_drop == 0 or rng.random() >= settings.picture_drop:
        return rgb
    return np.full_like(rgb, rng.integers(256))
