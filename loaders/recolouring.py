"""Other pixel values for a training frame: exposure, noise, materials by region."""

from __future__ import annotations

import math

import numpy as np
from PIL import Image

from pliant.spec.arrays import FloatArray, Mask, Rgb


def recolour(rng: np.random.Generator, rgb: Rgb, strength: float, noise: float) -> Rgb:
    """Return an image with another exposure, tint and contrast, and noise.

    Args:
        rng: Source of randomness.
        rgb: uint8 (h, w, 3).
        strength: Spread of gain, offset and gamma.
        noise: Largest standard deviation of the pixel noise, of 255.
    """
    if strength > 0:
        gain = 1 + strength * rng.uniform(-1, 1, 3) * 0.5 + strength * rng.uniform(-1, 1)
        offset = strength * rng.uniform(-0.25, 0.25)
        gamma = math.exp(strength * rng.uniform(-1, 1))
        levels = np.arange(256)[:, None] / 255.0  # (256, 1): a table is cheaper than the image
        table = (np.clip(levels * gain + offset, 0, 1) ** gamma * 255).round().astype(np.uint8)
        rgb = np.stack([table[:, channel][rgb[..., channel]] for channel in range(3)], axis=-1)
    if noise > 0:
        sigma = rng.uniform(0, noise)
        noisy = rng.standard_normal(rgb.shape, dtype=np.float32)
        noisy *= np.float32(sigma)
        noisy += rgb
        rgb = noisy.clip(0, 255, out=noisy).astype(np.uint8)
    return rgb


def recolour_regions(
    rng: np.random.Generator,
    rgb: Rgb,
    mask: Mask,
    objects: Mask,
) -> Rgb:
    """Return the image with other colours for the queried object, other objects and background.

    In each region the deviations from its mean colour go through a random matrix, which mixes
    channels and may turn light into dark, and a new mean colour is added. Shading and texture
    keep their shape. Half of the backgrounds also get blotches.

    Args:
        rng: Source of randomness.
        rgb: uint8 (h, w, 3).
        mask: bool (h, w), the queried object.
        objects: bool (h, w), all objects.
    """
    pixels = rgb.reshape(-1, 3)
    planes = np.empty((3, len(pixels)), dtype=np.float32)  # numpy is slow along an axis of 3
    for region in (mask, objects & ~mask, ~objects & ~mask):
        at = np.flatnonzero(region)
        if len(at) == 0:
            continue
        mixing = rng.normal(0, 0.6, (3, 3)) + np.eye(3) * rng.integers(0, 2)
        colours = pixels.take(at, axis=0).T.astype(np.float32, order="C")  # (3, N)
        colours -= colours.mean(axis=1, keepdims=True)
        planes[:, at] = mixing @ colours + rng.uniform(20, 235, (3, 1))
    if rng.random() < 0.5:
        amount = rng.uniform(0, 0.4) * ~(objects | mask)  # (h, w)
        planes = planes + (amount * _blotches(rng, mask.shape)).reshape(3, -1)
    return np.ascontiguousarray(planes.clip(0, 255).astype(np.uint8).T).reshape(rgb.shape)


def _blotches(rng: np.random.Generator, shape: tuple[int, ...]) -> FloatArray:
    """Return smooth random colours about 0: float64 (3, h, w), -127.5 to 127.5."""
    cells = int(rng.integers(2, 12))
    coarse = Image.fromarray(rng.integers(0, 256, (cells, cells, 3), dtype=np.uint8))
    smooth = coarse.resize((shape[1], shape[0]), Image.Resampling.BICUBIC)
    return np.asarray(smooth).transpose(2, 0, 1).astype(np.float64, order="C") - 127.5
