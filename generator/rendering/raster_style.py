"""The `raster` style: our own renderer over the truth's mesh and rasteriser; no Blender.

Four samples a pixel, each shaded from the rasteriser's hit.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from pliant.generator.compiled import compiled
from pliant.generator.rendering.materials import (
    FIBRES,
    FIBRES_PER_M,
    WOVEN,
    Materials,
    materials,
    value_noise,
)
from pliant.generator.rendering.shadow import ShadowMap, shadow_map, sunlight
from pliant.generator.rendering.sky import openness, sky_maps, vertex_normals
from pliant.generator.rendering.srgb import encode_channel, encode_where
from pliant.generator.rendering.table import TableView
from pliant.generator.scene.appearance import Appearance
from pliant.generator.scene.camera import seen_window
from pliant.generator.scene.scene_object import Pose, SceneMesh, SceneObject
from pliant.generator.truth.frame_truth import FrameTruth
from pliant.generator.truth.rasteriser import Hits, Lens, rasterise_into
from pliant.spec.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray, Rgb
from pliant.spec.camera import Camera

SAMPLES: Final = 2
"""Samples a side of a pixel."""

_SHARE: Final = 1.0 / (SAMPLES * SAMPLES)

SUN_BOUNCE: Final = 0.4
"""Share of the blocked sky from which sunlight comes back; chosen against long exposures."""

_GLOSS: Final = 40.0


class RasterRenderer:
    """Renders with numba alone; one thread, and the same bytes everywhere.

    Args:
        size: Width and height, px.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        width, height = size
        self._hits = Hits.empty(height * SAMPLES, width * SAMPLES)

    def begin(self, scene_object: SceneObject, appearance: Appearance, camera: Camera) -> None:
        """Take what stays the same over a sequence."""
        self._camera = camera
        self._light = appearance.light
        self._mesh = SceneMesh.of(scene_object)
        self._materials = materials(scene_object, self._mesh, appearance)
        self._two_faced = any(part.double_sided for part in scene_object.parts)
        self._table = TableView(camera, appearance)

    def render(self, pose: Pose, truth: FrameTruth, rng: np.random.Generator | None = None) -> Rgb:
        """Render one frame as `Renderer` says; `rng` is not used."""
        world, faces, light = truth.world_vertices, self._mesh.faces, self._light
        normals = vertex_normals(world, faces)
        shadow, sky = shadow_map(world, faces, light), sky_maps(world)
        open_front = openness(world, normals, sky) * self._materials.crevice
        open_back = openness(world, -normals, sky) if self._two_faced else open_front
        camera = self._camera
        window = self._rasterise(world)
        linear, changed = self._table.under(shadow, sky, _hidden(self._hits, window, camera.size))
        out = self._table.encoded.copy()
        encode_where(changed, linear, out)
        view = _View(window, Lens.of(camera), camera.world_to_camera[:3, :3], camera.centre_m)
        lighting = _Lighting(
            np.asarray(light.sun_direction),
            np.asarray(light.sun_irradiance) / math.pi,
            np.asarray(light.sky_radiance),
            0.7 * self._table.reflected,
        )
        surface = _Surface(faces, normals, open_front, open_back)
        _shade(view, self._hits, surface, self._materials, lighting, shadow, linear, out)
        return out

    def _rasterise(self, world: FloatArray) -> IntArray:
        """Fill the sample buffers and return the window of pixels that the object can touch."""
        camera = self._camera
        local = camera.to_camera(world)
        uvz = camera.to_pixels(local)
        left, right, top, bottom = seen_window(camera, uvz) or (0, 0, 0, 0)
        rows, columns = (
            slice(first * SAMPLES, last * SAMPLES) for first, last in ((top, bottom), (left, right))
        )
        self._hits.triangle[rows, columns] = -1
        self._hits.depth_m[rows, columns] = np.inf
        lens = Lens.of(camera, SAMPLES)
        rasterise_into(local, uvz[:, :2] * SAMPLES, self._mesh.faces, lens, self._hits)
        return np.array([left, right, top, bottom])


class _View(NamedTuple):
    """The camera, and the window of pixels to shade.

    Attributes:
        window: int64 (4,), first and last column, first and last row (exclusive), px.
        lens: The lens of the image.
        rotation: float64 (3, 3), world to camera.
        eye: float64 (3,), world metres.
    """

    window: IntArray
    lens: Lens
    rotation: FloatArray
    eye: FloatArray


