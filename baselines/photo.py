"""Any two pictures as views: photographs, with masks where somebody drew them."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps

from pliant.baselines.matcher import View
from pliant.spec.errors import CallError, PliantError
from pliant.spec.io.limits import MAX_IMAGE_SIDE_PX

BLACK: Final = 10
"""Brightest value of a mask's channel that still counts as black (JPEG is never quite)."""


def read_photo(path: Path | str) -> npt.NDArray[np.uint8]:
    """Read a picture of any common format as 8-bit RGB, the way viewers show it.

    Turned by its EXIF orientation; transparency over black; 16-bit grey by its upper 8 bits.

    Args:
        path: The file.

    Returns:
        uint8 (H, W, 3).

    Raises:
        CallError: There is no such file.
        PliantError: It is no picture that can be read, or too large.
    """
    path = Path(path)
    if not path.is_file():
        raise CallError("there is no such picture", path=path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path) as opened:
                if max(opened.size) > MAX_IMAGE_SIDE_PX:
                    raise PliantError(
                        "the picture is too large",
                        path=path,
                        found=f"{opened.width}x{opened.height}",
                        required=f"at most {MAX_IMAGE_SIDE_PX} px a side",
                    )
                picture = ImageOps.exif_transpose(opened)
                return _eight_bit(picture)
    except PliantError:
        raise
    except Exception as error:  # Pillow's decoders share no base
        raise PliantError(f"the picture cannot be read ({error})", path=path) from error


def read_view(picture: Path | str, mask: Path | str | None = None) -> View:
    """Read a picture, and a mask of the object in it, as a view.

    Args:
        picture: The picture.
        mask: A picture of the same size whose pixels are black beside the object (a picture
            with a black background is its own mask), or None.

    Raises:
        CallError: A file is missing, the sizes differ, or the mask is black all over.
        PliantError: A file is no picture that can be read.
    """
    rgb = read_photo(picture)
    if mask is None:
        return View(rgb=rgb, key=str(picture))
    on = (read_photo(mask) > BLACK).any(axis=2)
    if on.shape != rgb.shape[:2]:
        raise CallError(
            "the mask is not of the picture's size",
            path=mask,
            found=f"{on.shape[1]}x{on.shape[0]}",
            required=f"{rgb.shape[1]}x{rgb.shape[0]}",
        )
    if not on.any():
        raise CallError("the mask is black all over", path=mask)
    return View(rgb=rgb, mask=on, key=str(picture))


def _eight_bit(picture: Image.Image) -> npt.NDArray[np.uint8]:
    if picture.mode.startswith("I"):  # 16-bit grey, which Pillow would clip at 255
        grey = (np.clip(np.asarray(picture, dtype=np.int64), 0, 65535) >> 8).astype(np.uint8)
        return np.repeat(grey[..., None], 3, axis=2)
    if "A" in picture.getbands() or "transparency" in picture.info:
        layered = picture.convert("RGBA")
        picture = Image.alpha_composite(Image.new("RGBA", layered.size, "black"), layered)
    return np.asarray(picture.convert("RGB"), dtype=np.uint8).copy()
