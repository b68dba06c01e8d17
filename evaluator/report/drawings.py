"""Draws image pairs as SVG: the two frames side by side with symbols over them."""

from __future__ import annotations

import colorsys
import html
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.evaluator.examples import Example
from pliant.evaluator.report.pages import data_uri
from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.photo import encoded
from pliant.spec.storage import layout

_PAGE_WIDTH: Final = 480  # px of the frames that a page stores
_GAP: Final = 12  # between the two images, in units of the image width over 160


class Symbols:
    """SVG symbols whose size is relative to the image.

    Args:
        width: Image width, px.

    Points are arrays (2,) in px of the drawing.
    """

    def __init__(self, width: int) -> None:
        self._unit = width / 160
        self.target_px = width + _GAP * self._unit
        """Left edge of the target in the drawing, px."""

    def disc(self, at: FloatArray, colour: str) -> str:
        """Return a filled point."""
        return (
            f'<circle cx="{at[0]:.2f}" cy="{at[1]:.2f}" r="{1.3 * self._unit:g}" fill="{colour}" '
            f'stroke="#fff" stroke-width="{0.35 * self._unit:g}"/>'
        )

    def ring(self, at: FloatArray, colour: str) -> str:
        """Return a ring."""
        return (
            f'<circle cx="{at[0]:.2f}" cy="{at[1]:.2f}" r="{2.1 * self._unit:g}" '
            f'fill="none" stroke="{colour}" stroke-width="{0.8 * self._unit:g}"/>'
        )

    def line(self, a: FloatArray, b: FloatArray, colour: str) -> str:
        """Return a line."""
        return (
            f'<path d="M{a[0]:.2f} {a[1]:.2f}L{b[0]:.2f} {b[1]:.2f}" '
            f'stroke="{colour}" stroke-width="{0.7 * self._unit:g}" fill="none"/>'
        )


def side_by_side(
    source: str, target: str, size: tuple[int, int], label: str, over: str = ""
) -> str:
    """Return two panels side by side.

    Args:
        source: SVG elements in pixels of the left image.
        target: SVG elements in pixels of the right image; clipped to it.
        size: (width, height) of the images in px.
        label: Description for screen readers.
        over: SVG elements over both, in pixels of the whole drawing.
    """
    width, height = size
    left = Symbols(width).target_px
    return (
        f'<svg class="pair" role="img" aria-label="{html.escape(label)}" data-left="{left:g}" '
        f'viewBox="0 0 {left + width:g} {height:g}" xmlns="http://www.w3.org/2000/svg">{source}'
        f'<svg x="{left:g}" y="0" width="{width}" height="{height}">{target}</svg>{over}</svg>'
    )


class FramePictures:
    """The frames of a page as SVG images, each stored once however many pairs show it.

    Args:
        dataset: Where the images are; None, or one without images, gives plain panels.
        size: (width, height) of the images, px.
    """

    def __init__(self, dataset: Dataset | None, size: tuple[int, int]) -> None:
        self.size = size
        self._dataset = dataset
        self._ids: dict[tuple[str, int], str] = {}
        self._images: list[str] = []

    def use(self, sequence: str, frame: int) -> str:
        """Return an SVG element that shows a frame."""
        key = sequence, frame
        if key not in self._ids:
            name = f"frame-{len(self._ids)}"
            panel = panel_svg(self._dataset, sequence, frame, self.size, most_px=_PAGE_WIDTH)
            self._ids[key] = name
            self._images.append(f'<g id="{name}">{panel}</g>')
        return f'<use href="#{self._ids[key]}"/>'

    def definitions(self) -> str:
        """Return the frames used so far as one SVG element that shows nothing itself."""
        inner = "".join(self._images)
        return f'<svg width="0" height="0" style="position:absolute"><defs>{inner}</defs></svg>'


def pair_svg(example: Example, frames: FramePictures) -> str:
    """Draw a pair: the source with its queries, the target with truth and answers.

    A colour identifies a query. In the target a ring is the truth, a disc the answer, and the
    line between them the error; answers outside the image are clipped.

    Args:
        example: The pair.
        frames: The images.
    """
    size = frames.size
    draw = Symbols(size[0])
    colours = [_colour(index, len(example.uv_a_px)) for index in range(len(example.uv_a_px))]
    answers = np.clip(example.answer_px, -2 * size[0], 3 * size[0])
    source, target = "", ""
    places = zip(example.uv_a_px, example.true_px, answers, colours, strict=True)
    for index, (query, truth, answer, colour) in enumerate(places):
        source += f'<g data-q="{index}">{draw.disc(query, colour)}</g>'
        error = draw.line(truth, answer, colour) + draw.ring(truth, colour)
        target += f'<g data-q="{index}">{error}{draw.disc(answer, colour)}</g>'
    return side_by_side(
        frames.use(example.sequence_a, example.frame_a) + source,
        frames.use(example.sequence_b, example.frame_b) + target,
        size,
        f"Pair {example.pair} of {example.tier}",
    )


def _colour(index: int, count: int) -> str:
    red, green, blue = colorsys.hsv_to_rgb(index / max(count, 1) * 0.9, 0.75, 0.95)
    return f"#{int(red * 255):02x}{int(green * 255):02x}{int(blue * 255):02x}"


def panel_svg(
    dataset: Dataset | None,
    sequence: str,
    frame: int,
    size: tuple[int, int],
    *,
    most_px: int | None = None,
) -> str:
    """Draw one image, or a plain panel where there is none.

    Args:
        dataset: Where the image is.
        sequence: Its sequence.
        frame: Its number.
        size: (width, height) of the panel, px.
        most_px: Store a wider image at this width; None stores it as it is.
    """
    shape = f'width="{size[0]}" height="{size[1]}"'
    rgb = None if dataset is None else _image(dataset, sequence, frame)
    if rgb is None:
        return f'<rect {shape} fill="#dfe3e6"/>'
    picture = Image.fromarray(rgb)
    if most_px is not None:
        picture.thumbnail((most_px, most_px))
    data = encoded(picture, "JPEG", quality=85)
    return f'<image {shape} href="{data_uri(data, "image/jpeg")}"/>'


def _image(dataset: Dataset, sequence: str, frame: int) -> npt.NDArray[np.uint8] | None:
    """Return a frame, or None where the dataset has no such image (or a broken one)."""
    try:
        found = dataset.sequence(sequence)
        return found.rgb(frame) if found.has(layout.rgb_name(frame)) else None
    except SpecError:
        return None
