"""The report of a TimeCycle run: comparison with trivial answers, training curves, tracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pliant.evaluator.report.charts import Chart, Labels, line_chart
from pliant.models.don.report import history_chart
from pliant.models.timecycle.guard import Guard
from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.validation import Stretch, track_with
from pliant.models.training.canvas import pictures_png, show_picture
from pliant.models.training.run_page import Section, write_run_page

_SHOWN = 3
_PARTS = ("long", "skip", "similarity", "self")
_LISTED = "val/rmse_px_"


def write_timecycle_report(
    run: Path,
    matcher: TimeCycleMatcher,
    stretches: Sequence[Stretch],
    history: Sequence[Mapping[str, float]],
    guard: Guard,
    facts: Mapping[str, Any],
) -> Path:
    """Write `RUN/report.html`, one self-contained page.

    Args:
        run: The run's folder.
        matcher: The trained matcher.
        stretches: Validation stretches; the first few are shown.
        history: The logged values of the run.
        guard: The run compared with the trivial answers.
        facts: Label -> value, shown as a table.

    Returns:
        The page.
    """
    listed = {
        int(key.removeprefix(_LISTED)) for row in history for key in row if key.startswith(_LISTED)
    }
    errors = {f"after {frames}": f"{_LISTED}{frames}" for frames in sorted(listed)}
    sections = [
        Section(
            "Does the cycle beat the trivial answers?",
            "RMSE of points tracked through validation episodes, by frames since the query, in "
            "pixels of a picture 640 wide; all methods have the same frames, points and "
            "propagation.",
            lead=guard.verdict(),
            table=[
                ["", *(f"after {frames}" for frames in guard.listed)],
                *(
                    [name, *(f"{values[frames - 1]:.1f}" for frames in guard.listed)]
                    for name, values in guard.curves.items()
                ),
            ],
            charts=[time_chart(guard)],
        ),
        Section(
            "Curves",
            charts=[
                *(
                    history_chart(history, {part: part}, f"Loss: {part}")
                    for part in _PARTS
                    if any(part in row for row in history)
                ),
                history_chart(history, errors, "Validation RMSE", "px"),
            ],
        ),
        Section(
            "Tracks",
            "The first validation stretches: the first frame with its points, and the last one. "
            "Dots are the answers, lines lead to the true positions; a point that is hidden in "
            "the last frame has no dot.",
            picture=tracks_png(matcher, stretches[:_SHOWN]),
        ),
    ]
    rest = {name: value for name, value in facts.items() if name not in ("guard", "validation")}
    return write_run_page(run, rest, sections)


def time_chart(guard: Guard) -> Chart:
    """Draw the RMSE over the frames since the query."""
    series = {
        name: (np.arange(1, len(values) + 1), values) for name, values in guard.curves.items()
    }
    return line_chart(series, Labels("RMSE over time", "frames since the query", "RMSE, px of 640"))


def tracks_png(matcher: TimeCycleMatcher, stretches: Sequence[Stretch]) -> bytes:
    """Return a picture of first and last frames with the points and their errors."""

    def draw(_: Figure, axes: Any) -> None:
        for (left, right), stretch in zip(axes, stretches, strict=True):
            truth, seen = stretch.truth()
            answer = list(track_with(matcher)(stretch))[-1]
            for axis, frame in ((left, stretch.frames[0]), (right, stretch.frames[-1])):
                image = stretch.store.view(frame).rgb
                show_picture(axis, image, (image.shape[1], image.shape[0]))
            order = truth[0, :, 0].argsort().argsort()  # colours go from left to right
            dots: dict[str, Any] = {
                "cmap": "turbo", "vmin": 0, "vmax": len(order) - 1, "s": 22,
                "edgecolors": "white", "linewidths": 0.7,
            }  # fmt: skip
            left.scatter(*truth[0].T, c=order, **dots)
            shown = seen[-1]
            for a, b in zip(answer[shown], truth[-1][shown], strict=True):
                right.plot([a[0], b[0]], [a[1], b[1]], color="white", lw=1)
            right.scatter(*answer[shown].T, c=order[shown], **dots)
            right.set_title(f"{len(stretch.frames) - 1} frames later")

    return pictures_png(len(stretches), 2, (5, 3.9), draw)
