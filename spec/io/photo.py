"""Pictures of any common format: photographs, masks, and depth images of a camera."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps

from pliant.spec.errors import CallError, PliantError
from pliant.spec.io.limits import MAX_IMAGE_SIDE_PX
from pliant.spec.io.resizing import resize_rgb, with_longer_side

SUFFIXES: Final = (
    ".jpg",
    ".jpeg",
    ".png",
    ".tif",
    ".tiff",
    ".webp",
    ".avif",
    ".jp2",
    ".tga",
    ".bmp",
    ".gif",
)
"""Endings of files that are taken for pictures when a folder is listed."""

BLACK: Final = 10
"""Brightest value of a mask's channel that still counts as black (JPEG is never quite)."""

_FLOATING: Final = "F"
_INTEGER: Final = "I"
_LABELS: Final = 64
"""A lossless grey picture without a brighter value is an image of labels, not a drawing."""

_FEW: Final = 8
"""Values, 0 among them, that a lossless grey mask of labels has at most; noise has more."""

_LOSSY: Final = ("JPEG", "WEBP", "JPEG2000", "AVIF")
"""Pillow's formats whose values may not be those that were stored."""

_WHITE: Final = 1 / 3
"""Least share of a lossy mask that is white, if it is drawn in black and white.

At JPEG quality 30, 0.4 of what is not black around a thin rope is white; the rest is ringing.
"""

_HEIC: Final = (b"heic", b"heix", b"mif1", b"msf1")
"""Brands of files that iPhones write."""

_MILLIMETRES_PER_METRE: Final = 1000.0
_FARTHEST_M: Final = 100.0  # median of a depth image; what is in millimetres has more
_TURNED: Final = (5, 6, 7, 8)  # EXIF orientations that exchange width and height


def read_photo(path: Path | str, max_side: int | None = None) -> npt.NDArray[np.uint8]:
    """Read a picture as 8-bit RGB, the way viewers show it.

    Turned by its EXIF orientation; transparency over black; 16-bit grey by its upper 8 bits.

    Args:
        path: The file.
        max_side: The longer side of a larger picture is reduced to so many pixels, each the mean of
            the area it covers; None leaves it.

    Returns:
        uint8 (H, W, 3).

    Raises:
        CallError: The file is not found.
        PliantError: It is not a picture that can be read, or too large.
    """
    path = _existing(path)
    try:
        return decode_photo(path, max_side)
    except Exception as error:  # Pillow's decoders share no base
        raise _unreadable(path, error) from error


def decode_photo(source: Path | IO[bytes], max_side: int | None = None) -> npt.NDArray[np.uint8]:
    """Decode a picture; see `read_photo`.

    Raises:
        ValueError: It is larger than pictures may be.
        Exception: Pillow's decoders share no base.
    """
    with _opened(source) as opened:
        ImageOps.exif_transpose(opened, in_place=True)
        picture = _eight_bit(opened)
        rgb = np.array(picture, dtype=np.uint8)
        if max_side is None or max(picture.size) <= max_side:
            return rgb
        return resize_rgb(rgb, with_longer_side(picture.size, max_side))


def encoded(picture: Image.Image, form: str, **options: Any) -> bytes:
    """Return a picture as the bytes of a file.

    Args:
        picture: The picture.
        form: Pillow's name of the format, such as `PNG`.
        options: Pillow's options of the format.
    """
    buffer = io.BytesIO()
    picture.save(buffer, form, **options)
    return buffer.getvalue()


def photo_size(path: Path | str) -> tuple[int, int]:
    """Return (width, height) of a picture after its EXIF orientation, from its header.

    Raises:
        CallError: The file is not found.
        PliantError: It is not a picture that can be read, or too large.
    """
    path = _existing(path)
    try:
        with _opened(path) as opened:
            width, height = opened.size
            # Pillow gives the size of a TIFF as it is after its orientation.
            turned = opened.format != "TIFF" and opened.getexif().get(0x0112) in _TURNED
    except Exception as error:  # Pillow's decoders share no base
        raise _unreadable(path, error) from error
    return (height, width) if turned else (width, height)


