"""Image noise, added after rendering; truth and tables never change.

In this order: edge dropout, blur, Poisson (shot) noise, Gaussian (read) noise, salt and pepper,
JPEG. The edge dropout is the kind that depth cameras show on thin objects: pixels near the
object's outline take the colour of the background beyond it, in patches chosen by Perlin noise.
"""

from __future__ import annotations

import io
import math

import numpy as np
from PIL import Image
from scipy.ndimage import binary_erosion, gaussian_filter

from pliant.generator.settings.scene import NoiseSettings
from pliant.spec.arrays import BoolArray, FloatArray, Rgb
from pliant.spec.io.exr import Surface


def apply_noise(
    rng: np.random.Generator, rgb: Rgb, surface: Surface, settings: NoiseSettings
) -> Rgb:
    """Add noise to one frame.

    Args:
        rng: Source of every random number of this frame.
        rgb: uint8 (H, W, 3), sRGB; not changed.
        surface: The frame's surface image; it says where the outlines are.
        settings: The strengths.

    Returns:
        uint8 (H, W, 3), sRGB.
    """
    gaussian = rng.uniform(*settings.gaussian)
    photons = rng.uniform(*settings.photons)
    salt_pepper = rng.uniform(*settings.salt_pepper)
    dropout = rng.uniform(*settings.dropout)
    image = rgb
    if dropout > 0.0 and settings.dropout_px > 0:
        image = _drop_edges(
            rng, image, surface.object_id > 0, dropout, settings.dropout_px,
            settings.dropout_scale_px,
        )  # fmt: skip
    values = image.astype(np.float32)
    if settings.blur_px[1] > 0.0:
        sigma = rng.uniform(*settings.blur_px)
        values = gaussian_filter(values, (sigma, sigma, 0.0), mode="nearest")
    if photons > 0.0:
        values = rng.poisson(values * (photons / 255.0)).astype(np.float32) * (255.0 / photons)
    if gaussian > 0.0:
        values += rng.standard_normal(values.shape, np.float32) * np.float32(gaussian)
    noisy = np.clip(np.rint(values), 0, 255).astype(np.uint8)
    if salt_pepper > 0.0:
        chance = rng.random(noisy.shape[:2])
        noisy[chance < salt_pepper / 2] = 0
        noisy[chance > 1.0 - salt_pepper / 2] = 255
    if settings.jpeg_quality is not None:
        low, high = settings.jpeg_quality
        noisy = _compressed(noisy, int(rng.integers(low, high + 1)))
    return noisy


def _compressed(rgb: Rgb, quality: int) -> Rgb:
    """Return an image as JPEG gives it back, with colours at half resolution."""
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "JPEG", quality=quality, subsampling="4:2:0")
    return np.asarray(Image.open(buffer))


def perlin_noise(rng: np.random.Generator, height: int, width: int, scale_px: float) -> FloatArray:
    """Return gradient noise (Perlin 1985, with the quintic fade of 2002).

    Args:
        rng: Source of the gradients.
        height: Rows.
        width: Columns.
        scale_px: Distance of the lattice points, px.

    Returns:
        float64 (height, width), about -0.7 to 0.7, mean 0, 0 on the lattice.
    """
    y, x = np.arange(height) / scale_px, np.arange(width) / scale_px
    rows, columns = math.floor(y[-1]) + 2, math.floor(x[-1]) + 2
    turn = rng.uniform(0.0, 2 * np.pi, (rows, columns))
    gradient = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    j, i = np.floor(y).astype(int)[:, None], np.floor(x).astype(int)[None, :]
    fy, fx = y[:, None] - j, x[None, :] - i

    def corner(dj: int, di: int) -> FloatArray:
        slope = gradient[j + dj, i + di]
        return np.asarray(slope[..., 0] * (fx - di) + slope[..., 1] * (fy - dj))

    wx, wy = (f**3 * (f * (6 * f - 15) + 10) for f in (fx, fy))
    above = corner(0, 0) * (1 - wx) + corner(0, 1) * wx
    below = corner(1, 0) * (1 - wx) + corner(1, 1) * wx
    return np.asarray(above * (1 - wy) + below * wy)


def _drop_edges(
    rng: np.random.Generator,
    rgb: Rgb,
    mask: BoolArray,
    share: float,
    reach_px: int,
    scale_px: float,
) -> Rgb:
    """Overwrite object pixels near the outline, in patches, with the nearest background."""
    patches = perlin_noise(rng, mask.shape[0], mask.shape[1], scale_px)
    inside = mask.copy()
    out = rgb.copy()
    rings = []
    for _ in range(reach_px):  # peel the object layer by layer
        core = binary_erosion(inside, border_value=1)
        rings.append(inside & ~core)
        inside = core
    edge = np.logical_or.reduce(rings)
    if not edge.any():
        return out
    lost = edge & (patches > np.quantile(patches[edge], 1.0 - share))
    # Background creeps in from outside, a ring at a time.
    known = ~mask
    for ring in rings:
        todo = ring & lost
        rows, columns = np.nonzero(todo)
        total = np.zeros((len(rows), 3))
        count = np.zeros((len(rows), 1))
        for dj, di in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            r = np.clip(rows + dj, 0, mask.shape[0] - 1)
            c = np.clip(columns + di, 0, mask.shape[1] - 1)
            from_known = known[r, c][:, None]
            total += out[r, c] * from_known
            count += from_known
        found = count[:, 0] > 0
        at = rows[found], columns[found]
        out[at] = np.rint(total[found] / count[found]).astype(np.uint8)
        known[at] = True
    return out
