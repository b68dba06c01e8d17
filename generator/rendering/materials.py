"""What surfaces are made of: textures, colours and materials, for the shaders of all styles.

The raster style reads these arrays; the Blender styles get them as image textures and vertex
attributes.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from pliant.generator.compiled import compiled, inlined
from pliant.generator.scene.appearance import Appearance, TableAppearance
from pliant.generator.scene.scene_object import SceneMesh, SceneObject
from pliant.spec.arrays import BoolArray, Float32Array, FloatArray

Image = Float32Array

WEAVE_THREADS = 96
"""Periods of the weave along u; along v as many as give threads of about the same width."""

_STRIPE = (0.72, 0.84)
"""Where a towel's stripe across u begins and ends."""

_SIDE_STRIPE = (0.14, 0.21)
"""Where its stripe along one side, across v, begins and ends."""

_HEM = 0.03
"""Width of a towel's hem over its length along u."""

_SHOWS_THROUGH = 0.3
"""Share of a print that is seen on the back."""


@inlined
def _corner(x: int, y: int, z: int) -> float:
    """Hash a lattice point to 0..1."""
    n = (x * 73856093) ^ (y * 19349663) ^ (z * 83492791)
    n = n & 0xFFFFFFFF
    n = ((n ^ (n >> 13)) * 1274126177) & 0xFFFFFFFF
    n = ((n ^ (n >> 16)) * 668265263) & 0xFFFFFFFF
    return ((n >> 8) & 0xFFFF) / 65535.0


@compiled
def value_noise(x: float, y: float, z: float) -> float:
    """Return smooth noise, 0 to 1, with features of about one unit.

    Args:
        x: Place.
        y: Place.
        z: Place.
    """
    xi, yi, zi = math.floor(x), math.floor(y), math.floor(z)
    fx, fy, fz = x - xi, y - yi, z - zi
    fx = fx * fx * (3.0 - 2.0 * fx)
    fy = fy * fy * (3.0 - 2.0 * fy)
    fz = fz * fz * (3.0 - 2.0 * fz)
    ix, iy, iz = int(xi), int(yi), int(zi)
    total = 0.0
    for dz in range(2):
        wz = fz if dz else 1.0 - fz
        for dy in range(2):
            wy = wz * (fy if dy else 1.0 - fy)
            total += wy * (1.0 - fx) * _corner(ix, iy + dy, iz + dz)
            total += wy * fx * _corner(ix + 1, iy + dy, iz + dz)
    return total


@compiled
def _table_factors(
    xy: FloatArray, wood: bool, contrast: float, scale: float, angle: float, shift: float
) -> FloatArray:
    out = np.empty(xy.shape[0])
    c, s = math.cos(angle), math.sin(angle)
    for n in range(xy.shape[0]):
        x = (c * xy[n, 0] + s * xy[n, 1]) / scale
        y = (c * xy[n, 1] - s * xy[n, 0]) / scale
        if wood:
            # Long grain: rings, bent by slow noise, over fine streaks.
            bend = value_noise(0.6 * x, 0.9 * y, shift)
            ring = y * 1.6 + 1.8 * bend
            ring = abs(2.0 * (ring - math.floor(ring)) - 1.0)
            streak = value_noise(1.2 * x, 14.0 * y, shift + 7.3)
            f = 0.55 * (ring * ring * (3.0 - 2.0 * ring)) + 0.45 * streak
        else:
            f = 0.55 * value_noise(x, y, shift)
            f += 0.30 * value_noise(2.3 * x + 5.1, 2.3 * y, shift + 3.7)
            f += 0.15 * value_noise(5.1 * x, 5.1 * y + 1.9, shift + 9.1)
        out[n] = 1.0 + contrast * (f - 0.5)
    return out


def table_reflectance(table: TableAppearance, xy_m: FloatArray) -> FloatArray:
    """Return the table's colour at places on it.

    Args:
        table: The table's appearance.
        xy_m: float64 (N, 2), world metres.

    Returns:
        float64 (N, 3), linear reflectance, 0 to 0.95.
    """
    colour = np.asarray(table.colour)
    if table.kind == "plain":
        return np.broadcast_to(colour, (len(xy_m), 3)).copy()
    factors = _table_factors(
        np.ascontiguousarray(xy_m, np.float64),
        table.kind == "wood",
        table.contrast,
        table.scale_m,
        table.angle_rad,
        0.37 + table.seed % 4096,
    )
    return np.clip(colour * factors[:, None], 0.0, 0.95)


