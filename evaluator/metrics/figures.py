"""What the families of metrics report: the rows of figures.json, with a protocol's settings.

A row has the fields of a `Figure`, or of a `Ratio` where `over` names the two columns. Its texts
are format strings of the family's settings. Rows under `each` are repeated for each value of a
setting, which they have as `each`, and 100 times it as `percent`; a setting of None gives none.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator, Mapping
from importlib import resources
from typing import Any

from pliant.evaluator.statistics.ratios import Figure, Ratio


def listed_figures(family: str, settings: Any, **words: str) -> list[Figure]:
    """Return what a family of metrics reports, in the order of a report.

    Args:
        family: The family; one that figures.json does not name reports nothing.
        settings: Its settings.
        **words: More words of its texts.
    """
    return list(_figures(_table().get(family, []), {**dict(settings), **words}))


@functools.cache
def _table() -> dict[str, list[dict[str, Any]]]:
    path = resources.files("pliant.evaluator.metrics") / "figures.json"
    table: dict[str, list[dict[str, Any]]] = json.loads(path.read_bytes())
    return table


def _figures(rows: list[dict[str, Any]], words: Mapping[str, Any]) -> Iterator[Figure]:
    for row in rows:
        if "each" not in row:
            yield from _figure(row, words)
            continue
        values = words[row["each"]]
        for value in values if isinstance(values, tuple) else (values,):
            if value is not None:
                more = {"each": value, "percent": value * 100}
                yield from _figures(row["figures"], {**words, **more})


def _figure(row: Mapping[str, Any], words: Mapping[str, Any]) -> Iterator[Figure]:
    name, about, label = (row.get(key, "").format(**words) for key in ("name", "about", "label"))
    better, unit = row["better"], row.get("unit", "")
    if "over" not in row:
        yield Figure(name, better, unit, about, label)
        return
    above, below = (column.format(**words) for column in row["over"])
    ratio = Ratio(name, better, unit, about, label, above, below, root=row.get("root", False))
    yield ratio
    if "mean_over_pairs" in row:
        yield ratio.mean_over_pairs(row["mean_over_pairs"].format(**words))
