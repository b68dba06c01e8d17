"""What a network sees of a frame: grey, colour or depth, and the masks that come with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy import ndimage

from pliant.spec.arrays import BoolArray, Float32Array, Mask, Rgb
from pliant.spec.errors import CallError

InputKind = Literal["rgb", "grey", "contrast", "depth"]

IMAGE_CHANNELS: Final[dict[str, tuple[str, ...]]] = {
    "rgb": ("red", "green", "blue"),
    "grey": ("grey",),
    "contrast": ("grey",),
    "depth": ("depth",),
}
"""The image channels of each kind of input, in order."""

MASK_CHANNELS: Final = ("mask", "objects")
"""The two channels of `masks`: the queried object, and all objects."""

DEPTH_SCALE_M: Final = 0.1
"""One unit of the depth channel, metres."""

_DEPTH_LIMIT: Final = 3.0


@dataclass(frozen=True)
class NetworkInput:
    """Which channels a network sees.

    Attributes:
        kind: The image: `rgb`, `grey`, `contrast` (the grey that tells the colours of the queried
            object apart, see `contrast_weights`) or `depth`.
        masks: Whether two mask channels follow. A network that sees only grey and masks works on
            materials that training never showed.
    """

    kind: InputKind = "rgb"
    masks: bool = False

    def __post_init__(self) -> None:
        if self.kind not in IMAGE_CHANNELS:
            raise CallError(
                "unknown kind of network input",
                where="input",
                found=repr(self.kind),
                required="one of " + ", ".join(IMAGE_CHANNELS),
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels, in order."""
        return IMAGE_CHANNELS[self.kind] + (MASK_CHANNELS if self.masks else ())

    @property
    def channels(self) -> int:
        """Number of channels C."""
        return len(self.names)

    @property
    def colour(self) -> bool:
        """Whether the input is computed from the colour image, otherwise from the depth map."""
        return self.kind != "depth"

    def image(
        self,
        rgb: Rgb | None,
        depth_m: Float32Array | None,
        mask: BoolArray | None = None,
        objects: BoolArray | None = None,
    ) -> Float32Array:
        """Return a frame's channels.

        A colour or grey value becomes (value / 255 - 0.5) * 4, about zero mean and unit spread.
        Depth becomes the distance behind the objects' median, in units of 0.1 m, within -3 to 3;
        background is 3. A mask becomes 1 inside and -1 outside, and 0 everywhere if it is None.

        Args:
            rgb: uint8 (h, w, 3); may be None for `depth`.
            depth_m: float32 (h, w), +inf is background; may be None unless `kind` is `depth`.
            mask: bool (h, w), the queried object, or None where it is not given.
            objects: bool (h, w), any object, or None where it is not given.

        Returns:
            float32 (C, h, w).

        Raises:
            CallError: The image that the kind needs is None.
        """
        if self.colour:
            if rgb is None:
                raise CallError("this network needs a colour image; none is given", where="rgb")
            values = rgb.astype(np.float32) * (4 / 255) - 2
            if self.kind == "rgb":
                planes = [values.transpose(2, 0, 1)]
            else:
                weights = contrast_weights(rgb, mask) if self.kind == "contrast" else LUMA
                planes = [(values @ weights)[None]]
        else:
            if depth_m is None:
                raise CallError("this network needs a depth map; none is given", where="depth_m")
            planes = [_depth_plane(depth_m)[None]]
        if self.masks:
            shape = planes[0].shape[-2:]
            planes += [_mask_plane(given, shape)[None] for given in (mask, objects)]
        return np.concatenate(planes)


def _depth_plane(depth_m: Float32Array) -> Float32Array:
    finite = np.isfinite(depth_m)
    middle = float(np.median(depth_m[finite])) if finite.any() else 0.0
    scaled = np.where(finite, (depth_m - middle) / DEPTH_SCALE_M, _DEPTH_LIMIT)
    return np.clip(scaled, -_DEPTH_LIMIT, _DEPTH_LIMIT).astype(np.float32)


def _mask_plane(mask: BoolArray | None, shape: tuple[int, ...]) -> Float32Array:
    if mask is None:
        return np.zeros(shape, dtype=np.float32)
    return np.where(mask, np.float32(1), np.float32(-1))


LUMA: Final = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Weights of red, green and blue in luminance (ITU-R BT.601)."""

_WEIGHTS: Final = np.array(
    [(r, g, 10 - r - g) for r in range(11) for g in range(11 - r)], dtype=np.float32
) / np.float32(10)
# Set once; validation towels, not each value, say that they are good enough.
_PAIRS: Final = 2000
_LEAST_PAIRS: Final = 20
_ENOUGH: Final = 50.0  # of 255
_RIM_SHARE: Final = 1 / 200  # of the width: a mask's rim may show the table
_OTHER_COLOUR: Final = 0.15
_DARK: Final = 10.0  # added to m: the chromaticity of dark pixels is noise


def contrast_weights(rgb: Rgb, mask: Mask | None) -> Float32Array:
    """Return the weights of red, green and blue that tell the colours of an object apart.

    Colours of the same luminance are one grey: a stripe of such a colour is lost, and with it what
    tells a towel's sides apart. So the weights are chosen for each picture: at least 0, in steps of
    a tenth, their sum 1, as in Lu, Xu and Jia, Contrast Preserving Decolorization (2012). Best are
    those with the largest

        sum over pairs (i, j) of min(|g_i - g_j|, 50),

    of pixels i and j of the object, drawn at random, whose chromaticities (r - m) / m, with m the
    mean of r, g and b, differ. The limit keeps one large difference (a hem) from hiding the others;
    pairs of one colour, which differ by shading alone, do not count.

    Args:
        rgb: uint8 (h, w, 3).
        mask: bool (h, w), the object; None takes the whole picture.

    Returns:
        float32 (3,); those of luminance where there is one colour.
    """
    shown = np.ones(rgb.shape[:2], np.bool_)
    if mask is not None:
        rim = max(1, round(_RIM_SHARE * rgb.shape[1]))
        inner = ndimage.binary_erosion(mask, iterations=rim)
        shown = inner if inner.any() else mask
    colours = rgb[shown].astype(np.float32)
    if len(colours) == 0:
        return LUMA
    one, other = colours[np.random.default_rng(0).integers(len(colours), size=(2, _PAIRS))]
    differ = np.abs(_chromaticity(one) - _chromaticity(other)).sum(axis=1) > _OTHER_COLOUR
    if differ.sum() < _LEAST_PAIRS:
        return LUMA
    gaps = np.abs((one - other)[differ] @ _WEIGHTS.T)  # (pairs, weights)
    best: Float32Array = _WEIGHTS[np.minimum(gaps, _ENOUGH).sum(axis=0).argmax()]
    return best


def _chromaticity(colours: Float32Array) -> Float32Array:
    mean = colours.mean(axis=1, keepdims=True)
    return (colours - mean) / (mean + np.float32(_DARK))
