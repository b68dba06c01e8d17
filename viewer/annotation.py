"""Marks of the same points in several pictures, kept in the `annotations.csv` of their folder."""

from __future__ import annotations

import csv
import io
import math
import threading
from collections.abc import Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any, Final

from pliant.baselines.matcher import Matcher
from pliant.spec.errors import CallError, PliantError
from pliant.spec.io.photo import SUFFIXES, photo_size
from pliant.spec.io.writing import require_folder, write_file
from pliant.spec.marks import ANNOTATIONS_CSV, COLUMNS, Mark, mark_source
from pliant.spec.text import escaped, number_order, plural, shortened
from pliant.viewer.photo_match import match_photo
from pliant.viewer.photo_views import PhotoFiles, read_photo_view

_MAX_SIDE_PX: Final = 1024  # of the pictures that suggestions are computed on

Marks = dict[str, dict[str, Mark]]
"""Picture -> point -> mark."""


class Annotation:
    """The pictures of a folder and their marks.

    Args:
        folder: The folder.
        points: Names of points to begin with.
        marks: Marks of an earlier `annotations.csv`; the names of their points are kept.

    Attributes:
        left_out: Sentences on HEIC files and on pictures that cannot be read.

    Raises:
        CallError: It is not a folder, cannot be written to, or has fewer than two pictures; or
            there are marks of another picture, which the next change would delete.
    """

    def __init__(
        self, folder: Path, points: Sequence[str] = (), marks: Marks | None = None
    ) -> None:
        if not folder.is_dir():
            raise CallError("folder not found", path=folder)
        require_folder(folder)  # of annotations.csv: not to be found out after the first click
        pictures = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)
        sizes = _sizes(sorted(pictures, key=lambda picture: number_order(picture.name)))
        self.pictures, self.sizes = list(sizes), list(sizes.values())
        heic = sum(p.suffix.lower() in (".heic", ".heif") for p in folder.iterdir())
        unread = [escaped(picture.name) for picture in pictures if picture not in sizes]
        which = shortened(", ".join(unread), 200)
        self.left_out = [
            *([f"{plural(heic, 'HEIC file')} left out: save them as JPEG"] if heic else []),
            *(
                [f"{plural(len(unread), 'picture')} left out: not readable ({which})"]
                if unread
                else []
            ),
        ]
        if len(self.pictures) < 2:
            raise CallError(
                "points are marked in several pictures",
                path=folder,
                found=plural(len(self.pictures), "picture"),
                required="at least two of " + ", ".join(SUFFIXES),
                fix="; ".join(self.left_out) or None,
            )
        for picture in self.pictures:
            if not picture.name.isprintable():
                raise CallError(
                    "the name of a picture has characters that cannot be printed",
                    path=folder,
                    found=ascii(picture.name)[:80],
                    fix="Rename the file.",
                )
        self.path = folder / ANNOTATIONS_CSV
        self.marks: Marks = marks or {}
        for name in sorted(self.marks.keys() - {picture.name for picture in self.pictures}):
            raise CallError(
                "there are marks of a picture that the page does not show",
                path=self.path,
                found=repr(name)[:80],
                required="readable pictures in the folder itself, of " + ", ".join(SUFFIXES),
                fix="Repair, convert or move the picture, or delete its rows.",
            )
        self.points = list(dict.fromkeys(chain(points, *self.marks.values())))
        self.revision = 0
        self._lock = threading.Lock()

    def state(self) -> dict[str, Any]:
        """Return everything that the page shows, as JSON; a mark is [x, y, visible, source]."""
        pictures = [
            {"name": picture.name, "width": width, "height": height}
            for picture, (width, height) in zip(self.pictures, self.sizes, strict=True)
        ]
        marks = {
            picture: {point: _listed(mark) for point, mark in own.items()}
            for picture, own in self.marks.items()
        }
        return {
            "pictures": pictures,
            "points": self.points,
            "marks": marks,
            "revision": self.revision,
        }

    def update(self, document: Any) -> None:
        """Replace points and marks by those of the page, and write them.

        Raises:
            CallError: They are not of the form of `state`, or name an earlier `revision`: another
                window has changed the marks since.
        """
        sizes = dict(zip((p.name for p in self.pictures), self.sizes, strict=True))
        try:
            revision = document.get("revision", self.revision)
            points = [_name(point) for point in document["points"]]
            marks = {
                picture: {
                    point: _checked(mark, picture, sizes[picture], points, point)
                    for point, mark in own.items()
                }
                for picture, own in document["marks"].items()
            }
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise CallError("the marks are not of this folder", found=str(error)[:80]) from error
        with self._lock:
            if revision != self.revision:
                raise CallError(
                    "the marks were changed in another window", fix="Reload this page to go on."
                )
            self.points, self.marks = points, marks
            self._write()
            self.revision += 1

    def _write(self) -> None:
        text = io.StringIO(newline="")
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(COLUMNS)
        for picture in self.pictures:
            own = self.marks.get(picture.name, {})
            for point in self.points:
                if point in own:
                    x, y, visible, source = _listed(own[point])
                    shown = ["" if each is None else f"{each:.3f}" for each in (x, y)]
                    rows.writerow([picture.name, point, *shown, int(visible), source])
        marked = set(chain(*self.marks.values()))
        for point in self.points:
            if point not in marked:  # the next start shows it again
                rows.writerow(["", point, *[""] * (len(COLUMNS) - 2)])
        write_file(self.path, text.getvalue())

    def count(self, source: str | None = None) -> int:
        """Return the number of marks, or of those of one source."""
        marks = [mark for own in self.marks.values() for mark in own.values()]
        return sum(source in (None, mark.source) for mark in marks)


