"""Draws image pairs as SVG: the two frames side by side with symbols over them."""

from __future__ import annotations

import base64
import colorsys
import html
import io
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.evaluator.arrays import FloatArray
from pliant.evaluator.report.examples import Example
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.storage import layout

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
        f'<svg class="pair" role="img" aria-label="{html.escape(label)}" '
        f'viewBox="0 0 {left + width:g} {height:g}" xmlns="http://www.w3.org/2000/svg">{source}'
        f'<svg x="{left:g}" y="0" width="{width}" height="{height}">{target}</svg>{over}</svg>'
    )


def pair_svg(example: Example, dataset: Dataset | None, size: tuple[int, int]) -> str:
    """Draw a pair: the source with its queries, the target with truth and answers.

    A colour identifies a query. In the target a ring is the truth, a disc the answer, and the
    line between them the error; answers outside the image are clipped.

    Args:
        example: The pair.
        dataset: Where the images are; None, or one without images, leaves plain panels.
        size: (width, height) of the images.
    """
    draw = Symbols(size[0])
    colours = [_colour(index, len(example.uv_a_px)) for index in range(len(example.uv_a_px))]
    queries = [draw.disc(uv, colour) for uv, colour in zip(example.uv_a_px, colours, strict=True)]
    answers = np.clip(example.answer_px, -2 * size[0], 3 * size[0])
    found = list(zip(example.true_px, answers, colours, strict=True))
    errors = [draw.line(truth, answer, colour) for truth, answer, colour in found]
    points = [draw.ring(truth, c) + draw.disc(answer, c) for truth, answer, c in found]
    return side_by_side(
        panel_svg(dataset, example.sequence_a, example.frame_a, size) + "".join(queries),
        panel_svg(dataset, example.sequence_b, example.frame_b, size) + "".join(errors + points),
        size,
        f"{example.rank} pair of {example.tier}",
    )


def _colour(index: int, count: int) -> str:
    red, green, blue = colorsys.hsv_to_rgb(index / max(count, 1) * 0.9, 0.75, 0.95)
    return f"#{int(red * 255):02x}{int(green * 255):02x}{int(blue * 255):02x}"


def panel_svg(dataset: Dataset | None, sequence: str, frame: int, size: tuple[int, int]) -> str:
    """Draw one image, or a plain panel where there is none."""
    shape = f'width="{size[0]}" height="{size[1]}"'
    rgb = None if dataset is None else _image(dataset, sequence, frame)
    if rgb is None:
        return f'<rect {shape} fill="#dfe3e6"/>'
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "JPEG", quality=85)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'<image {shape} href="data:image/jpeg;base64,{data}"/>'


def _image(dataset: Dataset, sequence: str, frame: int) -> npt.NDArray[np.uint8] | None:
    """Return a frame, or None where the dataset has no such image (or a broken one)."""
    try:
        found = dataset.sequence(sequence)
        return found.rgb(frame) if found.has(layout.rgb_name(frame)) else None
    except SpecError:
        return None
