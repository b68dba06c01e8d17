"""Reads `annotations.csv`: one row for each mark, `picture,point,x,y,visible,source`.

x and y are pixels from the upper-left corner of the picture as viewers show it, so that the centre
of the first pixel is at (0.5, 0.5). `source` is `marked` (also where the column is missing),
`suggested` by a method, or `confirmed`. A row with a point alone names one that is not marked yet.
`pliant annotate` writes this file.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from pliant.converters.annotations import Collector, picture_in, read_rows
from pliant.spec.errors import SpecError
from pliant.spec.marks import COLUMNS, Mark, mark_source
from pliant.spec.text import number_in

_VISIBLE: Final = {
    **dict.fromkeys(("1", "1.0", "true", "yes"), True),  # 1.0 is what pandas makes of it
    **dict.fromkeys(("0", "0.0", "false", "no"), False),
}


def collect_marks(path: Path) -> Collector:
    """Read a CSV of marks; its pictures are in the folder of the file, or in `images/` there.

    Args:
        path: The file. x and y may be empty where `visible` is 0: then nobody says where.

    Raises:
        CallError: The file is not found.
        SpecError: A row is damaged, or names a picture that is not there.
    """
    marks = Collector(path)
    for where, row in read_rows(path, COLUMNS[:5], COLUMNS[5:]):
        if not any(text for column, text in row.items() if column != "point"):
            marks.add_point(row["point"], where)
            continue
        picture = picture_in(path.parent, row["picture"], path, f"{where}, picture")
        if row["visible"].lower() not in _VISIBLE:
            raise SpecError(
                "visible is neither 0 nor 1",
                path=path,
                where=where,
                found=repr(row["visible"])[:40],
            )
        visible = _VISIBLE[row["visible"].lower()]
        u, v = (_number(row[axis], visible, path, f"{where}, {axis}") for axis in "xy")
        try:
            source = mark_source(row["source"] or "marked")
        except ValueError as error:
            raise SpecError(
                "unknown source",
                path=path,
                where=where,
                found=repr(row["source"])[:40],
                required="marked, suggested or confirmed",
            ) from error
        marks.add(picture, row["point"], Mark(u, v, visible, source), where)
    return marks


def _number(text: str, visible: bool, path: Path, where: str) -> float:
    if not text and not visible:
        return math.nan
    try:
        value = number_in(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise SpecError(
            "this is not a number",
            path=path,
            where=where,
            found=repr(text)[:40],
            required="pixels from the upper-left corner (10.5); empty only where visible is 0",
        )
    return value
