"""Reads a folder of frames with the paper's own annotations, `knots_info.json`.

The rendering scripts of the paper write, for each frame, a list of points in one order for all
frames; a point is a list of pixels [u, v], empty where it is hidden. They are the projections of
mesh vertices, `[round(x * width), round(height - y * height)]`: positions from the image's corner,
rounded to whole numbers.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from pliant.converters.clip import Clip, Floats, Image, decode_picture
from pliant.spec.errors import SpecError
from pliant.spec.io.jsonfiles import read_json

KNOTS_JSON: Final = "knots_info.json"
_IMAGE: Final = re.compile(r"(\d{1,9})_rgb\.png")

Pixels = Literal["rounded", "index"]
"""What a whole number says: `rounded`, the position to the nearest pixel border, as the paper's
scripts write it; `index`, the column and row of a pixel, whose centre is half a pixel further."""


def read_knots(folder: Path, *, pixels: Pixels = "rounded", temporal: bool = False) -> Clip:
    """Read a folder of frames with their `knots_info.json`.

    Args:
        folder: Holds `knots_info.json` and the images `000000_rgb.png` …, here or in `images/`.
        pixels: What the whole numbers say.
        temporal: Whether the frames follow each other in time.

    Returns:
        The frames in the order of their numbers. Of a point with several pixels the position is
        their mean.

    Raises:
        SpecError: A file is missing or damaged, or images and annotations do not belong together.
    """
    path = next(
        (p for p in (folder / KNOTS_JSON, folder / "images" / KNOTS_JSON) if p.is_file()),
        folder / KNOTS_JSON,
    )
    annotated = _annotations(read_json(path), path)
    images = {
        int(match[1]): image
        for image in sorted(path.parent.iterdir())
        if (match := _IMAGE.fullmatch(image.name))
    }
    if set(images) != set(annotated):
        odd = min(set(images) ^ set(annotated))
        raise SpecError(
            "images and annotations do not belong to the same frames",
            path=path,
            found=f"{len(annotated)} annotated frames and {len(images)} images",
            required=f"both for each frame; frame {odd} has only one of them",
        )
    numbers = sorted(images)
    uv_px = np.stack([_positions(annotated[n], f"frame {n}", path) for n in numbers], axis=1)
    if pixels == "index":
        uv_px = uv_px + 0.5
    files = [images[number] for number in numbers]
    height, width, _ = _decode(files[0]).shape
    size = (width, height)
    return Clip(
        name=folder.name,
        size=size,
        frames=len(files),
        read=lambda frame: _read(files[frame], size),
        uv_px=uv_px,
        visible=np.isfinite(uv_px[..., 0]),
        temporal=temporal,
    )


def _annotations(document: Any, path: Path) -> dict[int, Any]:
    """Return the points of each frame by its number."""
    if isinstance(document, list):
        document = dict(enumerate(document))
    if not isinstance(document, dict) or not document:
        raise SpecError(
            "these are no annotations", path=path, required="an object, frame -> points"
        )
    frames: dict[int, Any] = {}
    for key, points in document.items():
        if not str(key).isdecimal():
            raise SpecError("a frame has no number", path=path, where=str(key)[:40])
        frames[int(key)] = points
    counts = {len(points) if isinstance(points, list) else -1 for points in frames.values()}
    if len(counts) != 1 or min(counts) < 1:
        raise SpecError(
            "the frames do not list the same points",
            path=path,
            found=f"lists of {sorted(counts)} points",
            required="one list of points in every frame, in one order",
        )
    return frames


def _positions(points: Any, where: str, path: Path) -> Floats:
    """Return the points of one frame, float64 (N, 2); NaN where hidden."""
    result = np.full((len(points), 2), np.nan)
    for index, pixels in enumerate(points):
        if pixels == []:
            continue
        try:
            values = np.array(pixels, np.float64)
        except (TypeError, ValueError):
            values = np.zeros(0)
        if values.ndim != 2 or values.shape[1] != 2:
            raise SpecError(
                "a point is no list of pixels",
                path=path,
                where=f"{where}, point {index}",
                found=f"{pixels!r:.60}",
                required="[[u, v], …], or [] where it is hidden",
            )
        result[index] = values.mean(axis=0)
    return result


def _read(path: Path, size: tuple[int, int]) -> Image:
    image = _decode(path)
    if (image.shape[1], image.shape[0]) != size:
        raise SpecError(
            "the images differ in size",
            path=path,
            found=f"{image.shape[1]} x {image.shape[0]}",
            required=f"{size[0]} x {size[1]}, as the first",
        )
    return image


def _decode(path: Path) -> Image:
    try:
        return decode_picture(path)
    except Exception as error:  # Pillow's errors on a damaged file do not share a base
        raise SpecError("the image cannot be read", path=path, found=str(error)[:200]) from error
