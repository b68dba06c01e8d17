"""The report of a run: training curves, descriptors as colours, heat maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from pliant.baselines.descriptor_colours import descriptor_colours
from pliant.evaluator.report.charts import Chart, Labels, line_chart
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.validation import ValidationPair
from pliant.models.training.canvas import pictures_png, show_picture
from pliant.models.training.run_page import Section, write_run_page
from pliant.spec.frame import Frame, Pair

_PAIRS_SHOWN = 4
_HEAT_RANGE = 10.0  # natural logarithms below the peak; lower values get the lowest colour


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
        history: The logged values of the run.
        facts: Label -> value; mappings are flattened.

    Returns:
        The page.
    """
    shown = pairs[:_PAIRS_SHOWN]
    errors = {
        "RMSE, pooled": "val/rmse_px",
        "RMSE, mean over pairs": "val/rmse_px_mean_over_pairs",
        "median": "val/median_px",
        "network alone, RMSE, pooled": "val/network_rmse_px",
    }
    charts = [
        history_chart(history, {"loss": "loss"}, "Training loss"),
        history_chart(history, errors, "Validation error", "px"),
    ]
    sections = [
        Section("Curves", charts=charts),
        Section(
            "Descriptors",
            "The first three principal components of the descriptors on the object, over all "
            "pictures, as red, green and blue: the same colour should mark the same place of the "
            "object in every shape.",
            picture=descriptors_png(matcher, shown),
        ),
        Section(
            "Predicted distribution of a point",
            "On the left the query (cross), on the right the log probability over the target, with "
            "the truth (circle) and the answer (cross). The pairs are the first validation pairs.",
            picture=heat_png(matcher, shown),
        ),
    ]
    return write_run_page(run, facts, sections)


def history_chart(
    history: Sequence[Mapping[str, float]], keys: Mapping[str, str], title: str, unit: str = ""
) -> Chart:
    """Draw logged values over the training steps.

    Args:
        history: The logged values of a run.
        keys: Label -> key in `history`; a key that a row lacks is skipped in it.
        title: Heading.
        unit: Label of the vertical axis.
    """
    series = {}
    for label, key in keys.items():
        rows = [(row["step"], row[key]) for row in history if key in row]
        series[label] = ([step for step, _ in rows], [value for _, value in rows])
    validated = any(key.startswith("val/") for key in keys.values())
    return line_chart(series, Labels(title, "step", unit), from_zero=validated)


def descriptors_png(matcher: DonMatcher, pairs: Sequence[ValidationPair]) -> bytes:
    """Return a picture of frames above their descriptors as colours.

    Args:
        matcher: The matcher.
        pairs: Pairs whose frames to show.
    """
    views = [view for pair in pairs[:2] for view in (pair.source, pair.target)]
    maps = [matcher.descriptor_map(view) for view in views]  # (h, w, D) each
    masks = [_mask(view, matcher) for view in views]

    def draw(_: Figure, axes: Any) -> None:
        for column, colour in enumerate(descriptor_colours(maps, masks)):
            axes[0, column].imshow(views[column].rgb)
            axes[1, column].imshow(colour)

    return pictures_png(2, len(views), (3, 2.3), draw)


def heat_png(matcher: DonMatcher, pairs: Sequence[ValidationPair]) -> bytes:
    """Return a picture of one query per pair and the predicted distribution over its target.

    Args:
        matcher: The matcher.
        pairs: The pairs.
    """
    cross = {"color": "red", "markersize": 12, "markeredgewidth": 2}

    def draw(figure: Figure, axes: Any) -> None:
        for (left, right), pair in zip(axes, pairs, strict=True):
            query = int(np.argmax(pair.visible[:, 0]))  # the first whose truth is visible
            uv, truth = pair.uv_a_px[query], pair.uv_b_px[query, 0]
            heat = matcher.heat(pair.source, pair.target, uv)
            answer = matcher.answer(Pair(pair.source, pair.target, uv[None])).uv_px[0]
            size = heat.values.shape[1], heat.values.shape[0]
            show_picture(left, pair.source.rgb, size)
            left.plot(*uv, "+", **cross)
            show_picture(right, pair.target.rgb, size, alpha=0.25)
            lowest = float(np.nanmax(heat.values)) - _HEAT_RANGE
            shown = show_picture(right, heat.values, size, cmap="viridis", vmin=lowest)
            figure.colorbar(shown, ax=right, label=heat.label, shrink=0.8)
            right.plot(*truth, "o", mfc="none", mec="red", ms=12, mew=2)
            right.plot(*answer, "+", **cross)
            right.set_title(f"error {np.linalg.norm(answer - truth):.1f} px in this picture")

    return pictures_png(len(pairs), 2, (4.5, 3.1), draw)


def _mask(view: Frame, matcher: DonMatcher) -> npt.NDArray[np.bool_]:
    mask = matcher.working_mask(view)
    return np.ones((matcher.size[1], matcher.size[0]), dtype=np.bool_) if mask is None else mask
