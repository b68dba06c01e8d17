"""Pictures of different sizes on one canvas, and the clip that they become.

Each picture is reduced only as far as it must be, keeps its proportions, and is at the upper left,
with black to the right and below. A position is multiplied by exactly the factor that its picture
was resized by, so the truth stays exact; the factors are in the dataset's provenance.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal
from unicodedata import normalize

import numpy as np
import numpy.typing as npt

from pliant.converters.annotations import Annotations, read_rows
from pliant.converters.clip import Clip
from pliant.spec.arrays import FloatArray, ImageArray, Mask
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io import limits
from pliant.spec.io.photo import SUFFIXES, photo_size, read_depth, read_mask, read_photo
from pliant.spec.io.resizing import resize_nearest, resize_rgb

Pixels = Literal["rounded", "index"]
"""What a number is: `rounded`, a position from the corner, perhaps rounded to the nearest pixel
border, as the paper's scripts write it; `index`, the column and row of a pixel, whose centre is
half a pixel further."""


@dataclass(frozen=True)
class Canvas:
    """Pictures brought to one size.

    Attributes:
        pictures: The files.
        wanted: (width, height) asked for, or None for the smallest that all of them fit in.
    """

    pictures: Sequence[Path]
    wanted: tuple[int, int] | None = None

    @cached_property
    def original(self) -> list[tuple[int, int]]:
        """(width, height) of each picture, px."""
        return [photo_size(picture) for picture in self.pictures]

    @cached_property
    def names(self) -> list[str]:
        """Name of each picture; where they are in several folders, with its folder."""
        folder = os.path.commonpath([picture.parent for picture in self.pictures])
        return [picture.relative_to(folder).as_posix() for picture in self.pictures]

    @cached_property
    def size(self) -> tuple[int, int]:
        """(width, height) of the canvas, px."""
        if self.wanted is not None:
            return self.wanted
        width, height = (max(sides) for sides in zip(*self.original, strict=True))
        scale = min(
            1.0,
            limits.MAX_IMAGE_SIDE_PX / max(width, height),
            (limits.MAX_IMAGE_PIXELS / (width * height)) ** 0.5,
        )
        return int(width * scale), int(height * scale)

    def placed(self, frame: int) -> tuple[int, int]:
        """Return (width, height) of a picture on the canvas, px."""
        width, height = self.original[frame]
        scale = min(self.size[0] / width, self.size[1] / height)
        if self.wanted is None:
            scale = min(1.0, scale)
        return max(1, round(width * scale)), max(1, round(height * scale))

    def scales(self) -> FloatArray:
        """Return the factors of u and v of each picture, float64 (T, 2)."""
        placed = [self.placed(frame) for frame in range(len(self.pictures))]
        return np.array(placed, float) / np.array(self.original, float)

    def read(self, frame: int) -> ImageArray:
        """Return a picture on the canvas, uint8 (H, W, 3)."""
        return self._filled(resize_rgb(read_photo(self.pictures[frame]), self.placed(frame)), 0)

    def read_mask(self, path: Path, frame: int) -> Mask:
        """Return a picture's mask on the canvas, bool (H, W)."""
        mask = read_mask(path, self.original[frame])
        return self._filled(resize_nearest(mask, self.placed(frame)), False)

    def read_depth(self, path: Path, frame: int) -> npt.NDArray[np.float32]:
        """Return a picture's depth on the canvas, float32 (H, W), metres."""
        depth_m = read_depth(path, self.original[frame])
        return self._filled(resize_nearest(depth_m, self.placed(frame)), np.inf)

    def _filled(self, values: npt.NDArray[Any], empty: float) -> npt.NDArray[Any]:
        shape = (self.size[1], self.size[0], *values.shape[2:])
        canvas = np.full(shape, empty, values.dtype)
        canvas[: values.shape[0], : values.shape[1]] = values
        return canvas

    def facts(self) -> list[dict[str, Any]]:
        """Return what became of each picture, for the provenance."""
        return [
            {"name": name, "size": list(size), "placed": list(self.placed(frame))}
            for frame, (name, size) in enumerate(zip(self.names, self.original, strict=True))
        ]


@dataclass(frozen=True)
class PictureOptions:
    """How annotated pictures are read.

    Attributes:
        pixels: What the numbers are: positions from the corner, or indices of pixels.
        temporal: Whether the pictures follow each other in time.
        pairs: A CSV of the pairs to ask about, columns `source` and `target`; None for no list.
        size: (width, height) of the canvas, px; None for the smallest that all pictures fit in.
        masks: A folder of masks, one for each picture; None for those of the source, if any.
        depth: A folder of depth images, one for each picture, or None.
    """

    pixels: Pixels = "rounded"
    temporal: bool = False
    pairs: Path | None = None
    size: tuple[int, int] | None = None
    masks: Path | None = None
    depth: Path | None = None