def cloth_images(
    appearance: Appearance, proportion: float = 1.0, width: int = 768
) -> tuple[Image, Image]:
    """Return what is woven into a cloth, front and back.

    Args:
        appearance: The appearance of a cloth sequence.
        proportion: The cloth's length along v over its length along u.
        width: Width of the images, px.

    Returns:
        Two float32 (height, width, 3) images of linear reflectance, as high as the proportion says;
        row k is v = (k + 0.5) / height, column k is u = (k + 0.5) / width.
    """
    ground, second, third = (np.asarray(colour) for colour in appearance.cloth_colours)
    height = round(width * proportion)
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    front = np.broadcast_to(ground, (height, width, 3)).astype(np.float64)
    back = np.broadcast_to(np.asarray(appearance.back_colour), front.shape).astype(np.float64)
    if appearance.pattern == "towel":
        end = (u > _STRIPE[0]) & (u < _STRIPE[1])
        stripe = end | ((v > _SIDE_STRIPE[0]) & (v < _SIDE_STRIPE[1]))
        hem = (np.abs(u - 0.5) > 0.5 - _HEM) | (np.abs(v - 0.5) > 0.5 - _HEM / proportion)
        front[stripe], back[stripe] = second, ground
        front[hem] = back[hem] = third
    elif appearance.pattern.startswith("printed "):
        design = int(appearance.pattern.removeprefix("printed "))
        front = printed(front, (second, third), design)
        back += _SHOWS_THROUGH * (front - back)
    # Even in u and in v, about the middle too, and on a square under their exchange.
    across = round(WEAVE_THREADS * proportion)
    weave = np.cos(2 * np.pi * WEAVE_THREADS * u) * np.cos(2 * np.pi * across * v)
    shade = (1.0 - appearance.weave_contrast * (0.5 - 0.5 * weave))[..., None]
    return (front * shade).astype(np.float32), (back * shade).astype(np.float32)


PLAIN, FIBRES, WOVEN = 0, 1, 2
"""What a triangle's colour is: the vertices', the vertices' mottled by fibres, the cloth's."""

FIBRES_PER_M: Final = 700.0
"""Frequency of the fibres' mottling."""


class Materials(NamedTuple):
    """The surfaces of a sequence.

    Attributes:
        surface: uint8 (F,), `PLAIN`, `FIBRES` or `WOVEN`.
        colour: float64 (V, 3), reflectance.
        crevice: float64 (V,), share of the sky left in the gaps between strands.
        place: float64 (V, 3), where the fibres' noise or the cloth's image is read.
        two_faced: uint8 (F,), 1 where the back can be seen.
        front: float32 (H, W, 3), the cloth's front.
        back: float32 (H, W, 3), its back.
        fibre_contrast: Strength of the mottling.
        specular: Strength of highlights.
    """

    surface: npt.NDArray[np.uint8]
    colour: FloatArray
    crevice: FloatArray
    place: FloatArray
    two_faced: npt.NDArray[np.uint8]
    front: Float32Array
    back: Float32Array
    fibre_contrast: float
    specular: float


def materials(scene_object: SceneObject, mesh: SceneMesh, appearance: Appearance) -> Materials:
    """Work out the surfaces of a scene object under an appearance."""
    surface = np.zeros(len(mesh.faces), np.uint8)
    two_faced = np.zeros(len(mesh.faces), np.uint8)
    count = mesh.parts[-1][2].stop
    colour, place, crevice = np.ones((count, 3)), np.zeros((count, 3)), np.ones(count)
    front = back = np.ones((1, 1, 3), np.float32)
    for part, faces, rows in mesh.parts:
        two_faced[faces] = part.double_sided
        if part.name == "rope":
            surface[faces] = FIBRES
            colour[rows] = np.asarray(appearance.strand_colours)[part.strand]
            place[rows] = fibre_places(part.rest)
            crevice[rows] = strand_crevices(part.rest, len(appearance.strand_colours))
        elif part.colour is not None:
            colour[rows] = part.colour
        elif scene_object.kind == "cloth":
            surface[faces] = WOVEN
            place[rows, :2] = part.chart(part.rest)
            front, back = cloth_images(appearance, scene_object.proportion)
        else:
            colour[rows] = appearance.ball_colour
    return Materials(
        surface,
        colour,
        crevice,
        place,
        two_faced,
        front,
        back,
        appearance.fibre_contrast,
        appearance.specular,
    )


def fibre_places(rest: FloatArray) -> FloatArray:
    """Return where a rope's fibre noise is read: the same for a point and its reversal.

    Args:
        rest: float64 (V, 3): s * L, a, b, metres. The reversal is (L - s L, a, -b).
    """
    middle = (rest[:, 0].min() + rest[:, 0].max()) / 2
    return np.stack([np.abs(rest[:, 0] - middle), rest[:, 1], np.abs(rest[:, 2])], axis=1)