class _Lighting(NamedTuple):
    """Light as the shader needs it.

    Attributes:
        sun_direction: float64 (3,), towards the sun.
        sun: float64 (3,), irradiance over pi.
        sky: float64 (3,), radiance.
        ground: float64 (3,), radiance of the table.
    """

    sun_direction: FloatArray
    sun: FloatArray
    sky: FloatArray
    ground: FloatArray


class _Surface(NamedTuple):
    """The object's geometry in a frame.

    Attributes:
        faces: int32 (F, 3).
        normals: float64 (V, 3).
        open_front: float64 (V,), share of the sky on the outer side.
        open_back: float64 (V,), share of the sky on the back.
    """

    faces: Int32Array
    normals: FloatArray
    open_front: FloatArray
    open_back: FloatArray


@compiled
def _hidden(hits: Hits, window: IntArray, size: tuple[int, int]) -> BoolArray:
    """Return bool (H, W): pixels of a window whose samples all see the object."""
    triangle = hits.triangle
    hidden = np.zeros((size[1], size[0]), np.bool_)
    for row in range(window[2], window[3]):
        for column in range(window[0], window[1]):
            least = 0
            for sub in range(SAMPLES * SAMPLES):
                j = row * SAMPLES + sub // SAMPLES
                least = min(least, triangle[j, column * SAMPLES + sub % SAMPLES])
            hidden[row, column] = least >= 0
    return hidden


@compiled
def _mixed(
    values: FloatArray, corners: tuple[int, int, int], weights: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Interpolate a vertex vector inside a triangle."""
    a, b, c = corners
    w0, w1, w2 = weights
    return (
        w0 * values[a, 0] + w1 * values[b, 0] + w2 * values[c, 0],
        w0 * values[a, 1] + w1 * values[b, 1] + w2 * values[c, 1],
        w0 * values[a, 2] + w1 * values[b, 2] + w2 * values[c, 2],
    )


@compiled
def _ray(i: int, j: int, lens: Lens, rotation: FloatArray) -> tuple[float, float, float]:
    """Return the direction of a sample, in the world, per metre of depth."""
    dx = ((i + 0.5) / SAMPLES - lens.cx) / lens.fx
    dy = ((j + 0.5) / SAMPLES - lens.cy) / lens.fy
    return (
        rotation[0, 0] * dx + rotation[1, 0] * dy + rotation[2, 0],
        rotation[0, 1] * dx + rotation[1, 1] * dy + rotation[2, 1],
        rotation[0, 2] * dx + rotation[1, 2] * dy + rotation[2, 2],
    )


@compiled
def _woven(image: Float32Array, place: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the colour of a place on a cloth."""
    height, width = image.shape[0], image.shape[1]
    u = min(max(int(place[0] * width), 0), width - 1)
    v = min(max(int(place[1] * height), 0), height - 1)
    return float(image[v, u, 0]), float(image[v, u, 1]), float(image[v, u, 2])


@compiled
def _mottling(place: tuple[float, float, float], contrast: float) -> float:
    """Return the factor of a rope's colour at a place."""
    noise = value_noise(place[0] * FIBRES_PER_M, place[1] * FIBRES_PER_M, place[2] * FIBRES_PER_M)
    return 1.0 + 2.0 * contrast * (noise - 0.5)


@compiled
def _highlight(
    normal: tuple[float, float, float], ray: tuple[float, float, float], sun: FloatArray
) -> float:
    """Return the Blinn-Phong highlight of the sun, 0 to 1."""
    inverse = 1.0 / math.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2])
    hx = sun[0] - ray[0] * inverse
    hy = sun[1] - ray[1] * inverse
    hz = sun[2] - ray[2] * inverse
    inverse = 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
    along = (normal[0] * hx + normal[1] * hy + normal[2] * hz) * inverse
    return along**_GLOSS if along > 0.0 else 0.0


