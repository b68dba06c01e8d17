"""The figure of a match between two pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.matcher import Heat, written_familiarity
from pliant.spec.errors import CallError
from pliant.spec.frame import Frame
from pliant.spec.io.writing import replacing, require_folder
from pliant.viewer.drawing import Window, check_ending, dimmed, heat_range, show
from pliant.viewer.photo_match import PhotoMatch, PointMatch

FORMATS: Final = (".png", ".pdf", ".svg", ".jpg")

_WIDTH_IN: Final = 5.2  # mean width of a picture, inches
_HEIGHT_IN: Final = (2.4, 6.0)  # lowest and largest height of the pictures, inches
_LONGEST: Final = 4.0  # most that a picture's place is longer than wide, or wider than long
_ROOM: Final = 0.08  # around the object, in its longer sides
_LEAST_WEIGHT: Final = 0.05  # of a mode whose ring is drawn
_NUMBERED: Final = 40  # more points have colours alone
_QUERY_COLOUR: Final = "#00c8ff"
_MATCH_COLOUR: Final = "#ff2d78"


def check_figure_path(path: Path) -> None:
    """Refuse a figure that could not be written.

    Args:
        path: The file to be written.

    Raises:
        CallError: Its folder is missing or read-only, or it has an unknown ending.
    """
    check_ending(path, FORMATS)
    if path.is_dir():
        raise CallError("the output is a folder, not a file", path=path)
    require_folder(path.parent)


def draw_match(match: PhotoMatch, source: Frame, target: Frame, out: Path) -> None:
    """Draw the queries, their matches and, of a single one, the heat map where there is one.

    Args:
        match: From `match_photo`.
        source: The picture with the queries.
        target: The picture with the matches.
        out: The figure to write, png, pdf, svg or jpg; an earlier one is replaced.

    Raises:
        CallError: The file cannot be written.
    """
    check_figure_path(out)
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    single = match.points[0] if len(match.points) == 1 else None
    heat = None if single is None else single.heat
    cropped = source.mask is not None and target.mask is not None
    frame_a = _window(source, cropped, [point.uv_a_px for point in match.points])
    frame_b = _window(target, cropped, [point.uv_b_px for point in match.points])
    frames = [frame_a, frame_b] if heat is None else [frame_a, frame_b, frame_b]
    # All pictures get one height, so that pictures of unlike shapes are in one row.
    exact = [(right - left) / (bottom - top) for left, right, bottom, top in frames]
    shapes = [min(max(shape, 1 / _LONGEST), _LONGEST) for shape in exact]
    tall = float(np.clip(_WIDTH_IN * len(frames) / sum(shapes), *_HEIGHT_IN))
    wide = tall * sum(shapes) + 0.3
    headline = _wrapped(_headline(match, single), 12, wide)
    warnings = "\n".join(_wrapped(warning, 9, wide) for warning in match.warnings())
    lines = headline.count("\n") + len(warnings.splitlines())
    below = (0.75 if heat is None else 1.35) + 0.2 * lines  # texts and bar, inches
    figure = Figure(figsize=(wide, tall + below), dpi=110)
    rows = [tall] if heat is None else [tall, 0.14]
    grid = figure.add_gridspec(len(rows), len(frames), width_ratios=shapes, height_ratios=rows)
    axes = [figure.add_subplot(grid[0, column]) for column in range(len(frames))]
    titles = [f"source, {len(match.points)} queries", "target, matches"]
    if single is not None:
        at_a, at_b = single.uv_a_px * match.scale_a, single.uv_b_px * match.scale_b
        rings = ", rings: 2 std. dev." if _rings(axes[1], single) else ""
        titles = [
            f"source, query at ({_numbers(at_a)})",
            f"target, match at ({_numbers(at_b)}){rings}",
            f"heat map of {match.method} over the target",
        ]
    images = [source.rgb, target.rgb]
    if heat is not None:
        images.append(dimmed(target.rgb))
    for axis, image, title, frame, shape in zip(axes, images, titles, frames, shapes, strict=False):
        show(axis, image, _wrapped(title, 10, tall * shape), frame)
    if single is None:
        _numbered(axes, match)
    else:
        _mark(axes[0], single.uv_a_px, _QUERY_COLOUR)
        _mark(axes[1], single.uv_b_px, _MATCH_COLOUR)
    if single is not None and heat is not None:
        shown = _heat(axes[2], heat)
        if shown is not None:
            bar = figure.colorbar(
                shown, cax=figure.add_subplot(grid[1, 2]), orientation="horizontal"
            )
            bar.set_label(_wrapped(heat.label, 9, tall * shapes[2]), fontsize=9)
            bar.ax.tick_params(labelsize=8)
            if bar.solids is not None:
                bar.solids.set_alpha(1.0)
        _mark(axes[2], single.uv_b_px, _MATCH_COLOUR)
    figure.suptitle(headline, fontsize=12)
    if warnings:
        figure.supxlabel(warnings, fontsize=9, color="#b00020")
    # A figure that has a layout engine would be drawn twice, first for the layout alone.
    ConstrainedLayoutEngine().execute(figure)
    # Half the time of Pillow's own level, and 10 % more bytes.
    png: dict[str, Any] = (
        {"pil_kwargs": {"compress_level": 4}} if out.suffix.lower() == ".png" else {}
    )
    with replacing(out) as partial:
        figure.savefig(partial, **png)


def _numbered(axes: list[Any], match: PhotoMatch) -> None:
    """Draw every query and its match in one colour and with one number."""
    from matplotlib import colormaps

    count = len(match.points)
    for number, point in enumerate(match.points):
        colour = colormaps["turbo"](0.05 + 0.9 * number / max(1, count - 1))
        for axis, uv_px in ((axes[0], point.uv_a_px), (axes[1], point.uv_b_px)):
            # Marks are over the numbers of their neighbours, which may not hide a match.
            axis.plot(*uv_px, "o", ms=7, mfc=colour, mec="white", mew=1.2, zorder=4)
            if count <= _NUMBERED:
                axis.annotate(
                    str(number + 1),
                    uv_px.astype(float),
                    xytext=(5, 4),
                    textcoords="offset points",
                    fontsize=8,
                    color="white",
                    bbox={"boxstyle": "round,pad=0.15", "fc": "#000000a0", "lw": 0},
                )


def _headline(match: PhotoMatch, single: PointMatch | None) -> str:
    parts = [match.method]
    if single is None:
        return f"{match.method}, {len(match.points)} points"
    confidence = match.confidence(single)
    if confidence is not None:
        parts.append(f"confidence {confidence:.2f} ({match.confidence_is(single)})")
    if single.visible is not None:
        parts.append(f"visible with probability {single.visible:.2f}")
    if single.sigma_px is not None:
        width = float(np.sqrt(match.scale_b.prod()))
        parts.append(f"standard deviation {single.sigma_px * width:.1f} px")
    if single.familiarity is not None:
        parts.append(f"familiarity {written_familiarity(single.familiarity)}")
    return ", ".join(parts)


def _wrapped(text: str, size_pt: int, wide: float) -> str:
    """Return a text in lines that fit into so many inches; a letter is half as wide as tall."""
    return fill(text, max(12, int(wide * 72 / (0.55 * size_pt))))


def _numbers(uv_px: npt.NDArray[Any]) -> str:
    return f"{uv_px[0]:.1f}, {uv_px[1]:.1f}"


def _window(view: Frame, cropped: bool, marks: Sequence[npt.NDArray[np.float32]]) -> Window:
    """Return what to show, (left, right, bottom, top) in px: object and marks with room, or all."""
    height, width = view.rgb.shape[:2]
    if view.mask is None or not cropped or not view.mask.any():
        return 0, width, height, 0
    u, v = np.concatenate([np.argwhere(view.mask)[:, ::-1] + 0.5, marks]).T
    room = _ROOM * max(np.ptp(v), np.ptp(u)) + 8
    return (
        max(0, u.min() - room),
        min(width, u.max() + room),
        min(height, v.max() + room),
        max(0, v.min() - room),
    )


def _mark(axes: Any, uv_px: npt.NDArray[np.float32], colour: str) -> None:
    for size, line, inked in ((17, 3.4, "black"), (17, 1.8, colour)):
        axes.plot(
            *uv_px,
            marker="o",
            markersize=size,
            markerfacecolor="none",
            markeredgecolor=inked,
            markeredgewidth=line,
            clip_on=False,
            in_layout=False,  # a match may be far outside the picture
        )
    # A point in place of a cross: the pixel itself stays in sight.
    axes.plot(*uv_px, marker="o", markersize=2.4, markerfacecolor=colour, markeredgewidth=0)


def _rings(axes: Any, match: PointMatch) -> int:
    """Draw two standard deviations around the answer or its modes; return how many rings."""
    from matplotlib.patches import Circle

    rings = [ring for ring in match.mixture.astype(float) if ring[3] >= _LEAST_WEIGHT]
    for u, v, sigma, weight in rings:
        ring = Circle((u, v), 2 * sigma, fill=False, color=_MATCH_COLOUR, linewidth=1.4)
        ring.set_alpha(max(weight, 0.35))
        axes.add_patch(ring)
    return len(rings)


def _heat(axes: Any, heat: Heat) -> Any:
    """Draw the values where there are any; None if there are none.

    What has been looked at and is impossible (-inf) gets the lowest colour; what has not been
    looked at (NaN) gets none.
    """
    if not np.isfinite(heat.values).any():
        return None
    low, high = heat_range(heat)
    height, width = heat.values.shape
    return axes.imshow(
        np.ma.masked_invalid(np.maximum(heat.values, low)),
        extent=(0, width, height, 0),
        cmap="viridis",
        vmin=low,
        vmax=max(high, low + 1e-12),
        interpolation="nearest",
        alpha=0.85,  # a heat map over all of a picture leaves it to be seen
    )