def _name(point: Any) -> str:
    name = str(point).strip()
    if not name or not name.isprintable():
        raise ValueError(f"point {name!r}")
    return name


def _listed(mark: Mark) -> tuple[float | None, float | None, bool, str]:
    """Return a mark for JSON: x and y are None where nobody says where."""
    known = math.isfinite(mark.u_px + mark.v_px)
    x, y = (mark.u_px, mark.v_px) if known else (None, None)
    return x, y, mark.visible, mark.source


def _sizes(pictures: Sequence[Path]) -> dict[Path, tuple[int, int]]:
    """Return (width, height) of the pictures that can be read."""
    sizes: dict[Path, tuple[int, int]] = {}
    for picture in pictures:
        with suppress(PliantError):
            sizes[picture] = photo_size(picture)
    return sizes


def _checked(
    mark: Any, picture: str, size: tuple[int, int], points: Sequence[str], point: str
) -> Mark:
    x, y, visible, source = mark
    if point not in points or not isinstance(visible, bool):
        raise ValueError(f"point {point!r}")
    source = mark_source(source)
    if x is None and y is None and not visible:
        return Mark(math.nan, math.nan, False, source)
    if not (0 <= float(x) <= size[0] and 0 <= float(y) <= size[1]):
        raise CallError(
            "a mark is outside its picture",
            where=f"{picture}, point {point!r}",
            found=f"{float(x):g}, {float(y):g}",
            required=f"a position in {size[0]}x{size[1]} px",
            fix="Move the mark, or remove it.",
        )
    return Mark(float(x), float(y), visible, source)


class Suggester:
    """Finds the marks of one picture in another with a method.

    Args:
        annotation: The pictures.
        matcher: The method.
    """

    def __init__(self, annotation: Annotation, matcher: Matcher) -> None:
        self._annotation, self._matcher = annotation, matcher
        self._lock = threading.Lock()

    def suggest(self, source: int, target: int) -> dict[str, Any]:
        """Return where the points of one picture are in another.

        Args:
            source: Number of the picture with the marks; suggestions among them do not count.
            target: Number of the other one.

        Returns:
            `marks`, point -> [x, y], of those marked visible in the source; `warnings`, sentences.
        """
        last = len(self._annotation.pictures) - 1
        source, target = (min(max(number, 0), last) for number in (source, target))
        own = self._annotation.marks.get(self._annotation.pictures[source].name, {})
        asked = {n: m for n, m in own.items() if m.visible and m.source != "suggested"}
        if not asked or source == target:
            return {"marks": {}, "warnings": ["The other picture has no visible marks."]}
        width, height = self._annotation.sizes[source]
        # A mark on the right or lower border is on no pixel.
        at = [(min(m.u_px, width - 0.5), min(m.v_px, height - 0.5)) for m in asked.values()]
        files = [PhotoFiles(self._annotation.pictures[each]) for each in (source, target)]
        with self._lock:
            a = read_photo_view(files[0], _MAX_SIDE_PX, at)
            b = read_photo_view(files[1], _MAX_SIDE_PX)
            found = match_photo(self._matcher, a.view, b.view, at, sizes=(a.size, b.size))
        places = (point.uv_b_px * found.scale_b for point in found.points)
        marks = {
            name: [round(float(x), 3) for x in place]
            for name, place in zip(asked, places, strict=True)
        }
        return {"marks": marks, "warnings": found.warnings()}
