"""The report of a TimeCycle run: comparison with trivial answers, training curves.

A network can satisfy a cycle without following anything: by staying where it is (identity) or
by always answering the middle of the object (centroid). An untrained encoder tells what the
propagation does by itself. A run states all three next to its own errors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pliant.evaluator.report.charts import Labels, line_chart
from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.validation import (
    LISTED,
    Stretch,
    curve,
    errors_over_time,
    track_centroid,
    track_identity,
    track_with,
)
from pliant.models.training.run_page import Section, history_chart, write_run_page

RIVALS = ("identity", "centroid", "untrained")


@dataclass(frozen=True)
class Guard:
    """The run against its rivals, on the same stretches and points.

    Attributes:
        curves: Method -> RMSE for each number of frames since the query, px of a picture 640
            wide; `trained` and each of `RIVALS`.
    """

    curves: dict[str, list[float]]

    def beats(self, rival: str, frames: int) -> bool:
        """Return whether the run has the lower error so many frames after the query."""
        return self.curves["trained"][frames - 1] < self.curves[rival][frames - 1]

    @property
    def listed(self) -> list[int]:
        """The numbers of frames that are listed: those after which a point is seen."""
        values = self.curves["trained"]
        return [
            frames
            for frames in LISTED
            if frames <= len(values) and math.isfinite(values[frames - 1])
        ]

    def verdict(self) -> str:
        """Return in words what the run beats and what not."""
        lost = [
            f"{rival} after {frames} frame{'s' if frames > 1 else ''}"
            for frames in self.listed
            for rival in RIVALS
            if not self.beats(rival, frames)
        ]
        if not lost:
            return "The run beats identity, centroid and an untrained encoder at every listed time."
        return "The run does NOT beat " + ", ".join(lost) + "."

    def as_dict(self) -> dict[str, object]:
        """Return the listed figures and the verdict as a JSON object."""
        rmse = {
            name: {str(frames): values[frames - 1] for frames in self.listed}
            for name, values in self.curves.items()
        }
        return {"rmse_px_of_640": rmse, "verdict": self.verdict()}


def compare_with_trivial(
    trained: TimeCycleMatcher, untrained: TimeCycleMatcher, stretches: Sequence[Stretch]
) -> Guard:
    """Measure a run and its rivals on validation stretches.

    Args:
        trained: The run.
        untrained: The same network with the weights it began with.
        stretches: From `draw_stretches`.
    """
    methods = {
        "trained": track_with(trained),
        "identity": track_identity,
        "centroid": track_centroid,
        "untrained": track_with(untrained),
    }
    return Guard(
        {name: curve(errors_over_time(track, stretches)) for name, track in methods.items()}
    )


_PARTS = ("long", "skip", "similarity", "self", "direct", "walk")
_LISTED = "val/rmse_px_"


def write_timecycle_report(
    run: Path,
    history: Sequence[Mapping[str, float]],
    guard: Guard,
    facts: Mapping[str, Any],
    chosen: bool,
) -> None:
    """Write `RUN/report.html`, one self-contained page.

    Args:
        run: The run's folder.
        history: The logged values of the run.
        guard: The run compared with the trivial answers.
        facts: Label -> value, shown as a table.
        chosen: Whether each network had its read-out chosen at the end.
    """
    listed = {
        int(key.removeprefix(_LISTED)) for row in history for key in row if key.startswith(_LISTED)
    }
    errors = {f"after {frames}": f"{_LISTED}{frames}" for frames in sorted(listed)}
    over_time = {
        name: (np.arange(1, len(values) + 1), values) for name, values in guard.curves.items()
    }
    unit = "px of 640"
    axes = "frames since the query", f"RMSE, {unit}"
    propagation = (
        "for each network the read-out was chosen that is best on these episodes (the curves of "
        "the validation are before that)."
        if chosen
        else "both networks have the same propagation."
    )
    sections = [
        Section(
            "Does the cycle beat the trivial answers?",
            "RMSE of points tracked through validation episodes, by frames since the query, in "
            "pixels of a picture 640 wide; all methods have the same frames and points; "
            + propagation,
            lead=guard.verdict(),
            table=[
                ["", *(f"after {frames}" for frames in guard.listed)],
                *(
                    [name, *(f"{values[frames - 1]:.1f}" for frames in guard.listed)]
                    for name, values in guard.curves.items()
                ),
            ],
            charts=[line_chart(over_time, Labels("RMSE over time", *axes))],
        ),
        Section(
            "Curves",
            charts=[
                *(
                    history_chart(history, {part: part}, f"Loss: {part}")
                    for part in _PARTS
                    if any(part in row for row in history)
                ),
                history_chart(history, errors, "Validation RMSE", unit),
            ],
        ),
    ]
    rest = {name: value for name, value in facts.items() if name not in ("guard", "validation")}
    write_run_page(run, rest, sections)
