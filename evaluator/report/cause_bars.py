"""The causes of several methods' errors, as bars of a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pliant.evaluator.metrics.base import OVERALL
from pliant.evaluator.metrics.causes import CAUSES
from pliant.evaluator.scores import Scores


def cause_bars(
    reports: Sequence[Scores], names: Sequence[str], group: str = OVERALL
) -> dict[str, Any]:
    """Return what the template `cause_table.html.j2` shows: the shares of each method's error.

    Args:
        reports: The reports; those without causes are left out.
        names: The methods' names.
        group: `overall` or a tier.
    """
    rows = []
    for name, report in zip(names, reports, strict=True):
        if "causes" in report.document:
            every = report.document["causes"]
            found = every[OVERALL] if group == OVERALL else every["tiers"][group]
            shares = [found[cause.name]["squared_error_share"] or 0 for cause in CAUSES]
            rows.append((name, [(index, share) for index, share in enumerate(shares) if share]))
    shown = {index for _, shares in rows for index, share in shares if share >= 0.005}
    return {"causes": CAUSES, "cause_rows": rows, "shown_causes": shown}
