"""What the steps of a case compute of images: changes of EXR channels and pictures, by name."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image

from pliant.spec.arrays import FloatArray, Rgb
from pliant.spec.io.exr import write_camera_depth
from pliant.spec.io.png import read_rgb, write_mask, write_rgb
from tests.conformance.edits import Edit

Channels = dict[str, Any]
Pictures = list[Rgb]

_MATERIAL = ("surface.m0", "surface.m1")


def fill(path: str, kind: Literal["mask", "rgb", "depth"], value: float) -> Edit:
    """Write an image of one value."""

    def edit(root: Path) -> None:
        target = root / path
        if kind == "mask":
            write_mask(target, np.full((48, 64), value, np.uint8))
        elif kind == "rgb":
            write_rgb(target, np.full((48, 64, 3), value, np.uint8))
        else:
            write_camera_depth(target, np.full((48, 64), value, np.float32))

    return edit


# Channels of a depth and surface image.


def nothing(channels: Channels) -> None:
    return None


def _of_objects(channels: Channels, change: Callable[[FloatArray], Any]) -> None:
    """Change Z where an object is seen, computed in float64."""
    seen = channels["surface.object"] > 0
    channels["Z"][seen] = change(channels["Z"][seen].astype(np.float64))


def depth_float16(channels: Channels) -> None:
    _of_objects(channels, lambda z: z.astype(np.float16))


def depth_8_bits(channels: Channels) -> None:
    _of_objects(channels, eight_bits)


def depth_rounded(channels: Channels, digits: int) -> None:
    _of_objects(channels, lambda z: np.round(z, digits))


def depth_noisy(channels: Channels, size_m: float) -> None:
    _of_objects(channels, lambda z: z + np.random.default_rng(0).normal(0, size_m, z.shape))


def depth_added(channels: Channels, step_m: float) -> None:
    _of_objects(channels, lambda z: z + step_m)


def depth_scaled(channels: Channels, factor: float) -> None:
    _of_objects(channels, lambda z: z * factor)


def eight_bits(values: FloatArray) -> FloatArray:
    """Round values to 256 levels between the smallest and the largest."""
    low, high = values.min(), values.max()
    return low + np.rint((values - low) / (high - low) * 255) / 255 * (high - low)


def everywhere(channels: Channels, step_m: float) -> None:
    """Add to Z of every pixel."""
    channels["Z"] += np.float32(step_m)


def background(channels: Channels, value: float) -> None:
    """Set Z where no object is seen."""
    channels["Z"][channels["surface.object"] == 0] = value


def pixel(channels: Channels, name: str, value: float | str, object_id: int = 1) -> None:
    """Set one pixel: the middle one of an object, or the first of the background (object 0)."""
    rows, columns = np.nonzero(channels["surface.object"] == object_id)
    place = len(rows) // 2 if object_id else 0
    channels[name][rows[place], columns[place]] = float(value)


def depth_inverse(channels: Channels) -> None:
    _of_objects(channels, lambda z: 1 / z)


def material_8_bits(channels: Channels) -> None:
    for name in _MATERIAL:
        channels[name][:] = np.rint(channels[name].astype(np.float64) * 255) / 255


def material_levels(channels: Channels) -> None:
    """Round both coordinates to 256 levels of their range."""
    seen = channels["surface.object"] > 0
    for name in _MATERIAL:
        channels[name][seen] = eight_bits(channels[name][seen].astype(np.float64))


def material_float16(channels: Channels) -> None:
    for name in _MATERIAL:
        channels[name][:] = channels[name].astype(np.float16)


def material_noisy(channels: Channels, size: float, own_range: bool = False) -> None:
    """Add noise, clipped to the image's own range or to 0 to 1."""
    rng = np.random.default_rng(0)
    seen = channels["surface.object"] > 0
    for name in _MATERIAL:
        low, high = (channels[name].min(), channels[name].max()) if own_range else (0, 1)
        noisy = channels[name][seen] + rng.normal(0, size, np.count_nonzero(seen))
        channels[name][seen] = np.clip(noisy, low, high)


def material_mirrored(channels: Channels) -> None:
    seen = channels["surface.object"] > 0
    channels["surface.m1"][seen] = 1 - channels["surface.m1"][seen]


def material_exchanged(channels: Channels) -> None:
    first, second = _MATERIAL
    channels[first], channels[second] = channels[second], channels[first]


def half_floats(channels: Channels) -> None:
    channels["surface.m0"] = channels["surface.m0"].astype(np.float16)


def renamed(channels: Channels, old: str, new: str) -> None:
    channels[new] = channels.pop(old)


def cropped(channels: Channels) -> Channels:
    return {name: np.ascontiguousarray(part[:, :-1]) for name, part in channels.items()}


def rolled(channels: Channels, down: int, right: int) -> Channels:
    """Move the image by whole pixels."""
    moved = {name: np.roll(part, (down, right), (0, 1)) for name, part in channels.items()}
    return {name: np.ascontiguousarray(part) for name, part in moved.items()}


def upside_down(channels: Channels) -> Channels:
    return {name: np.ascontiguousarray(part[::-1]) for name, part in channels.items()}


# Colour images of a sequence.


def change_pictures(folder: str, change: Callable[[Pictures], Pictures]) -> Edit:
    """Change the colour images of a sequence."""

    def edit(root: Path) -> None:
        paths = sorted((root / folder / "rgb").glob("*.png"))
        changed = change([read_rgb(path) for path in paths])
        for path, rgb in zip(paths, changed, strict=True):
            write_rgb(path, np.ascontiguousarray(rgb))

    return edit


def mirrored(pictures: Pictures) -> Pictures:
    return [rgb[:, ::-1] for rgb in pictures]


def flipped(pictures: Pictures) -> Pictures:
    """Turn the pictures upside down."""
    return [rgb[::-1] for rgb in pictures]


def turned(pictures: Pictures) -> Pictures:
    """Turn the pictures by 180 degrees."""
    return [rgb[::-1, ::-1] for rgb in pictures]


def shifted(pictures: Pictures, right: int, down: int = 0) -> Pictures:
    return [np.roll(rgb, (down, right), (0, 1)) for rgb in pictures]


def exchanged(pictures: Pictures, step: int = 1) -> Pictures:
    """Give each frame the picture some frames later."""
    return pictures[step:] + pictures[:step]


def first_alone(pictures: Pictures) -> Pictures:
    return pictures[:1] * len(pictures)


def one_grey(pictures: Pictures, value: int) -> Pictures:
    return [np.full_like(rgb, value) for rgb in pictures]


def random_pictures(pictures: Pictures) -> Pictures:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, rgb.shape, np.uint8) for rgb in pictures]


def grey(pictures: Pictures) -> Pictures:
    return [rgb[..., [1, 1, 1]] for rgb in pictures]


def enlarged(pictures: Pictures) -> Pictures:
    """Reduce to half the size and enlarge again."""
    found = []
    for rgb in pictures:
        height, width = rgb.shape[:2]
        small = Image.fromarray(rgb).resize((width // 2, height // 2), Image.Resampling.BOX)
        found.append(np.asarray(small.resize((width, height), Image.Resampling.BILINEAR)))
    return found


def jpeg(pictures: Pictures) -> Pictures:
    """Compress as JPEG of quality 25."""
    found = []
    for rgb in pictures:
        stream = io.BytesIO()
        Image.fromarray(rgb).save(stream, "JPEG", quality=25)
        found.append(np.asarray(Image.open(stream)))
    return found
