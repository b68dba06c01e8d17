"""Shading of the object for the `raster` style: four samples a pixel over the rasteriser's hits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from numba import njit

from pliant.generator.rendering.patterns import cloth_images, value_noise
from pliant.generator.rendering.shadow import sunlight
from pliant.generator.rendering.srgb import encode_channel
from pliant.generator.scene.appearance import Appearance
from pliant.generator.scene.scene_mesh import SceneMesh
from pliant.generator.scene.scene_object import FloatArray, IntArray, SceneObject

SAMPLES: Final = 2
"""Samples a side of a pixel."""

PLAIN, FIBRES, WOVEN = 0, 1, 2
"""What a triangle's colour is: the vertices', the vertices' mottled by fibres, the cloth's."""

FIBRES_PER_M: Final = 700.0
"""Frequency of the fibres' mottling."""

SUN_BOUNCE: Final = 0.4
"""Share of the blocked sky from which sunlight comes back; chosen against long exposures."""

_GLOSS: Final = 40.0


@dataclass(frozen=True)
class Materials:
    """What the shader knows of the surfaces, for a whole sequence.

    Attributes:
        surface: uint8 (F,), `PLAIN`, `FIBRES` or `WOVEN`.
        colour: float64 (V, 3), reflectance.
        crevice: float64 (V,), share of the sky left in the gaps between strands.
        place: float64 (V, 3), where the fibres' noise or the cloth's image is read.
        two_faced: uint8 (F,), 1 where the back can be seen.
        front: float32 (T, T, 3), the cloth's front.
        back: float32 (T, T, 3), its back.
        fibre_contrast: Strength of the mottling.
        specular: Strength of highlights.
    """

    surface: npt.NDArray[np.uint8]
    colour: FloatArray
    crevice: FloatArray
    place: FloatArray
    two_faced: npt.NDArray[np.uint8]
    front: npt.NDArray[np.float32]
    back: npt.NDArray[np.float32]
    fibre_contrast: float
    specular: float


def materials(scene_object: SceneObject, mesh: SceneMesh, appearance: Appearance) -> Materials:
    """Work out the surfaces of a scene object under an appearance."""
    surface = np.zeros(len(mesh.faces), np.uint8)
    two_faced = np.zeros(len(mesh.faces), np.uint8)
    count = mesh.vertex_starts[-1]
    colour, place, crevice = np.ones((count, 3)), np.zeros((count, 3)), np.ones(count)
    front = back = np.ones((1, 1, 3), np.float32)
    for k, part in enumerate(scene_object.parts):
        faces = slice(mesh.face_starts[k], mesh.face_starts[k + 1])
        rows = slice(mesh.vertex_starts[k], mesh.vertex_starts[k + 1])
        two_faced[faces] = part.double_sided
        if part.name == "rope":
            surface[faces] = FIBRES
            colour[rows] = np.asarray(appearance.strand_colours)[part.strand]
            place[rows] = fibre_places(part.rest)
            crevice[rows] = strand_crevices(part.rest, len(appearance.strand_colours))
        elif scene_object.kind == "cloth":
            surface[faces] = WOVEN
            place[rows, :2] = part.chart(part.rest)
            front, back = cloth_images(appearance)
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
    share: FloatArray = np.clip((radius / radius.max() - 0.45) / 0.5, 0.5, 1.0) ** 0.8
    return share