def strand_crevices(rest: FloatArray, strands: int) -> FloatArray:
    """Return the share of the sky that the neighbouring strands leave, by depth in the rope."""
    if strands == 1:
        return np.ones(len(rest))
    radius = np.hypot(rest[:, 1], rest[:, 2])
    return np.asarray(np.clip((radius / radius.max() - 0.45) / 0.5, 0.5, 1.0) ** 0.8)


_SHAPES: Final = (4, 12)
_SIZE: Final = (0.03, 0.2)
"""Fewest and most shapes of a print, and their smallest and largest half width, in sides."""

_PRINT_HEM: Final = (0.015, 0.04)
_STITCH: Final = 90.0  # stitches along a side
_TAG: Final = (0.06, 0.035)  # half its length and half its width


def printed(ground: FloatArray, colours: tuple[FloatArray, FloatArray], design: int) -> FloatArray:
    """Return a print: stripes or checks on some, discs, bars and rings, a stitched hem, a tag.

    Args:
        ground: float64 (h, w, 3), what it is printed on; row k is v = (k + 0.5) / h, column k
            is u = (k + 0.5) / w.
        colours: float64 (3,) each, two colours other than the ground's.
        design: Number of the design; the same one has the same shapes in every colour.
    """
    rng = np.random.default_rng([0x7072696E74, design])
    height, width = ground.shape[:2]
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    second, third = colours
    out = ground.copy()
    _mix(out, _regular(rng, u, v), second, rng.uniform(0.3, 0.8))
    for number in range(int(rng.integers(_SHAPES[0], _SHAPES[1] + 1))):
        _mix(out, _shape(rng, u, v), third if number % 2 else second, 1.0)
    if rng.random() < 0.7:
        _hem(rng, out, u, v, second)
    if rng.random() < 0.7:
        place = rng.uniform(0.1, 0.9), rng.uniform(0.05, 0.1)
        tag = (np.abs(u - place[0]) < _TAG[0]) & (np.abs(v - place[1]) < _TAG[1])
        _mix(out, tag, third, 1.0)
    return out


def _mix(out: FloatArray, where: BoolArray, colour: FloatArray, share: float) -> None:
    """Put a share of a colour onto places of an image."""
    out[where] += share * (colour - out[where])


def _regular(rng: np.random.Generator, u: FloatArray, v: FloatArray) -> BoolArray:
    """Draw stripes along either side, checks, or nothing regular."""
    kind = rng.integers(5)
    periods, filled = rng.uniform(4, 14, 2), rng.uniform(0.2, 0.6)
    across, along = (u * periods[0]) % 1 < filled, (v * periods[1]) % 1 < filled
    stripes: tuple[BoolArray, ...] = (across, along, across ^ along)
    return stripes[kind] if kind < len(stripes) else np.zeros(u.shape, np.bool_)


def _shape(rng: np.random.Generator, u: FloatArray, v: FloatArray) -> BoolArray:
    """Draw a disc, a ring or a bar somewhere on the cloth."""
    kind = rng.integers(3)
    middle, size = rng.uniform(0.08, 0.92, 2), rng.uniform(*_SIZE)
    angle, slim = rng.uniform(-np.pi, np.pi), rng.uniform(0.15, 0.6)
    x, y = u - middle[0], v - middle[1]
    radius = np.hypot(x, y)
    if kind == 0:
        return np.asarray(radius < size)
    if kind == 1:
        return np.asarray((radius < size) & (radius > size * (1 - slim)))
    along = x * np.cos(angle) + y * np.sin(angle)
    across = y * np.cos(angle) - x * np.sin(angle)
    return np.asarray((np.abs(along) < size) & (np.abs(across) < size * slim))


def _hem(
    rng: np.random.Generator, out: FloatArray, u: FloatArray, v: FloatArray, thread: FloatArray
) -> None:
    """Draw a hem, a little darker, with a line of stitches along its inner edge."""
    wide = rng.uniform(*_PRINT_HEM)
    inside = 0.5 - np.maximum(np.abs(u - 0.5), np.abs(v - 0.5))  # from the nearest edge
    out[inside < wide] *= 0.85
    along = np.where(np.abs(u - 0.5) > np.abs(v - 0.5), v, u)
    stitch = (np.abs(inside - wide) < 0.004) & ((along * _STITCH) % 1 < 0.6)
    _mix(out, stitch, thread, 1.0)
