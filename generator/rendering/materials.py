"""What the surfaces of a scene object are made of, for the shaders of all styles."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from pliant.generator.rendering.patterns import cloth_images
from pliant.generator.scene.appearance import Appearance
from pliant.generator.scene.scene_object import GRIPPER, FloatArray, SceneMesh, SceneObject

PLAIN, FIBRES, WOVEN = 0, 1, 2
"""What a triangle's colour is: the vertices', the vertices' mottled by fibres, the cloth's."""

GRIPPER_COLOUR: Final = (0.055, 0.055, 0.06)

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
        elif part.name == GRIPPER:
            colour[rows] = GRIPPER_COLOUR
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
