"""Reads a folder of frames with the paper's own annotations, `knots_info.json`.

The rendering scripts of the paper write, for each frame, a list of points in one order for all
frames; a point is a list of pixels [u, v], empty where it is hidden. They are the projections of
mesh vertices, `[round(x * width), round(height - y * height)]`: positions from the image's corner,
rounded to whole numbers.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from pliant.converters.annotations import Annotations
from pliant.spec.arrays import FloatArray
from pliant.spec.errors import SpecError
from pliant.spec.io.jsonfiles import read_json

KNOTS_JSON: Final = "knots_info.json"
_IMAGE: Final = re.compile(r"(\d{1,9})_rgb\.(?:png|jpg|jpeg)")
_NUMBER: Final = re.compile(r"\d{1,9}")
_IMAGE_NAME: Final = "%06d_rgb.png"


def read_knots(folder: Path) -> Annotations:
    """Read a folder of frames with their `knots_info.json`.

    Args:
        folder: Contains `knots_info.json` and the images `000000_rgb.png` …, here or in `images/`,
            and perhaps masks `000000_visible_mask.png` … in `image_masks/`.

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
    images: dict[int, Path] = {}
    for image in sorted(path.parent.iterdir()):
        match = _IMAGE.fullmatch(image.name)
        if match is None:
            continue
        if int(match[1]) in images:
            raise SpecError(
                "two images have the same frame number",
                path=path.parent,
                found=f"{images[int(match[1])].name} and {image.name}",
                fix="Delete one of them.",
            )
        images[int(match[1])] = image
    if set(images) != set(annotated):
        odd = min(set(images) ^ set(annotated))
        entry = f"the entry {odd} of {KNOTS_JSON}"
        fix = (
            f"Delete {images[odd].name}, or add {entry}."
            if odd in images
            else f"Add {_IMAGE_NAME % odd}, or delete {entry}."
        )
        raise SpecError(
            "images and annotations do not belong to the same frames",
            path=path,
            found=f"{len(annotated)} annotated frames and {len(images)} images NNNNNN_rgb.png",
            required=f"both for each frame; frame {odd} has only one of them",
            fix=fix,
        )
    numbers = sorted(images)
    masks = (folder / "image_masks", path.parent.parent / "image_masks")
    uv_px = np.stack([_positions(annotated[n], f"frame {n}", path) for n in numbers], axis=1)
    visible = np.isfinite(uv_px[..., 0])
    return Annotations(
        path=folder,
        pictures=[images[number] for number in numbers],
        points=[str(point) for point in range(len(uv_px))],
        uv_px=uv_px,
        visible=visible,
        # The cloth scripts write every vertex, those under a fold too.
        unsaid=["which points are hidden"] if visible.all() else [],
        masks=next((each for each in masks if each.is_dir()), None),
    )


def _annotations(document: Any, path: Path) -> dict[int, Any]:
    """Return the points of each frame by its number."""
    if isinstance(document, list):
        document = dict(enumerate(document))
    if not isinstance(document, dict) or not document:
        raise SpecError(
            "these are not annotations", path=path, required="an object, frame -> points"
        )
    frames: dict[int, Any] = {}
    for key, points in document.items():
        if not _NUMBER.fullmatch(str(key)):
            raise SpecError(
                "a frame has no number",
                path=path,
                where=str(key)[:40],
                required="1 to 9 digits, as in the names of the images",
            )
        if int(key) in frames:
            raise SpecError("two entries have the same frame number", path=path, where=str(key))
        frames[int(key)] = points
    counts = {len(points) if _lists(points) else -1 for points in frames.values()}
    if len(counts) != 1 or min(counts) < 1:
        raise SpecError(
            "the frames do not list the same points",
            path=path,
            found=f"lists of {sorted(counts)} points" if min(counts) >= 0 else "no lists",
            required="one list of points in every frame, in one order",
            fix="Write an entry frame -> [[[u, v]], …] for each image; a version of the cloth "
            "script writes pixel -> vertex instead, from which the frames cannot be recovered.",
        )
    return frames


def _positions(points: Any, where: str, path: Path) -> FloatArray:
    """Return the points of one frame, float64 (N, 2); NaN where hidden."""
    result = np.full((len(points), 2), np.nan)
    for index, pixels in enumerate(points):
        if pixels == []:
            continue
        if _is_pixel(pixels):  # some of the scripts write a pixel without a list around it
            pixels = [pixels]
        try:
            values = np.array(pixels, np.float64)
        except (TypeError, ValueError, OverflowError):
            values = np.zeros(0)
        if values.ndim != 2 or values.shape[1] != 2:
            raise SpecError(
                "a point is not a list of pixels",
                path=path,
                where=f"{where}, point {index}",
                found=f"{pixels!r:.60}",
                required="[[u, v], …], or [] where it is hidden",
            )
        result[index] = values.mean(axis=0)
    return result


def _lists(points: Any) -> bool:
    return isinstance(points, list) and not all(isinstance(p, int | float) for p in points)


def _is_pixel(value: Any) -> bool:
    numbers = isinstance(value, list) and all(isinstance(each, int | float) for each in value)
    return numbers and len(value) == 2
