"""The report of a run: training curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pliant.models.training.run_page import Section, history_chart, write_run_page


def write_run_report(
    run: Path, history: Sequence[Mapping[str, float]], facts: Mapping[str, Any]
) -> Path:
    """Write `RUN/report.html`, one self-contained page.

    Args:
        run: The run's folder.
        history: The logged values of the run.
        facts: Label -> value; mappings are flattened.

    Returns:
        The page.
    """
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
    return write_run_page(run, facts, [Section("Curves", charts=charts)])
