"""What a submission's footer says about its method, as columns of a leaderboard.

The footer's `method` is free besides `name`. A leaderboard shows `date`, `author`, `link` and
`code` (addresses), `seconds_per_pair` and `training_hours` where any method gives them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

_LONGEST: Final = 60
_WEB: Final = re.compile(r"https?://[^\s<>\"']+")
COLUMNS: Final = {
    "seconds_per_pair": "Answering, s per pair",
    "training_hours": "Training, h",
    "date": "Date",
    "author": "Author",
    "link": "Link",
    "code": "Code",
}
"""Field of the footer's `method` -> heading."""


@dataclass(frozen=True)
class Fact:
    """One cell.

    Attributes:
        text: What it shows; empty where the footer has nothing fit.
        key: What it is sorted by.
        href: A web address it links to, or empty.
    """

    text: str
    key: str
    href: str = ""


def fact_table(methods: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[Fact]]]:
    """Return the headings that any method has a fact for, and a row of facts for each method.

    Args:
        methods: `method` of each footer.
    """
    found = {field: [_fact(field, method.get(field)) for method in methods] for field in COLUMNS}
    shown = [field for field, facts in found.items() if any(fact.text for fact in facts)]
    rows = [[found[field][index] for field in shown] for index in range(len(methods))]
    return [COLUMNS[field] for field in shown], rows


def _fact(field: str, value: Any) -> Fact:
    if field in ("seconds_per_pair", "training_hours"):
        if isinstance(value, bool) or not isinstance(value, int | float) or not value >= 0:
            return Fact("", "")
        return Fact(f"{value:.3g}", repr(float(value)))
    if not isinstance(value, str) or not value.strip():
        return Fact("", "")
    text = " ".join(value.split())
    if field in ("link", "code"):
        if not _WEB.fullmatch(text):  # never another scheme, such as javascript:
            return Fact("", "")
        return Fact(re.sub(r"^https?://(www\.)?", "", text)[:_LONGEST], text, text)
    return Fact(text[:_LONGEST], text)
