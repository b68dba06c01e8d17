"""The conventions every file follows, as they also stand in `dataset.json`."""

from __future__ import annotations

from typing import Any, Final

SPEC_VERSION: Final = "1.0.0"
"""Version of the specification that this code reads and writes."""

FOOTER_KEY: Final = b"pliant"
"""Key of the JSON object in the footer of every Parquet file."""

VISIBILITY_STATES: Final = ("visible", "self_occluded", "occluded", "out_of_frame")
"""`visible`: the camera sees the point; `self_occluded`: hidden by the same object;
`occluded`: hidden by another object; `out_of_frame`: projects outside the image (or lies
behind the camera), whatever hides it."""

VISIBLE, SELF_OCCLUDED, OCCLUDED, OUT_OF_FRAME = range(4)
"""Numbers of the states in arrays."""

POINT_KINDS: Final = ("surface", "centreline")

NAME: Final = r"(?!.*\.\.)[A-Za-z0-9]([A-Za-z0-9._-]{0,126}[A-Za-z0-9])?"
"""Regular expression of names of datasets, tiers and sequences; they are folder names too."""

VERSION: Final = "[0-9]+[.][0-9]+[.][0-9]+"
"""Regular expression of versions of datasets."""

SPLITS: Final = ("train", "val", "test")


CONVENTIONS: Final[dict[str, Any]] = {
    "pixel_origin": "top_left_corner",
    "first_pixel_centre": [0.5, 0.5],
    "pixel_axes": {"u": "right", "v": "down"},
    "camera_axes": {"x": "right", "y": "down", "z": "forward"},
    "pose": "world_to_camera",
    "length_unit": "m",
    "angle_unit": "rad",
    "depth": "planar_z",
    "depth_background": "+inf",
    "colour_space": "sRGB",
    "visibility_states": list(VISIBILITY_STATES),
}
"""The `conventions` object of `dataset.json`, verbatim."""