def clip_of(annotations: Annotations, options: PictureOptions) -> Clip:
    """Return annotated pictures as a clip.

    Args:
        annotations: The pictures and the points in them.
        options: How.

    Raises:
        CallError: A picture has no mask or no depth image in the folder given.
        SpecError: A picture or the list of pairs cannot be read.
    """
    canvas = Canvas(annotations.pictures, options.size)
    uv_px = annotations.uv_px + (0.5 if options.pixels == "index" else 0.0)
    masks = _companions(annotations.pictures, options.masks or annotations.masks)
    depths = _companions(annotations.pictures, options.depth)
    name = annotations.path.stem if annotations.path.is_file() else annotations.path.name
    return Clip(
        name=name,
        size=canvas.size,
        frames=len(annotations.pictures),
        read=canvas.read,
        uv_px=uv_px * canvas.scales(),
        visible=annotations.visible,
        temporal=options.temporal,
        pairs=None if options.pairs is None else _read_pairs(options.pairs, canvas.names),
        facts={
            "pictures": canvas.facts(),
            "points": list(annotations.points),
            "not_said": list(annotations.unsaid),
        },
        read_mask=None if masks is None else lambda k: canvas.read_mask(masks[k], k),
        read_depth=None if depths is None else lambda k: canvas.read_depth(depths[k], k),
    )


def _companions(pictures: Sequence[Path], folder: Path | None) -> list[Path] | None:
    """Return the file of a folder that belongs to each picture: the same name, another ending.

    `000000_visible_mask.png` belongs to `000000_rgb.png`, as the paper's scripts name them.
    """
    if folder is None:
        return None
    if not folder.is_dir():
        raise CallError("folder not found", path=folder)
    files: dict[str, list[Path]] = {}
    for file in sorted(folder.iterdir()):
        if file.is_file():
            files.setdefault(normalize("NFC", file.stem), []).append(file)
    found: dict[Path, Path] = {}
    for picture in pictures:
        whole = normalize("NFC", picture.stem)  # macOS may store ä as a and its dots
        stem = whole.removesuffix("_rgb")
        names = (
            whole,
            stem,
            *(f"{stem}_{end}" for end in ("visible_mask", "mask", "depth")),
        )
        name = next((name for name in names if name in files), None)
        if name is None:
            raise CallError(
                "a picture has no file in the folder",
                path=folder,
                where=picture.name,
                required=" or ".join(f"{each}.*" for each in dict.fromkeys(names[:3])),
            )
        # A list of polygons or labels may be next to the images.
        images = [file for file in files[name] if file.suffix.lower() in (*SUFFIXES, ".npy")]
        file, *others = images or files[name]
        if others:
            raise CallError(
                "a picture has several files in the folder",
                path=folder,
                where=picture.name,
                found=", ".join(each.name for each in (file, *others)),
                fix="Leave one of them.",
            )
        if file in found:
            raise CallError(
                "one file in the folder is for two pictures",
                path=file,
                found=f"{found[file]} and {picture}",
                fix="Give the pictures, and their files in the folder, different names.",
            )
        found[file] = picture
    return list(found)


def _read_pairs(path: Path, names: Sequence[str]) -> list[tuple[int, int]]:
    rows = read_rows(path, ("source", "target"))
    frames = {normalize("NFC", name): frame for frame, name in enumerate(names)}
    pairs = []
    for where, row in rows:
        row = {side: normalize("NFC", name) for side, name in row.items()}
        for side in ("source", "target"):
            if row[side] not in frames:
                raise SpecError(
                    "a pair names a picture that has no annotations",
                    path=path,
                    where=f"{where}, {side}",
                    found=repr(row[side])[:80],
                    required=f"one of {', '.join(names[:5])}{' …' if len(names) > 5 else ''}",
                )
        pair = (frames[row["source"]], frames[row["target"]])
        if pair[0] == pair[1] or pair in pairs:
            said = "a picture with itself" if pair[0] == pair[1] else "a pair twice"
            raise SpecError(f"the list has {said}", path=path, where=where, fix="Remove the row.")
        pairs.append(pair)
    if not pairs:
        raise SpecError("the list has no pairs", path=path)
    return pairs
