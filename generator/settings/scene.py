"""Ranges that a sequence's appearance and camera are drawn from, and strengths of image faults."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Self

from pydantic import Field, model_validator

from pliant.spec.configuration import Settings
from pliant.spec.constraints import (
    Bounds,
    Natural,
    NonNegative,
    Range,
    Refused,
    Share,
    Weights,
    WholeRange,
)

TABLES: Final = ("plain", "mottled", "wood")
ROPE_COLOURINGS: Final = ("solid", "tracer", "two-tone")
DISTRACTORS: Final = ("rope", "cable", "cloth")


class AppearanceSettings(Settings):
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
            has in all its splits; 0 gives every sequence its own. The light is always drawn again.
        first_material: Number of the first of them: a set that starts beyond another's shows
            the same configurations in materials that the other has never shown.
    """

    tables: Annotated[Mapping[str, float], Weights(TABLES)] = Field(
        default_factory=lambda: {"plain": 0.25, "mottled": 0.45, "wood": 0.30}
    )
    table_value: Annotated[Range, Bounds(0, 1)] = (0.25, 0.85)
    table_saturation: Annotated[Range, Bounds(0, 1)] = (0.0, 0.40)
    table_contrast: Annotated[Range, Bounds(0, 1)] = (0.15, 0.6)
    table_scale_m: Annotated[Range, Bounds(0.005, 5)] = (0.04, 0.25)
    object_value: Annotated[Range, Bounds(0, 1)] = (0.45, 0.95)
    object_saturation: Annotated[Range, Bounds(0, 1)] = (0.10, 0.85)
    object_hue: Annotated[Range, Bounds(-1, 1)] = (0.0, 1.0)
    rope_colourings: Annotated[Mapping[str, float], Weights(ROPE_COLOURINGS)] = Field(
        default_factory=lambda: {"solid": 0.25, "tracer": 0.50, "two-tone": 0.25}
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


CLEARANCE_M: Final = 0.02
"""A camera keeps at least this far from the table and from the object's box."""

MIN_MARGIN: Final = 0.02
"""Share of the frame that stays free on every side of the object at the start."""


class CameraSettings(Settings):
    """Ranges a camera is drawn from, uniformly; (low, high) with low <= high.

    Attributes:
        top: Weight of the view from above.
        oblique: Weight of the view from the side.
        fov_deg: Horizontal field of view, degrees.
        fill: Share of the frame's width or height, whichever is tighter, that the object's box
            takes over all configurations of a sequence (of an episode, at its start and with the
            middle of its workspace); less where the camera would be in the object or below the
            table.
        shift: Share of the free margin by which the object may be off the centre.
        top_tilt_deg: Angle of the top view against the vertical, degrees.
        top_roll_deg: Roll of the top view about its axis, degrees.
        oblique_elevation_deg: Height of the oblique camera above the table, degrees.
        oblique_azimuth_deg: Where around the object it stands, degrees; 0 is the side -y. None is
            anywhere about a rope, and within 20 degrees for a cloth: a blank square looks the same
            from four sides, and only how it is in the image says which corner is which.
        oblique_roll_deg: Roll of the oblique view, degrees.
        distance_m: Distance from the object's middle in place of `fill`, or None.
    """

    top: NonNegative = 0.6
    oblique: NonNegative = 0.4
    fov_deg: Annotated[Range, Bounds(5, 120)] = (38.0, 55.0)
    fill: Annotated[Range, Bounds(0.05, 1 - 2 * MIN_MARGIN)] = (0.62, 0.86)
    shift: Annotated[Range, Bounds(0, 1)] = (0.0, 0.7)
    top_tilt_deg: Annotated[Range, Bounds(0, 30)] = (0.0, 4.0)
    top_roll_deg: Annotated[Range, Bounds(-180, 180)] = (-12.0, 12.0)
    oblique_elevation_deg: Annotated[Range, Bounds(5, 90)] = (42.0, 68.0)
    oblique_azimuth_deg: Annotated[Range, Bounds(-360, 360)] | None = None
    oblique_roll_deg: Annotated[Range, Bounds(-180, 180)] = (-4.0, 4.0)
    distance_m: Annotated[Range, Bounds(CLEARANCE_M, 100)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.top + self.oblique <= 0:
            raise Refused("above 0 for one of top and oblique", "top")
        return self


class SceneSettings(Settings):
    """What else is in the scene.

    Attributes:
        distractors: Number of ropes, cables and cloths next to the object, (low, high). They are in
            the surface images as objects of their own, and nothing is asked about them.
        distractor_kinds: `rope`, `cable`, `cloth` -> weight.
        distractor_over: Probability that one is partly over the object and hides a part of it,
            instead of next to it where there is room.
    """

    distractors: Annotated[WholeRange, Bounds(0, 16)] = (0, 0)
    distractor_kinds: Annotated[Mapping[str, float], Weights(DISTRACTORS)] = Field(
        default_factory=lambda: {"rope": 0.4, "cable": 0.3, "cloth": 0.3}
    )
    distractor_over: Share = 0.3


class NoiseSettings(Settings):
    """Strengths, drawn uniformly for each frame; (low, high) with low <= high; 0 is none.

    Attributes:
        gaussian: Standard deviation, in 8-bit steps.
        photons: Photons that make a pixel white; fewer is noisier; 0 turns off Poisson noise.
        salt_pepper: Share of the pixels that turn white or black.
        dropout: Share of the outline that is lost.
        dropout_px: How far from the outline pixels may be lost.
        dropout_scale_px: Size of the patches.
        blur_px: Standard deviation of a Gaussian blur: the lens, before the noise of the sensor.
        jpeg_quality: Quality that the noisy image is compressed with, 1 to 95; None does not
            compress it.
    """

    gaussian: Annotated[Range, Bounds(0, 128, "of 255")] = (0.5, 3.0)
    photons: Annotated[Range, Bounds(0, 1e9)] = (800.0, 4000.0)
    salt_pepper: Annotated[Range, Bounds(0, 1)] = (0.0, 0.0005)
    dropout: Annotated[Range, Bounds(0, 1)] = (0.0, 0.25)
    dropout_px: Annotated[int, Bounds(0, 16)] = 2
    dropout_scale_px: Annotated[float, Bounds(1, 1000)] = 12.0
    blur_px: Annotated[Range, Bounds(0, 32)] = (0.0, 0.0)
    jpeg_quality: Annotated[WholeRange, Bounds(1, 95)] | None = None


class DepthCameraSettings(Settings):
    """Strengths, drawn uniformly for each frame; (low, high) with low <= high.

    Attributes:
        table_grey: Grey of the table where the camera looks, of 255: the scale of depth.
        noise_grey: Standard deviation of the depth before it is rounded, in grey steps.
        steepest: Slope (metres of depth a metre across) from which ground falling away to the
            right is lost.
        frayed_px: Mean length that a row loses of the right rim, inside the patches.
        patch_px: Size of the patches.
        pinholes: Share of the object's pixels that fail.
        specks: Specks next to the object.
    """

    table_grey: Annotated[Range, Bounds(1, 200, "of 255")] = (142.0, 154.0)
    noise_grey: Annotated[Range, Bounds(0, 64, "of 255")] = (0.05, 0.25)
    steepest: Annotated[Range, Bounds(0.05, 100)] = (1.1, 1.8)
    frayed_px: Annotated[Range, Bounds(0, 64)] = (0.3, 1.5)
    patch_px: Annotated[Range, Bounds(1, 1000)] = (6.0, 16.0)
    pinholes: Annotated[Range, Bounds(0, 1)] = (0.0, 0.0008)
    specks: Annotated[Range, Bounds(0, 10_000)] = (0.0, 8.0)
