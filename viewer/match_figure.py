"""One query matched between two pictures, and the figure that shows it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.matcher import Answers, Heat, HeatMatcher, Matcher, View
from pliant.baselines.pixels import lies_on
from pliant.spec.errors import CallError
from pliant.spec.io.writing import replacing
from pliant.viewer.drawing import Rgb, Window, check_ending, show

FORMATS: Final = (".png", ".pdf", ".svg", ".jpg")

_WIDTH_IN: Final = 5.2  # mean width of a picture, inches
_HEIGHT_IN: Final = (2.4, 6.0)  # lowest and largest height of the pictures, inches
_ROOM: Final = 0.08  # around the object, in its longer sides
_LOWEST_SHOWN: Final = 0.05  # quantile of the heat at the lower end of the colours
_LOG_RANGE: Final = 10.0  # e^-10 of the largest is as good as nothing
_LEAST_WEIGHT: Final = 0.05  # of a mode whose ring is drawn
_QUERY_COLOUR: Final = "#00c8ff"
_MATCH_COLOUR: Final = "#ff2d78"


@dataclass(frozen=True)
class PhotoMatch:
    """Where a method sees one pixel of a picture in another one.

    Attributes:
        method: Its name.
        uv_a_px: float32 (2,), the query.
        uv_b_px: float32 (2,), the match.
        visible: Probability that the point is visible in the target, or None.
        sigma_px: Standard deviation that the method gives its answer, or None.
        modes: float32 (M, 4), the modes of the answer, or None.
        heat: Its belief over the target, or None where the method has none to show.
    """

    method: str
    uv_a_px: npt.NDArray[np.float32]
    uv_b_px: npt.NDArray[np.float32]
    visible: float | None
    sigma_px: float | None
    modes: npt.NDArray[np.float32] | None
    heat: Heat | None

    def as_dict(self) -> dict[str, Any]:
        """Return the match as a JSON object."""
        found: dict[str, Any] = {
            "method": self.method,
            "query_px": [round(float(x), 3) for x in self.uv_a_px],
            "match_px": [round(float(x), 3) for x in self.uv_b_px],
            "visible": self.visible,
            "sigma_px": self.sigma_px,
            "confidence": None if self.heat is None else self.heat.confidence,
            "confidence_is": None if self.heat is None else self.heat.confidence_label,
        }
        if self.modes is not None:
            names = ("u", "v", "sigma", "weight")
            found["modes"] = [
                dict(zip(names, map(float, mode), strict=True)) for mode in self.modes
            ]
        return found


def match_photo(
    matcher: Matcher, source: View, target: View, at_px: tuple[float, float]
) -> PhotoMatch:
    """Match one pixel.

    Args:
        matcher: The method.
        source: The picture the pixel is in.
        target: The picture to find it in.
        at_px: (u, v), centre of the first pixel at (0.5, 0.5).

    Raises:
        CallError: The pixel lies outside the source picture, or beside its mask.
    """
    uv_a_px = np.array([at_px], dtype=np.float32)  # (1, 2)
    height, width = source.rgb.shape[:2]
    if not lies_on(uv_a_px, np.ones((height, width), dtype=np.bool_))[0]:
        raise CallError(
            "the query pixel lies outside the source picture",
            where="--at",
            found=f"{at_px[0]:g},{at_px[1]:g}",
            required=f"0 <= U < {width}, 0 <= V < {height}",
        )
    if source.mask is not None and not lies_on(uv_a_px, source.mask)[0]:
        raise CallError(
            "the query pixel lies beside the object of the source mask",
            where="--at",
            found=f"{at_px[0]:g},{at_px[1]:g}",
        )
    answers: Answers = matcher.answer(source, target, uv_a_px)
    heat = matcher.heat(source, target, uv_a_px[0]) if isinstance(matcher, HeatMatcher) else None
    return PhotoMatch(
        method=matcher.name,
        uv_a_px=uv_a_px[0],
        uv_b_px=answers.uv_px[0],
        visible=None if answers.visible is None else float(answers.visible[0]),
        sigma_px=None if answers.sigma_px is None else float(answers.sigma_px[0]),
        modes=None if answers.modes is None else answers.modes[0],
        heat=heat,
    )


def check_figure_path(path: Path) -> None:
    """Refuse a figure that could not be written.

    Args:
        path: The file to be written.

    Raises:
        CallError: Its folder is missing or it has an unknown ending.
    """
    check_ending(path, FORMATS)
    if path.is_dir():
        raise CallError("a folder stands where the figure should go", path=path)
    if not path.parent.is_dir():
        raise CallError(
            "the output folder does not exist",
            path=path.parent,
            fix=f"Create it: mkdir -p {path.parent}",
        )


def draw_match(match: PhotoMatch, source: View, target: View, out: Path) -> None:
    """Draw the query, the match and, where the method has one, its heat map.

    Args:
        match: From `match_photo`.
        source: The picture with the query.
        target: The picture with the match.
        out: The figure to write, png, pdf, svg or jpg; an earlier one is replaced.

    Raises:
        CallError: The file cannot be written.
    """
    check_figure_path(out)
    from matplotlib.figure import Figure

    cropped = source.mask is not None and target.mask is not None
    frame_a, frame_b = _window(source, cropped), _window(target, cropped)
    frames = [frame_a, frame_b] if match.heat is None else [frame_a, frame_b, frame_b]
    # All pictures get one height, so that pictures of unlike shapes stand in one row.
    shapes = [(right - left) / (bottom - top) for left, right, bottom, top in frames]
    tall = float(np.clip(_WIDTH_IN * len(frames) / sum(shapes), *_HEIGHT_IN))
    below = 0.75 if match.heat is None else 1.35  # titles, and the colour bar, inches
    figure = Figure(figsize=(tall * sum(shapes) + 0.3, tall + below), layout="constrained")
    rows = [tall] if match.heat is None else [tall, 0.14]
    grid = figure.add_gridspec(len(rows), len(frames), width_ratios=shapes, height_ratios=rows)
    axes = [figure.add_subplot(grid[0, column]) for column in range(len(frames))]
    show(axes[0], source.rgb, f"source, query at ({_numbers(match.uv_a_px)})", frame_a)
    _mark(axes[0], match.uv_a_px, _QUERY_COLOUR)
    rings = ", rings: 2 std. dev." if _rings(axes[1], match) else ""
    show(axes[1], target.rgb, f"target, match at ({_numbers(match.uv_b_px)}){rings}", frame_b)
    _mark(axes[1], match.uv_b_px, _MATCH_COLOUR)
    if match.heat is not None:
        show(axes[2], _dimmed(target.rgb), f"heat map of {match.method} over the target", frame_b)
        shown = _heat(axes[2], match.heat)
        if shown is not None:
            bar = figure.colorbar(
                shown, cax=figure.add_subplot(grid[1, 2]), orientation="horizontal"
            )
            bar.set_label(match.heat.label, fontsize=9)
            bar.ax.tick_params(labelsize=8)
            if bar.solids is not None:
                bar.solids.set_alpha(1.0)
        _mark(axes[2], match.uv_b_px, _MATCH_COLOUR)
    figure.suptitle(_headline(match), fontsize=12)
    with replacing(out) as partial:
        figure.savefig(partial, dpi=110)


def _headline(match: PhotoMatch) -> str:
    parts = [match.method]
    if match.heat is not None:
        parts.append(f"confidence {match.heat.confidence:.2f} ({match.heat.confidence_label})")
    if match.visible is not None:
        parts.append(f"visible with probability {match.visible:.2f}")
    if match.sigma_px is not None:
        parts.append(f"standard deviation {match.sigma_px:.1f} px")
    return ", ".join(parts)


def _numbers(uv_px: npt.NDArray[np.float32]) -> str:
    return f"{uv_px[0]:.1f}, {uv_px[1]:.1f}"


def _window(view: View, cropped: bool) -> Window:
    """Return what to show, (left, right, bottom, top) in px: the object with room, or all."""
    height, width = view.rgb.shape[:2]
    if view.mask is None or not cropped or not view.mask.any():
        return 0, width, height, 0
    rows, columns = np.nonzero(view.mask)
    room = _ROOM * max(np.ptp(rows), np.ptp(columns)) + 8
    return (
        max(0, columns.min() - room),
        min(width, columns.max() + 1 + room),
        min(height, rows.max() + 1 + room),
        max(0, rows.min() - room),
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
        )
    # A point in place of a cross: the pixel itself stays in sight.
    axes.plot(*uv_px, marker="o", markersize=2.4, markerfacecolor=colour, markeredgewidth=0)


def _rings(axes: Any, match: PhotoMatch) -> int:
    """Draw two standard deviations around the answer or its modes; return how many rings."""
    from matplotlib.patches import Circle

    rings = [] if match.modes is None else [tuple(map(float, mode)) for mode in match.modes]
    if match.sigma_px is not None:
        rings.append((float(match.uv_b_px[0]), float(match.uv_b_px[1]), match.sigma_px, 1.0))
    rings = [ring for ring in rings if ring[3] >= _LEAST_WEIGHT]
    for u, v, sigma, weight in rings:
        ring = Circle((u, v), 2 * sigma, fill=False, color=_MATCH_COLOUR, linewidth=1.4)
        ring.set_alpha(max(weight, 0.35))
        axes.add_patch(ring)
    return len(rings)


def _dimmed(rgb: Rgb) -> Rgb:
    grey = rgb.mean(axis=2, keepdims=True) * 0.45
    return np.repeat(grey, 3, axis=2).astype(np.uint8)


def _heat(axes: Any, heat: Heat) -> Any:
    """Draw the values where there are any; None if there are none.

    Logarithms are drawn down to a factor of e^-10 of the largest. What has been looked at and
    is impossible (-inf) gets the lowest colour; what has not been looked at (NaN) gets none.
    """
    finite = heat.values[np.isfinite(heat.values)]
    if len(finite) == 0:
        return None
    low, high = float(np.quantile(finite, _LOWEST_SHOWN)), float(finite.max())
    if heat.label.startswith("log"):
        low = max(low, high - _LOG_RANGE)
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
