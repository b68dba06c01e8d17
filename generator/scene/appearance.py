"""What a sequence looks like: colours, patterns, table and light, drawn within named ranges.

An appearance holds nothing but numbers and names, so that it can be kept in `sequence.json`. All
styles render the same appearance. Colours are linear RGB reflectances.

An appearance never breaks a symmetry that its tier declares: a rope's odd strand is strand 0, on
which the reversal lands again; a plain cloth is woven alike under the maps of its square or
rectangle. Patterns are on the material in the same place in every
sequence of a tier; only their colours change.
"""

from __future__ import annotations

import colorsys
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pliant.generator.scene.scene_object import SceneObject
from pliant.generator.seeding import weighted_choice
from pliant.generator.settings.scene import AppearanceSettings
from pliant.spec.errors import CallError

Colour = tuple[float, float, float]
Range = tuple[float, float]


@dataclass(frozen=True)
class TableAppearance:
    """The table's surface.

    Attributes:
        kind: `plain`, `mottled` or `wood`.
        colour: Mean reflectance.
        contrast: Strength of the texture, 0 to 1.
        scale_m: Size of its largest features, metres.
        angle_rad: Direction of the grain.
        seed: Which piece of the texture is there.
    """

    kind: str
    colour: Colour
    contrast: float
    scale_m: float
    angle_rad: float
    seed: int


@dataclass(frozen=True)
class Light:
    """A sun and a uniform sky.

    Attributes:
        sun_direction: Unit vector from the table towards the sun.
        sun_irradiance: RGB, on a surface facing the sun, before the division by pi.
        sun_angle_rad: Diameter of the sun's disc; it softens the shadows.
        sky_radiance: RGB, the same from everywhere above.
    """

    sun_direction: Colour
    sun_irradiance: Colour
    sun_angle_rad: float
    sky_radiance: Colour


@dataclass(frozen=True)
class Appearance:
    """How one sequence looks.

    Attributes:
        light: Sun and sky; the exposure is part of their strength.
        table: The table.
        strand_colours: Rope: colour per strand. Cloth: empty.
        fibre_contrast: Rope: strength of the fibres' mottling.
        ball_colour: Colour of the rope's ball.
        cloth_colours: Cloth: the colours that its pattern is made of, the ground first.
        back_colour: Cloth: colour of the back's ground, the front's own where both are alike.
        pattern: Cloth: `plain`, `towel`, or `printed` and the number of the design.
        weave_contrast: Cloth: strength of the weave.
        specular: Strength of the highlights, 0 to 1.
    """

    light: Light
    table: TableAppearance
    strand_colours: tuple[Colour, ...]
    fibre_contrast: float
    ball_colour: Colour
    cloth_colours: tuple[Colour, ...]
    back_colour: Colour
    pattern: str
    weave_contrast: float
    specular: float


def sample_appearance(
    rng: np.random.Generator,
    scene_object: SceneObject,
    settings: AppearanceSettings,
    material: np.random.Generator | None = None,
) -> Appearance:
    """Draw the appearance of one sequence.

    Args:
        rng: Source of every random number.
        scene_object: What is looked at: its kind, variant and strands.
        settings: The ranges.
        material: Source of all but the light, where several sequences share a material.

    Raises:
        CallError: The ranges leave no object colour that stands out from the table.
    """
    light = _sample_light(rng, settings)
    rng = rng if material is None else material
    table_srgb = _sample_hsv(rng, settings.table_saturation, settings.table_value)
    table = TableAppearance(
        kind=weighted_choice(rng, settings.tables),
        colour=linear_reflectance(table_srgb),
        contrast=float(rng.uniform(*settings.table_contrast)),
        scale_m=float(rng.uniform(*settings.table_scale_m)),
        angle_rad=float(rng.uniform(-math.pi, math.pi)),
        seed=int(rng.integers(0, 2**31)),
    )
    main = _standing_out(rng, settings, (table_srgb,))
    second = _standing_out(rng, settings, (main,))
    third = _standing_out(rng, settings, (main,))
    strands: tuple[Colour, ...] = ()
    cloth: tuple[Colour, ...] = ()
    back = main
    if scene_object.kind == "rope":
        count = int(scene_object.parts[0].strand.max()) + 1
        colouring = weighted_choice(rng, settings.rope_colourings)
        # These sets of strands are kept by the reversal of a laid rope.
        opposite = {0, count // 2 if count % 2 == 0 else 0}
        odd = {"solid": set(), "tracer": {0}, "two-tone": opposite}[colouring]
        strands = tuple(linear_reflectance(second if k in odd else main) for k in range(count))
    else:
        cloth = (linear_reflectance(main), linear_reflectance(second), linear_reflectance(third))
        back = second if scene_object.variant == "towel" else main
    return Appearance(
        light=light,
        table=table,
        strand_colours=strands,
        fibre_contrast=float(rng.uniform(*settings.fibre_contrast)),
        ball_colour=linear_reflectance(third),
        cloth_colours=cloth,
        back_colour=linear_reflectance(back),
        pattern=scene_object.variant,
        weave_contrast=float(rng.uniform(*settings.weave_contrast)),
        specular=float(rng.uniform(*settings.specular)),
    )


def _sample_light(rng: np.random.Generator, settings: AppearanceSettings) -> Light:
    elevation = math.radians(rng.uniform(*settings.sun_elevation_deg))
    azimuth = math.radians(rng.uniform(*settings.sun_azimuth_deg))
    share = float(rng.uniform(*settings.sun_share))
    warmth = float(rng.uniform(*settings.sun_warmth))
    brightness = float(rng.uniform(*settings.brightness))
    sun = np.array([1.0, 1.0 - 0.22 * warmth, 1.0 - 0.5 * warmth])
    sky = np.array([1.0 - 0.3 * warmth, 1.0 - 0.12 * warmth, 1.0 + 0.1 * warmth])
    # The open table gets brightness * pi in all: share from the sun, the rest from the sky.
    sun *= math.pi * brightness * share / math.sin(elevation) / sun.mean()
    sky *= brightness * (1.0 - share) / sky.mean()
    flat = math.cos(elevation)
    return Light(
        sun_direction=(flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)),
        sun_irradiance=_colour(sun),
        sun_angle_rad=math.radians(rng.uniform(*settings.sun_angle_deg)),
        sky_radiance=_colour(sky),
    )


def _standing_out(
    rng: np.random.Generator, settings: AppearanceSettings, others: tuple[Colour, ...]
) -> Colour:
    """Draw an object colour (sRGB) at a distance from others."""
    for _ in range(200):
        colour = _sample_hsv(
            rng, settings.object_saturation, settings.object_value, settings.object_hue
        )
        if all(math.dist(colour, other) >= settings.least_contrast for other in others):
            return colour
    raise CallError(
        "no object colour within the ranges has enough contrast with the table or with another "
        "colour of the object",
        where="look.least_contrast",
        found=settings.least_contrast,
        fix="Widen look.object_value and look.object_saturation, or lower look.least_contrast.",
    )


def _sample_hsv(
    rng: np.random.Generator, saturation: Range, value: Range, hue: Range = (0.0, 1.0)
) -> Colour:
    turn = (hue[0] + (hue[1] - hue[0]) * rng.random()) % 1.0
    return colorsys.hsv_to_rgb(turn, rng.uniform(*saturation), rng.uniform(*value))


def linear_reflectance(srgb: Colour) -> Colour:
    """Return an sRGB colour (0 to 1) as linear reflectance."""
    c = np.asarray(srgb)
    return _colour(np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4))


def _colour(values: Any) -> Colour:
    r, g, b = (float(value) for value in values)
    return r, g, b