def read_mask(path: Path | str, size: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Read a mask: a picture that is black outside the object, or an image of labels, 0 outside.

    Args:
        path: The file; a picture of an object on black is its own mask.
        size: (width, height) of the picture that it belongs to, px.

    Returns:
        bool (H, W), True on the object.

    Raises:
        CallError: It is missing.
        PliantError: It is not a picture that can be read, of another size, black everywhere, or
            black nowhere and of several values; of one value, the object fills the picture. Or a
            few labels are so dark that they count as black, next to fewer bright pixels.
    """
    path = _existing(path, "mask")
    try:
        with _opened(path) as opened:
            numbers, lossy = opened.mode in (_FLOATING, _INTEGER), opened.format in _LOSSY
            ImageOps.exif_transpose(opened, in_place=True)
            _check_size("mask", path, opened.size, size)
            labels = np.asarray(opened)
            rgb = np.zeros((*labels.shape, 1)) if numbers else np.asarray(_eight_bit(opened))
    except Exception as error:  # Pillow's decoders share no base
        raise _unreadable(path, error, "mask") from error
    values = rgb.max(axis=2)
    mask = values > BLACK
    if lossy and np.count_nonzero(values > 255 - BLACK) > _WHITE * np.count_nonzero(mask):
        mask = values > 127
    if not lossy and labels.ndim == 2:
        # A palette of greys is a grey picture too; labels may be as small as 1.
        grey = labels.max() <= _LABELS and np.array_equal(values, labels)
        if grey or not mask.any() or _are_labels(path, labels, values):
            values = np.nan_to_num(labels)  # NaN is outside
            mask = values != 0
    if not mask.any() or (mask.all() and (values != values[0, 0]).any()):
        raise PliantError(
            "the mask has no black pixel" if mask.any() else "the mask is black everywhere",
            path=path,
            required="black, or label 0, outside the object only",
        )
    return mask


def _are_labels(path: Path, labels: npt.NDArray[Any], values: npt.NDArray[Any]) -> bool:
    """Return whether a grey picture with bright values has 16-bit labels.

    Args:
        path: The file.
        labels: (H, W), its numbers.
        values: (H, W), their upper eight bits.

    Raises:
        PliantError: Labels count as black next to fewer bright pixels, such as void ones of 255.
    """
    sixteen = labels.dtype.itemsize == 2
    if not np.issubdtype(labels.dtype, np.unsignedinteger) or not (
        np.array_equal(values, labels >> 8 if sixteen else labels)
    ):
        return False
    pixels = np.bincount(labels.ravel())
    found = np.flatnonzero(pixels)
    few = len(found) <= _FEW
    black = BLACK << 8 if sixteen else BLACK
    void = (1 << 16) - 1 if sixteen else _LABELS + 1
    if few and found[-1] >= void and pixels[1 : black + 1].sum() > pixels[black + 1 :].sum():
        raise PliantError(
            "the mask has dark labels next to bright values, such as 255 on void pixels",
            path=path,
            found=f"the values {', '.join(map(str, found))}",
            required="0 outside the object, and one value on it",
            fix="Write 255 on the object and 0 elsewhere.",
        )
    return sixteen and few


def read_depth(path: Path | str, size: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Read a depth image of a camera.

    Args:
        path: A 16-bit PNG or TIFF in millimetres, or a `.npy` of floating-point metres or whole
            millimetres; 0 and values that are not finite are unknown.
        size: (width, height) of the picture that it belongs to, px.

    Returns:
        float32 (H, W), planar z in metres, +inf where it is unknown.

    Raises:
        CallError: It is missing.
        PliantError: It cannot be read, is of another form or size, or cannot be in its unit.
    """
    path = _existing(path, "depth image")
    try:
        if path.suffix.lower() == ".npy":
            with open(path, "rb") as stream:  # `np.load` would also open an archive of arrays
                values = np.lib.format.read_array(stream, allow_pickle=False)
        else:
            with _opened(path) as opened:
                _check_size("depth image", path, opened.size, size)
                values = np.asarray(opened)
    except Exception as error:  # Pillow's decoders share no base
        raise _unreadable(path, error, "depth image") from error
    metres = np.issubdtype(values.dtype, np.floating)
    if values.ndim != 2 or not (metres or np.issubdtype(values.dtype, np.integer)):
        raise PliantError(
            "this is not a depth image",
            path=path,
            found=f"{values.dtype} {values.shape}",
            required="one channel: 16-bit millimetres (.png, .tif) or metres (.npy)",
        )
    if values.dtype == np.uint8:
        raise PliantError(
            "depth of 8 bits has no unit",
            path=path,
            required="16-bit millimetres (.png, .tif) or metres (.npy)",
        )
    _check_size("depth image", path, values.shape[::-1], size)
    with np.errstate(over="ignore", invalid="ignore"):
        depth_m = values.astype(np.float32) / (1 if metres else _MILLIMETRES_PER_METRE)
    known = np.isfinite(depth_m) & (depth_m > 0)
    if not known.any():
        raise PliantError("the depth image is unknown everywhere", path=path)
    median_m = float(np.median(depth_m[known]))
    if metres and median_m > _FARTHEST_M:
        raise PliantError(
            "the depth cannot be in metres",
            path=path,
            found=f"a median of {median_m:g}",
            required=f"at most {_FARTHEST_M:g} m",
            fix="If it is in millimetres, divide it by 1000.",
        )
    return np.where(known, depth_m, np.inf).astype(np.float32)


def _existing(path: Path | str, what: str = "picture") -> Path:
    path = Path(path)
    if not path.is_file():
        text = f"a {what} is needed, not a folder" if path.is_dir() else f"{what} not found"
        raise CallError(text, path=path)
    return path


@contextmanager
def _opened(source: Path | IO[bytes]) -> Iterator[Image.Image]:
    """Open a picture, unless it is too large."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of size, and of damaged EXIF data
        with Image.open(source) as opened:
            if max(opened.size) > MAX_IMAGE_SIDE_PX:
                raise ValueError(
                    f"{opened.size[0]}x{opened.size[1]} px; at most {MAX_IMAGE_SIDE_PX} px a "
                    "side: make it smaller"
                )
            yield opened


def _check_size(
    what: str, path: Path | str, found: tuple[int, ...], required: tuple[int, int]
) -> None:
    if found != required:
        raise PliantError(
            f"the {what} is not of the picture's size",
            path=path,
            found=f"{found[0]}x{found[1]}",
            required=f"{required[0]}x{required[1]}",
        )


def _unreadable(path: Path, error: Exception, what: str = "picture") -> PliantError:
    if isinstance(error, PliantError):
        return error
    with open(path, "rb") as file:
        start = file.read(12)
    if start[4:8] == b"ftyp" and start[8:] in _HEIC:
        return PliantError(
            f"the {what} cannot be read: HEIC is not supported", path=path, fix="Save it as JPEG."
        )
    said = "the file is empty" if not start else str(error).split(" '")[0].split(" <")[0][:200]
    return PliantError(f"the {what} cannot be read ({said})", path=path)


def _eight_bit(picture: Image.Image) -> Image.Image:
    """Return a picture in mode RGB: itself if it has it, as copies of 12 megapixels take time."""
    if picture.mode == _FLOATING:
        raise ValueError("its pixels are floating-point: save it with 8 or 16 bits per channel")
    if picture.mode.startswith("I"):  # 16-bit grey, which Pillow would clip at 255
        grey = np.asarray(picture, dtype=np.int64)
        if grey.min() < 0 or grey.max() > 65535:
            raise ValueError("its pixels exceed 16 bits: save it with 8 or 16 bits per channel")
        eight = picture.mode == _INTEGER and grey.max() <= 255
        return Image.fromarray((grey if eight else grey >> 8).astype(np.uint8)).convert("RGB")
    if "A" in picture.getbands() or "transparency" in picture.info:
        layered = picture.convert("RGBA")
        picture = Image.alpha_composite(Image.new("RGBA", layered.size, "black"), layered)
    return picture if picture.mode == "RGB" else picture.convert("RGB")