@njit(cache=True, nogil=True)
def shade(
    window: npt.NDArray[np.int64],
    triangle: IntArray,
    depth: FloatArray,
    weights: FloatArray,
    faces: IntArray,
    normals: FloatArray,
    open_front: FloatArray,
    open_back: FloatArray,
    surface: npt.NDArray[np.uint8],
    two_faced: npt.NDArray[np.uint8],
    colour: FloatArray,
    place: FloatArray,
    front: npt.NDArray[np.float32],
    back: npt.NDArray[np.float32],
    fibre_contrast: float,
    specular: float,
    lens: FloatArray,
    rotation: FloatArray,
    eye: FloatArray,
    sun_direction: FloatArray,
    sun: FloatArray,
    sky: FloatArray,
    ground: FloatArray,
    frame: FloatArray,
    shadow_depth: npt.NDArray[np.float32],
    coarse: npt.NDArray[np.float32],
    texel_m: float,
    spread: float,
    table: npt.NDArray[np.float32],
    out: npt.NDArray[np.uint8],
) -> None:
    """Shade the pixels of a window and write them over the table.

    Args:
        window: int64 (4,), first and last column, first and last row (exclusive), px.
        triangle: int32 (2H, 2W), the samples' triangles, -1 is the table.
        depth: float64 (2H, 2W), their planar depth.
        weights: float64 (2H, 2W, 2), their barycentrics.
        faces: int32 (F, 3).
        normals: float64 (V, 3).
        open_front: float64 (V,), share of the sky on the outer side.
        open_back: float64 (V,), share of the sky on the back.
        surface: Of `Materials`, like the next six.
        two_faced: Of `Materials`.
        colour: Of `Materials`.
        place: Of `Materials`.
        front: Of `Materials`.
        back: Of `Materials`.
        fibre_contrast: Of `Materials`.
        specular: Of `Materials`.
        lens: float64 (4,), fx, fy, cx, cy, px.
        rotation: float64 (3, 3), world to camera.
        eye: float64 (3,), world metres.
        sun_direction: float64 (3,), towards the sun.
        sun: float64 (3,), irradiance over pi.
        sky: float64 (3,), radiance.
        ground: float64 (3,), radiance of the table.
        frame: Of `ShadowMap`, like the next four.
        shadow_depth: Of `ShadowMap`.
        coarse: Of `ShadowMap`.
        texel_m: Of `ShadowMap`.
        spread: Of `ShadowMap`.
        table: float32 (H, W, 3), the shadowed table, linear.
        out: uint8 (H, W, 3), written where the object is seen.
    """
    side = front.shape[0]
    share = 1.0 / (SAMPLES * SAMPLES)
    for row in range(window[2], window[3]):
        for column in range(window[0], window[1]):
            covered = 0
            sum0 = sum1 = sum2 = 0.0
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
                dx = ((i + 0.5) / SAMPLES - lens[2]) / lens[0]
                dy = ((j + 0.5) / SAMPLES - lens[3]) / lens[1]
                rx = rotation[0, 0] * dx + rotation[1, 0] * dy + rotation[2, 0]
                ry = rotation[0, 1] * dx + rotation[1, 1] * dy + rotation[2, 1]
                rz = rotation[0, 2] * dx + rotation[1, 2] * dy + rotation[2, 2]
                x = eye[0] + depth[j, i] * rx
                y = eye[1] + depth[j, i] * ry
                z = eye[2] + depth[j, i] * rz
                nx = w0 * normals[a, 0] + w1 * normals[b, 0] + w2 * normals[c, 0]
                ny = w0 * normals[a, 1] + w1 * normals[b, 1] + w2 * normals[c, 1]
                nz = w0 * normals[a, 2] + w1 * normals[b, 2] + w2 * normals[c, 2]
                length = math.sqrt(nx * nx + ny * ny + nz * nz) + 1e-12
                nx, ny, nz = nx / length, ny / length, nz / length
                behind = two_faced[t] == 1 and nx * rx + ny * ry + nz * rz > 0.0
                if behind:
                    nx, ny, nz = -nx, -ny, -nz
                    open_ = w0 * open_back[a] + w1 * open_back[b] + w2 * open_back[c]
                else:
                    open_ = w0 * open_front[a] + w1 * open_front[b] + w2 * open_front[c]
                p = w0 * place[a, 0] + w1 * place[b, 0] + w2 * place[c, 0]
                q = w0 * place[a, 1] + w1 * place[b, 1] + w2 * place[c, 1]
                if surface[t] == WOVEN:
                    tu = min(max(int(p * side), 0), side - 1)
                    tv = min(max(int(q * side), 0), side - 1)
                    image = back if behind else front
                    c0, c1, c2 = image[tv, tu, 0], image[tv, tu, 1], image[tv, tu, 2]
                else:
                    c0, c1, c2 = colour[a, 0], colour[a, 1], colour[a, 2]
                    if surface[t] == FIBRES:
                        r = w0 * place[a, 2] + w1 * place[b, 2] + w2 * place[c, 2]
                        n = value_noise(p * FIBRES_PER_M, q * FIBRES_PER_M, r * FIBRES_PER_M)
                        f = 1.0 + 2.0 * fibre_contrast * (n - 0.5)
                        c0, c1, c2 = c0 * f, c1 * f, c2 * f
                lit = nx * sun_direction[0] + ny * sun_direction[1] + nz * sun_direction[2]
                gloss = 0.0
                if lit > 0.0:
                    off = 2.0 * texel_m
                    seen = sunlight(
                        x + off * nx, y + off * ny, z + off * nz, i, j,
                        frame, shadow_depth, coarse, texel_m, spread,
                    )  # fmt: skip
                    lit *= seen
                    if specular > 0.0 and seen > 0.0:
                        inverse = 1.0 / math.sqrt(rx * rx + ry * ry + rz * rz)
                        hx = sun_direction[0] - rx * inverse
                        hy = sun_direction[1] - ry * inverse
                        hz = sun_direction[2] - rz * inverse
                        inverse = 1.0 / math.sqrt(hx * hx + hy * hy + hz * hz)
                        along = (nx * hx + ny * hy + nz * hz) * inverse
                        if along > 0.0:
                            gloss = 0.35 * specular * seen * along**_GLOSS
                else:
                    lit = 0.0
                above = open_ * (0.5 + 0.5 * nz)
                below = open_ * (0.5 - 0.5 * nz)
                # Sky that is blocked comes back from the surface that blocks it, and so does the
                # sun that falls there.
                bounced = SUN_BOUNCE * (1.0 - open_) * sun_direction[2]
                sum0 += gloss * sun[0] + c0 * (
                    (lit + bounced * c0) * sun[0]
                    + (above * sky[0] + below * ground[0]) / (1.0 - c0 * (1.0 - open_))
                )
                sum1 += gloss * sun[1] + c1 * (
                    (lit + bounced * c1) * sun[1]
                    + (above * sky[1] + below * ground[1]) / (1.0 - c1 * (1.0 - open_))
                )
                sum2 += gloss * sun[2] + c2 * (
                    (lit + bounced * c2) * sun[2]
                    + (above * sky[2] + below * ground[2]) / (1.0 - c2 * (1.0 - open_))
                )
            if covered:
                rest = SAMPLES * SAMPLES - covered
                out[row, column, 0] = encode_channel(share * (sum0 + rest * table[row, column, 0]))
                out[row, column, 1] = encode_channel(share * (sum1 + rest * table[row, column, 1]))
                out[row, column, 2] = encode_channel(share * (sum2 + rest * table[row, column, 2]))


def shader_arguments(
    material: Materials,
) -> tuple[
    npt.NDArray[np.uint8],
    npt.NDArray[np.uint8],
    FloatArray,
    FloatArray,
    npt.NDArray[np.float32],
    npt.NDArray[np.float32],
    float,
    float,
]:
    """Return the arguments of `shade` from `surface` to `specular`."""
    return (
        material.surface,
        material.two_faced,
        material.colour,
        material.place,
        material.front,
        material.back,
        material.fibre_contrast,
        material.specular,
    )
