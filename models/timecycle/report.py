"""The report of a TimeCycle run: comparison with trivial answers, training curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pliant.evaluator.report.charts import Labels, line_chart
from pliant.models.timecycle.guard import Guard
from pliant.models.training.run_page import Section, history_chart, write_run_page

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
