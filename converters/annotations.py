"""Points that were annotated in pictures, whatever tool wrote them."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path, PurePosixPath
from unicodedata import normalize

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.photo import SUFFIXES, photo_size
from pliant.spec.marks import Mark
from pliant.spec.text import number_order, plural

_SLACK_PX = 0.5  # a mark that counts from the first pixel's centre may be half a pixel outside


@dataclass(frozen=True)
class Annotations:
    """Named points in pictures.

    Attributes:
        path: The file or folder that they were read from.
        pictures: The picture files, in the order of the frames.
        points: Names of the points.
        uv_px: float64 (N, T, 2), pixels from the corner of each picture as viewers show it, NaN
            where the position is not given.
        visible: bool (N, T).
        unsaid: What the source cannot say, for the provenance.
        masks: The folder of masks that belongs to the source, or None.
        suggested: Number of marks that were left out: a method suggested them, and nobody
            confirmed them.
    """

    path: Path
    pictures: Sequence[Path]
    points: Sequence[str]
    uv_px: FloatArray
    visible: npt.NDArray[np.bool_]
    unsaid: Sequence[str] = ()
    masks: Path | None = None
    suggested: int = 0


class Collector:
    """Gathers marks one by one; a point has at most one mark in a picture.

    Args:
        path: The file or folder that is read, for messages.

    Attributes:
        marks: (picture, point) -> mark.
        points: Names of the points, marked or not.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._pictures: dict[Path, None] = {}
        self.marks: dict[tuple[Path, str], Mark] = {}
        self.points: dict[str, None] = {}

    def add_picture(self, picture: Path) -> None:
        """Add a picture, marked or not."""
        self._pictures[picture] = None

    def add_point(self, point: str, where: str) -> None:
        """Add a point, marked or not.

        Raises:
            SpecError: It has no name, or one that cannot be printed.
        """
        if not point.strip():
            raise SpecError("the point has no name", path=self.path, where=where)
        if not point.isprintable():
            raise SpecError(
                "the name of a point has characters that cannot be printed",
                path=self.path,
                where=where,
                found=repr(point)[:80],
                fix="Rename the point.",
            )
        self.points[point] = None

    def add(self, picture: Path, point: str, mark: Mark, where: str) -> None:
        """Add a mark.

        Args:
            picture: The picture file.
            point: Name of the point.
            mark: Where it is.
            where: The mark's place in the source, for messages.

        Raises:
            SpecError: The point is marked there already, or its name cannot be printed.
        """
        self.add_point(point, where)
        if (picture, point) in self.marks:
            raise SpecError(
                f"the point {point!r} is marked twice in {picture.name}",
                path=self.path,
                where=where,
                fix="Keep one of the two marks, or give them different names.",
            )
        self.add_picture(picture)
        known = math.isfinite(mark.u_px + mark.v_px)
        self.marks[picture, point] = replace(mark, visible=mark.visible and known)

    def annotations(self) -> Annotations:
        """Return what was gathered, without suggestions; pictures in the order of their names.

        Raises:
            SpecError: No marks, fewer than two pictures, or a visible mark outside its
            picture.
        """
        kept = {key: mark for key, mark in self.marks.items() if mark.source != "suggested"}
        suggested = len(self.marks) - len(kept)
        pictures = sorted(sorted(self._pictures), key=lambda path: number_order(str(path)))
        points = list(dict.fromkeys(point for _, point in kept))
        if len(pictures) < 2 or not points:
            raise SpecError(
                "no query can be made from these annotations",
                path=self.path,
                found=f"{plural(len(points), 'point')} in {plural(len(pictures), 'picture')}",
                required="points marked in at least two pictures",
                fix=f"{suggested} suggested marks do not count: confirm them with pliant annotate."
                if suggested
                else None,
            )
        uv_px = np.full((len(points), len(pictures), 2), np.nan)
        visible = np.zeros(uv_px.shape[:2], np.bool_)
        sizes = {picture: photo_size(picture) for picture in pictures}
        frame = {picture: index for index, picture in enumerate(pictures)}
        row = {point: index for index, point in enumerate(points)}
        for (picture, point), mark in kept.items():
            self._check_inside(picture, sizes[picture], point, mark)
            uv_px[row[point], frame[picture]] = mark.u_px, mark.v_px
            visible[row[point], frame[picture]] = mark.visible
        return Annotations(self.path, pictures, points, uv_px, visible, suggested=suggested)

    def _check_inside(self, picture: Path, size: tuple[int, int], point: str, mark: Mark) -> None:
        """Refuse a visible mark outside its picture: the usual sign of an EXIF rotation."""
        u, v, visible = mark.u_px, mark.v_px, mark.visible
        width, height = size
        if visible and not (-_SLACK_PX <= u <= width and -_SLACK_PX <= v <= height):
            raise SpecError(
                "a visible point is outside its picture",
                path=self.path,
                where=f"{picture.name}, point {point!r}",
                found=f"{u:g}, {v:g}",
                required=f"a position in {width}x{height} px",
                fix="If the tool ignored the EXIF orientation, save the pictures without it and "
                "annotate them again; if the point is hidden, mark it so.",
            )


