"""The report of a TimeCycle run: the guard's verdict, curves, tracks and what cells look like."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pliant.models.don.report import figure_png, picture, report_head
from pliant.models.timecycle.guard import Guard
from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.validation import Stretch, track_with
from pliant.spec.io.writing import replacing

_SHOWN = 3
_COLOURS = {"trained": "C3", "untrained": "C0", "identity": "0.35", "centroid": "0.7"}
_PARTS = ("long", "skip", "similarity", "self")


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
        history: The logged figures of the run.
        guard: The run against the trivial answers.
        facts: Label -> value, shown as a table.

    Returns:
        The page.
    """
    rest = {name: value for name, value in facts.items() if name not in ("guard", "validation")}
    names = list(guard.curves)
    head = "".join(f"<th>after {frames}" for frames in guard.listed)
    rows = "".join(
        f"<tr><th>{html.escape(name)}"
        + "".join(f"<td>{guard.curves[name][frames - 1]:.1f}" for frames in guard.listed)
        for name in names
    )
    page = (
        report_head(run, rest)
        + "<h2>Does the cycle beat the trivial answers?</h2>"
        + f"<p><b>{html.escape(guard.verdict())}</b> RMSE of points tracked through validation "
        "episodes, by frames since the query, in pixels of a picture 640 wide; the same "
        "frames, points and propagation for all.</p>"
        + f"<table><tr><th>{head}{rows}</table>"
        + picture(time_png(guard), "RMSE over the frames since the query")
        + "<h2>Curves</h2>"
        + picture(losses_png(history), "parts of the loss and validation error over the steps")
        + "<h2>Tracks</h2><p>Validation stretches, not chosen: the first frame with its points, "
        "and the last one. Dots are the answers, lines lead to where the points are; no dot is "
        "drawn for a point that the camera no longer sees.</p>"
        + picture(tracks_png(matcher, stretches[:_SHOWN]), "tracked points")
    )
    path = run / "report.html"
    with replacing(path) as partial:
        partial.write_text(page + "</html>\n", encoding="utf-8")
    return path


def time_png(guard: Guard) -> bytes:
    """Return a picture of the RMSE over the frames since the query."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.4), layout="constrained")
    axis = figure.subplots()
    for name, values in guard.curves.items():
        frames = np.arange(1, len(values) + 1)
        axis.plot(
            frames, values, color=_COLOURS[name], label=name, lw=2 if name == "trained" else 1
        )
    axis.set(xlabel="frames since the query", ylabel="RMSE, px of 640", ylim=(0, None))
    axis.legend(frameon=False)
    return figure_png(figure)


def losses_png(history: Sequence[Mapping[str, float]]) -> bytes:
    """Return a picture of the parts of the loss and the validation error over the steps."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 3), layout="constrained")
    parts = [name for name in _PARTS if any(name in row for row in history)]
    axes = figure.subplots(1, len(parts) + 1, squeeze=False)[0]
    for axis, name in zip(axes, parts, strict=False):
        rows = [row for row in history if name in row]
        axis.plot([row["step"] for row in rows], [row[name] for row in rows], lw=0.8)
        axis.set(title=name, xlabel="step")
    rows = [row for row in history if "val/rmse_px" in row]
    listed = [name for name in rows[0] if name.startswith("val/rmse_px_")] if rows else []
    for name in sorted(listed, key=lambda name: int(name.rsplit("_", 1)[1])):
        label = f"after {name.rsplit('_', 1)[1]}"
        points = [row.get(name, float("nan")) for row in rows]
        axes[-1].plot([row["step"] for row in rows], points, marker=".", label=label)
    axes[-1].set(title="validation RMSE, px", xlabel="step", ylim=(0, None))
    if listed:
        axes[-1].set_ylim(0, 1.4 * axes[-1].get_ylim()[1])  # room for the legend
        axes[-1].legend(frameon=False, fontsize=8, loc="upper center", ncols=2)
    return figure_png(figure)


def tracks_png(matcher: TimeCycleMatcher, stretches: Sequence[Stretch]) -> bytes:
    """Return a picture of first and last frames with the points and their errors."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.9 * len(stretches)), layout="constrained")
    axes = figure.subplots(len(stretches), 2, squeeze=False)
    for (left, right), stretch in zip(axes, stretches, strict=True):
        truth, seen = stretch.truth()
        *_, answer = track_with(matcher)(stretch)
        first, last = (stretch.store.view(stretch.frames[k]).rgb for k in (0, -1))
        height, width = first.shape[:2]
        colours = np.arange(len(stretch.points))
        for axis, image in ((left, first), (right, last)):
            axis.imshow(image, extent=(0, width, height, 0))
            axis.set(xlim=(0, width), ylim=(height, 0))
            axis.set_axis_off()
        order = truth[0, :, 0].argsort().argsort()  # colours go from left to right
        left.scatter(*truth[0].T, c=order, cmap="turbo", s=22, edgecolors="white", linewidths=0.7)
        shown = seen[-1]
        for a, b in zip(answer[shown], truth[-1][shown], strict=True):
            right.plot([a[0], b[0]], [a[1], b[1]], color="white", lw=1)
        right.scatter(
            *answer[shown].T,
            c=order[shown],
            cmap="turbo",
            vmin=0,
            vmax=len(colours) - 1,
            s=22,
            edgecolors="white",
            linewidths=0.7,
        )
        right.set_title(f"{len(stretch.frames) - 1} frames later", fontsize=9)
    return figure_png(figure)
