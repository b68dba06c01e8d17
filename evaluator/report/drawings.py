"""Draws image pairs with their queries, truth and answers, as one SVG each."""

from __future__ import annotations

import base64
import colorsys
import io

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.evaluator.report.examples import Example
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.storage import layout

PAIR_GAP = 12
"""Gap between the two images of a pair, in symbol units (image width over 160)."""


def pair_svg(example: Example, dataset: Dataset | None, size: tuple[int, int]) -> str:
    """Draw a pair: the source with its queries, the target with truth and answers.

    A colour names a query. In the target a ring is the truth, a disc the answer, and the line
    between them the error; an answer outside the image is drawn at the end of its line, cut off
    at the border.

    Args:
        example: The pair.
        dataset: Where the images are; None, or one without images, leaves plain panels.
        size: (width, height) of the images.
    """
    width, height = size
    unit = width / 160  # symbols keep their size relative to the picture
    shift = width + PAIR_GAP * unit
    total = shift + width
    parts = [
        f'<svg class="pair" role="img" aria-label="{example.rank} pair of {_escape(example.tier)}" '
        f'viewBox="0 0 {total:g} {height:g}" xmlns="http://www.w3.org/2000/svg">',
        f'<defs><clipPath id="clip-{example.pair}-{example.rank}"><rect x="{shift:g}" y="0" '
        f'width="{width}" height="{height}"/></clipPath></defs>',
        panel_svg(dataset, example.sequence_a, example.frame_a, 0.0, size),
        panel_svg(dataset, example.sequence_b, example.frame_b, shift, size),
    ]
    colours = [_colour(index, len(example.uv_a_px)) for index in range(len(example.uv_a_px))]
    for (u, v), colour in zip(example.uv_a_px, colours, strict=True):
        parts.append(_disc(u, v, colour, unit))
    parts.append(f'<g clip-path="url(#clip-{example.pair}-{example.rank})">')
    for truth, answer, colour in zip(example.true_px, example.answer_px, colours, strict=True):
        near = np.clip(answer, -2 * width, 3 * width)
        parts.append(
            f'<path d="M{truth[0] + shift:.2f} {truth[1]:.2f}L{near[0] + shift:.2f} {near[1]:.2f}" '
            f'stroke="{colour}" stroke-width="{0.7 * unit:g}" fill="none"/>'
        )
    for truth, answer, colour in zip(example.true_px, example.answer_px, colours, strict=True):
        parts.append(
            f'<circle cx="{truth[0] + shift:.2f}" cy="{truth[1]:.2f}" r="{2.1 * unit:g}" '
            f'fill="none" stroke="{colour}" stroke-width="{0.8 * unit:g}"/>'
        )
        near = np.clip(answer, -2 * width, 3 * width)
        parts.append(_disc(near[0] + shift, near[1], colour, unit))
    parts.append("</g></svg>")
    return "".join(parts)


def _disc(u: float, v: float, colour: str, unit: float) -> str:
    return (
        f'<circle cx="{u:.2f}" cy="{v:.2f}" r="{1.3 * unit:g}" fill="{colour}" '
        f'stroke="#fff" stroke-width="{0.35 * unit:g}"/>'
    )


def _colour(index: int, count: int) -> str:
    red, green, blue = colorsys.hsv_to_rgb(index / max(count, 1) * 0.9, 0.75, 0.95)
    return f"#{int(red * 255):02x}{int(green * 255):02x}{int(blue * 255):02x}"


def panel_svg(
    dataset: Dataset | None, sequence: str, frame: int, x: float, size: tuple[int, int]
) -> str:
    """Draw one image of a pair at a horizontal offset, or a plain panel where there is none."""
    width, height = size
    rgb = None if dataset is None else _image(dataset, sequence, frame)
    if rgb is None:
        return f'<rect x="{x:g}" y="0" width="{width}" height="{height}" fill="#dfe3e6"/>'
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "JPEG", quality=85)
    data = base64.b64encode(buffer.getvalue()).decode()
    return (
        f'<image x="{x:g}" y="0" width="{width}" height="{height}" '
        f'href="data:image/jpeg;base64,{data}"/>'
    )


def _image(dataset: Dataset, sequence: str, frame: int) -> npt.NDArray[np.uint8] | None:
    """Return a frame, or None where the dataset has no such image (or a broken one)."""
    try:
        found = dataset.sequence(sequence)
        if not found.has(layout.rgb_name(frame)):
            return None
        return found.rgb(frame)
    except SpecError:
        return None


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
