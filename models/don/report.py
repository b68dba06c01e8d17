"""The report of a run: curves, descriptors as colours, heat maps, calibration figures."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.baselines.matcher import View
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.validation import ValidationPair
from pliant.spec.io.writing import replacing

_PAIRS_SHOWN = 4
_HEAT_RANGE = 10.0  # e^-10 of the peak is as good as nothing


def write_run_report(
    run: Path,
    matcher: DonMatcher,
    pairs: Sequence[ValidationPair],
    history: Sequence[Mapping[str, float]],
    facts: Mapping[str, Any],
) -> Path:
    """Write `RUN/report.html`, one self-contained page.

    Args:
        run: The run's folder.
        matcher: The trained matcher.
        pairs: Validation pairs; the first few are shown.
        history: The logged figures of the run.
        facts: Label -> value, shown as a table (mappings are flattened).

    Returns:
        The page.
    """
    shown = pairs[:_PAIRS_SHOWN]
    page = report_head(run, facts)
    page += "<h2>Curves</h2>" + picture(curves_png(history), "loss and error over the steps")
    page += (
        "<h2>Descriptors</h2><p>The three main directions of the descriptors on the object, "
        "taken over all pictures, as red, green and blue: the same colour should be the same "
        "place of the object, in whatever shape.</p>"
        + picture(descriptors_png(matcher, shown), "descriptors as colours")
        + "<h2>Where the network believes a point to be</h2><p>Left the query (cross), right the "
        "log probability over the target, with the truth (circle) and the answer (cross). "
        "Validation pairs, not chosen.</p>" + picture(heat_png(matcher, shown), "heat maps")
    )
    path = run / "report.html"
    with replacing(path) as partial:
        partial.write_text(page + "</html>\n", encoding="utf-8")
    return path


def report_head(run: Path, facts: Mapping[str, Any]) -> str:
    """Return the beginning of a run's page: its title and its facts as a table.

    Args:
        run: The run's folder.
        facts: Label -> value; mappings are flattened.
    """
    rows = "".join(
        f"<tr><th>{html.escape(name)}</th><td>{html.escape(text)}</td></tr>"
        for name, text in _flat(facts)
    )
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        "<title>Training run</title><style>"
        "body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem}"
        "img{max-width:100%}th{text-align:left;padding-right:1.5rem;font-weight:500}"
        "td{font-variant-numeric:tabular-nums}p{max-width:45rem}</style>"
        f"<h1>Training run {html.escape(run.name)}</h1><table>{rows}</table>"
    )


def curves_png(history: Sequence[Mapping[str, float]]) -> bytes:
    """Return a picture of the loss and the validation errors over the steps.

    Args:
        history: The logged figures.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    trained = [row for row in history if "loss" in row]
    left.plot([row["step"] for row in trained], [row["loss"] for row in trained], linewidth=0.8)
    left.set(xlabel="step", title="training loss")
    validated = [row for row in history if "val/rmse_px" in row]
    for name, label in (
        ("val/rmse_px", "RMSE, pooled"),
        ("val/rmse_px_mean_over_pairs", "RMSE, mean over pairs"),
        ("val/median_px", "median"),
    ):
        values = [row[name] for row in validated]
        right.plot([row["step"] for row in validated], values, marker=".", label=label)
    right.set(xlabel="step", title="validation error, px", ylim=(0, None))
    if validated:
        right.legend(frameon=False)
    return figure_png(figure)


def descriptors_png(matcher: DonMatcher, pairs: Sequence[ValidationPair]) -> bytes:
    """Return a picture of frames above their descriptors as colours.

    Args:
        matcher: The matcher.
        pairs: Pairs whose frames to show.
    """
    from matplotlib.figure import Figure

    views = [view for pair in pairs[:2] for view in (pair.source, pair.target)]
    maps = [matcher.descriptor_map(view) for view in views]  # (h, w, D) each
    masks = [_mask(view, matcher) for view in views]
    colours = descriptor_colours(maps, masks)
    figure = Figure(figsize=(3 * len(views), 4.6), layout="constrained")
    axes = figure.subplots(2, len(views), squeeze=False)
    for column, (view, colour) in enumerate(zip(views, colours, strict=True)):
        axes[0, column].imshow(view.rgb)
        axes[1, column].imshow(colour)
    for axis in axes.flat:
        axis.set_axis_off()
    return figure_png(figure)