def picture_in(folder: Path, name: str, path: Path, where: str) -> Path:
    """Return a picture of a folder.

    Args:
        folder: The folder.
        name: Its name there, as an annotation file gives it. Its last part alone counts where it
            leads out of the folder, or to no file.
        path: The annotation file, for messages.
        where: The place in it, for messages.

    Raises:
        SpecError: The picture is not found.
    """
    # The name of a file may begin or end with a space; macOS may store ä as a and its dots.
    for given in (name, name.strip(), normalize("NFC", name), normalize("NFD", name)):
        whole = PurePosixPath(given.replace("\\", "/"))
        inside = not whole.is_absolute() and ".." not in whole.parts
        for candidate in (whole, whole.name) if inside else (whole.name,):
            for below in (folder, folder / "images"):
                # Not Path.is_file, which raises where a name is too long.
                if whole.name and os.path.isfile(below / candidate):
                    return below / candidate
    raise SpecError(
        "picture not found" if inside else "the picture is not in the folder of its annotations",
        path=path,
        where=where,
        found=repr(name)[:80],
        required=f"a file in {folder}",
        fix=f"{'' if inside else 'Copy it there. '}Found there: {_some_pictures(folder)}.",
    )


def _some_pictures(folder: Path) -> str:
    files = chain(folder.iterdir(), folder.glob("images/*"))
    names = sorted(p.name for p in files if p.suffix.lower() in SUFFIXES)
    return ", ".join(names[:4]) + (" …" if len(names) > 4 else "") or "no pictures"


def read_rows(
    path: Path, columns: Sequence[str], optional: Sequence[str] = ()
) -> list[tuple[str, dict[str, str]]]:
    """Read a CSV file with a header; more columns may be there.

    Args:
        path: The file, UTF-8, separated by commas or semicolons.
        columns: The columns that it must have.
        optional: Columns that are empty in a file without them.

    Returns:
        (place, row) for each row that is not empty; without spaces around values, except around
        the name of a picture.

    Raises:
        CallError: The file is not found.
        SpecError: It is not a CSV with these columns.
    """
    if not path.is_file():
        raise CallError("file not found", path=path, found="a folder" if path.is_dir() else None)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise SpecError(
            "the file is not UTF-8 text",
            path=path,
            found=f"byte 0x{error.object[error.start]:02x} at {error.start}",
            fix="Save it as UTF-8.",
        ) from error
    head = text.split("\n", 1)[0]
    lines = csv.DictReader(
        text.splitlines(),
        delimiter=";" if head.count(";") > head.count(",") else ",",
    )
    wanted = [*columns, *optional]
    rows: list[tuple[str, dict[str, str]]] = []
    try:
        found = [name.strip() for name in lines.fieldnames or []]
        if twice := next((name for name in wanted if found.count(name) > 1), None):
            raise SpecError(
                "the header has a column twice", path=path, where="line 1", found=repr(twice)
            )
        if not set(columns) <= set(found):
            raise SpecError(
                "the header lacks columns",
                path=path,
                where="line 1",
                found=repr(head)[:80],
                required=",".join(columns),
            )
        lines.fieldnames = found
        for row in lines:
            if not any(map("".join, filter(None, row.values()))):  # commas alone, as Excel writes
                continue
            where = f"line {lines.line_num}"
            if any(row[name] is None for name in columns):
                raise SpecError(
                    "the row lacks values", path=path, where=where, required=",".join(columns)
                )
            if any(row.get(None) or ()):  # a comma too many may have moved what follows
                raise SpecError(
                    "the row has more values than the header",
                    path=path,
                    where=where,
                    found=len(found) + len(row[None]),
                    required=len(found),
                    fix="Write 5.5, not 5,5; put a text with a comma in quotation marks.",
                )
            values = {name: row.get(name) or "" for name in wanted}
            rows.append((where, {k: v if k == "picture" else v.strip() for k, v in values.items()}))
    except csv.Error as error:  # a field of more than 128 KiB
        raise SpecError(
            "the line is not of a CSV file",
            path=path,
            where=f"line {lines.line_num + 1}",
            found=str(error),
        ) from error
    return rows
