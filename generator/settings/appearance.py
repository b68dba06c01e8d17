"""Ranges that the appearance of a sequence is drawn from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, ClassVar, Final

from pliant.spec.configuration import configuration
from pliant.spec.constraints import Bounds, Natural, Range, Weights

TABLES: Final = ("plain", "mottled", "wood")
ROPE_COLOURINGS: Final = ("solid", "tracer", "two-tone")


def _even_tables() -> dict[str, float]:
    return {"plain": 0.25, "mottled": 0.45, "wood": 0.30}


def _even_ropes() -> dict[str, float]:
    return {"solid": 0.25, "tracer": 0.50, "two-tone": 0.25}


@configuration(frozen=True)
class AppearanceSettings:
    """Ranges an appearance is drawn from, uniformly; (low, high) with low <= high.

    Attributes:
        tables: Table kind -> weight.
        table_value: Brightness of the table's colour (HSV value, sRGB).
        table_saturation: Its saturation.
        table_contrast: Strength of its texture.
        table_scale_m: Size of the texture's largest features, metres.
        object_value: Brightness of the object's colours.
        object_saturation: Their saturation.
        object_hue: Their hue, in turns of the colour circle from red; it may begin below 0.
            Training sets and test sets with disjoint ranges show disjoint families of materials.
        rope_colourings: `solid`, `tracer` (strand 0 in another colour), `two-tone` -> weight.
        fibre_contrast: Mottling of a rope's fibres.
        weave_contrast: Visibility of a cloth's weave.
        specular: Strength of highlights.
        sun_elevation_deg: Height of the sun, degrees.
        sun_azimuth_deg: Its direction, degrees.
        sun_angle_deg: Diameter of its disc, degrees: small is hard light, large is soft.
        sun_share: Share of the light on the open table that comes from the sun.
        sun_warmth: 0 is white, 1 is the orange of a low sun.
        brightness: What a white table would reflect: the exposure.
        least_contrast: Smallest distance between object and table, in sRGB units of 0 to 1.
        materials: How many materials (object, ball and table as they are without light) a tier
            has in all its splits; 0 gives every sequence its own. The light is always drawn anew.
        first_material: Number of the first of them: a set that starts beyond another's shows
            the same configurations in materials that the other has never shown.
    """

    SECTION: ClassVar[str] = "look"

    tables: Annotated[Mapping[str, float], Weights(TABLES)] = field(default_factory=_even_tables)
    table_value: Annotated[Range, Bounds(0, 1)] = (0.25, 0.85)
    table_saturation: Annotated[Range, Bounds(0, 1)] = (0.0, 0.40)
    table_contrast: Annotated[Range, Bounds(0, 1)] = (0.15, 0.6)
    table_scale_m: Annotated[Range, Bounds(0.005, 5)] = (0.04, 0.25)
    object_value: Annotated[Range, Bounds(0, 1)] = (0.45, 0.95)
    object_saturation: Annotated[Range, Bounds(0, 1)] = (0.10, 0.85)
    object_hue: Annotated[Range, Bounds(-1, 1)] = (0.0, 1.0)
    rope_colourings: Annotated[Mapping[str, float], Weights(ROPE_COLOURINGS)] = field(
        default_factory=_even_ropes
    )
    fibre_contrast: Annotated[Range, Bounds(0, 1)] = (0.10, 0.35)
    weave_contrast: Annotated[Range, Bounds(0, 1)] = (0.02, 0.10)
    specular: Annotated[Range, Bounds(0, 1)] = (0.0, 0.35)
    sun_elevation_deg: Annotated[Range, Bounds(10, 90)] = (35.0, 75.0)
    sun_azimuth_deg: Annotated[Range, Bounds(-360, 360)] = (-180.0, 180.0)
    sun_angle_deg: Annotated[Range, Bounds(0.1, 20)] = (1.0, 7.0)
    sun_share: Annotated[Range, Bounds(0, 1)] = (0.50, 0.80)
    sun_warmth: Annotated[Range, Bounds(0, 1)] = (0.0, 0.6)
    brightness: Annotated[Range, Bounds(0.05, 4)] = (0.70, 1.0)
    least_contrast: Annotated[float, Bounds(0, 0.5)] = 0.30
    materials: Natural = 0
    first_material: Natural = 0