def descriptor_colours(
    maps: Sequence[npt.NDArray[np.float32]], masks: Sequence[npt.NDArray[np.bool_]]
) -> list[npt.NDArray[np.float64]]:
    """Return descriptors on the object as RGB, by their first three principal directions.

    Args:
        maps: float32 (h, w, D), descriptors of several frames.
        masks: bool (h, w), the object in each.

    Returns:
        float64 (h, w, 3), 0 to 1, white off the object; the same colours in all frames.
    """
    on = np.concatenate([m[mask] for m, mask in zip(maps, masks, strict=True)]).astype(np.float64)
    if len(on) == 0:
        return [np.ones((*mask.shape, 3)) for mask in masks]
    mean = on.mean(axis=0)
    _, _, directions = np.linalg.svd(on - mean, full_matrices=False)
    directions = directions[:3]
    if len(directions) < 3:  # fewer than three dimensions: the rest stays grey
        directions = np.vstack([directions, np.zeros((3 - len(directions), on.shape[1]))])
    low, high = np.percentile((on - mean) @ directions.T, [2, 98], axis=0)
    spread = np.where(high > low, high - low, 1.0)
    pictures = []
    for m, mask in zip(maps, masks, strict=True):
        colour = np.ones((*mask.shape, 3))
        projected = (m[mask].astype(np.float64) - mean) @ directions.T
        colour[mask] = np.clip((projected - low) / spread, 0.0, 1.0)
        pictures.append(colour)
    return pictures


def heat_png(matcher: DonMatcher, pairs: Sequence[ValidationPair]) -> bytes:
    """Return a picture of one query a pair and the belief over its target.

    Args:
        matcher: The matcher.
        pairs: The pairs.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.1 * len(pairs)), layout="constrained")
    axes = figure.subplots(len(pairs), 2, squeeze=False)
    for (left, right), pair in zip(axes, pairs, strict=True):
        query = int(np.argmax(pair.visible[:, 0]))  # the first whose truth can be seen
        uv = pair.uv_a_px[query]
        heat = matcher.heat(pair.source, pair.target, uv)
        answer = matcher.answer(pair.source, pair.target, uv[None]).uv_px[0]
        height, width = heat.values.shape
        left.imshow(pair.source.rgb, extent=(0, width, height, 0))
        left.plot(*uv, "+", color="red", markersize=12, markeredgewidth=2)
        right.imshow(pair.target.rgb, extent=(0, width, height, 0), alpha=0.25)
        shown = right.imshow(
            heat.values,
            extent=(0, width, height, 0),
            cmap="viridis",
            vmin=float(np.nanmax(heat.values)) - _HEAT_RANGE,
        )
        figure.colorbar(shown, ax=right, label=heat.label, shrink=0.8)
        right.plot(*pair.uv_b_px[query, 0], "o", mfc="none", mec="red", ms=12, mew=2)
        right.plot(*answer, "+", color="red", markersize=12, markeredgewidth=2)
        error = float(np.linalg.norm(answer - pair.uv_b_px[query, 0]))
        right.set_title(f"error {error:.1f} px of this picture", fontsize=9)
        for axis in (left, right):
            axis.set(xlim=(0, width), ylim=(height, 0))
            axis.set_axis_off()
    return figure_png(figure)


def _mask(view: View, matcher: DonMatcher) -> npt.NDArray[np.bool_]:
    mask = matcher.working_mask(view)
    return np.ones((matcher.size[1], matcher.size[0]), dtype=np.bool_) if mask is None else mask


def figure_png(figure: Any) -> bytes:
    """Return a matplotlib figure as PNG."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    return stream.getvalue()


def picture(png: bytes, alt: str) -> str:
    """Return an image element that carries its PNG inside."""
    return f'<img alt="{alt}" src="data:image/png;base64,{base64.b64encode(png).decode()}">'


def _flat(facts: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    rows = []
    for name, value in facts.items():
        if isinstance(value, Mapping):
            rows += _flat(value, f"{prefix}{name} ")
        else:
            text = f"{value:.4g}" if isinstance(value, float) else str(value)
            rows.append((prefix + name, text))
    return rows