@compiled
def _add_radiance(
    total: FloatArray,
    colour: tuple[float, float, float],
    lit: float,
    gloss: float,
    open_: float,
    nz: float,
    light: _Lighting,
) -> None:
    """Add what a place sends to the camera to float64 (3,).

    Args:
        total: Added to.
        colour: Reflectance.
        lit: Share of the sun's irradiance.
        gloss: Highlight, a share of the same.
        open_: Share of the sky.
        nz: The normal's height.
        light: Sun and sky.
    """
    above = open_ * (0.5 + 0.5 * nz)
    below = open_ * (0.5 - 0.5 * nz)
    # Sky that is blocked comes back from the surface that blocks it, and so does the sun that
    # falls there.
    bounced = SUN_BOUNCE * (1.0 - open_) * light.sun_direction[2]
    for k in range(3):
        own = colour[k]
        total[k] += gloss * light.sun[k] + own * (
            (lit + bounced * own) * light.sun[k]
            + (above * light.sky[k] + below * light.ground[k]) / (1.0 - own * (1.0 - open_))
        )


@compiled
def _shade(
    view: _View,
    hits: Hits,
    surface: _Surface,
    material: Materials,
    light: _Lighting,
    shadow: ShadowMap,
    table: Float32Array,
    out: Rgb,
) -> None:
    """Shade the pixels of a window and write them over the table.

    Args:
        view: Camera and window.
        hits: Of an image with `SAMPLES` samples a side of a pixel; -1 is the table.
        surface: The object's geometry.
        material: Its materials.
        light: Sun and sky.
        shadow: What the sun sees.
        table: float32 (H, W, 3), the shadowed table, linear.
        out: uint8 (H, W, 3), written where the object is seen.
    """
    # Each look into a tuple of arrays in the loop would count a reference.
    window, lens, rotation, eye = view
    triangle, depth_m, weights = hits
    faces, normals, open_front, open_back = surface
    kinds, colours, _, places, two_faced, front, back, contrast, specular = material
    frame, sun_depth, coarse, texel_m, spread = shadow
    sun_direction = light.sun_direction
    total = np.empty(3)
    for row in range(window[2], window[3]):
        for column in range(window[0], window[1]):
            covered = 0
            total[:] = 0.0
            for sub in range(SAMPLES * SAMPLES):
                j = row * SAMPLES + sub // SAMPLES
                i = column * SAMPLES + sub % SAMPLES
                t = triangle[j, i]
                if t < 0:
                    continue
                covered += 1
                a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
                w1, w2 = weights[j, i, 0], weights[j, i, 1]
                w0 = 1.0 - w1 - w2
                rx, ry, rz = _ray(i, j, lens, rotation)
                depth = depth_m[j, i]
                x, y, z = eye[0] + depth * rx, eye[1] + depth * ry, eye[2] + depth * rz
                nx, ny, nz = _mixed(normals, (a, b, c), (w0, w1, w2))
                length = math.sqrt(nx * nx + ny * ny + nz * nz) + 1e-12
                nx, ny, nz = nx / length, ny / length, nz / length
                behind = two_faced[t] == 1 and nx * rx + ny * ry + nz * rz > 0.0
                if behind:
                    nx, ny, nz = -nx, -ny, -nz
                    open_ = w0 * open_back[a] + w1 * open_back[b] + w2 * open_back[c]
                else:
                    open_ = w0 * open_front[a] + w1 * open_front[b] + w2 * open_front[c]
                place = _mixed(places, (a, b, c), (w0, w1, w2))
                if kinds[t] == WOVEN:
                    colour = _woven(back, place) if behind else _woven(front, place)
                else:  # the first corner has the vertices' colour
                    factor = _mottling(place, contrast) if kinds[t] == FIBRES else 1.0
                    r, g, b_ = colours[a, 0], colours[a, 1], colours[a, 2]
                    colour = r * factor, g * factor, b_ * factor
                lit = nx * sun_direction[0] + ny * sun_direction[1] + nz * sun_direction[2]
                gloss = 0.0
                if lit > 0.0:
                    off = 2.0 * texel_m
                    x, y, z = x + off * nx, y + off * ny, z + off * nz
                    seen = sunlight(x, y, z, i, j, frame, sun_depth, coarse, texel_m, spread)
                    lit *= seen
                    if specular > 0.0 and seen > 0.0:
                        shine = _highlight((nx, ny, nz), (rx, ry, rz), sun_direction)
                        gloss = 0.35 * specular * seen * shine
                else:
                    lit = 0.0
                _add_radiance(total, colour, lit, gloss, open_, nz, light)
            rest = SAMPLES * SAMPLES - covered
            for k in range(3 if covered else 0):
                value = _SHARE * (total[k] + rest * table[row, column, k])
                out[row, column, k] = encode_channel(value)
