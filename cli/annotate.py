"""`pliant annotate`: click the same points in several pictures, on a local web page."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pliant.cli.match import open_photo_method
from pliant.cli.options import PATH, port_options
from pliant.cli.terminal import echo, show_page, to_call
from pliant.spec.text import plural

if TYPE_CHECKING:
    from pliant.viewer.annotation import Marks


@click.command()
@click.argument("folder", metavar="DIR", type=PATH)
@click.option("--points", default="", metavar="A,B,…", help="Initial names of points.")
@click.option("--method", metavar="METHOD", help="Suggest marks with this method (such as sift).")
@port_options
def command(folder: Path, points: str, method: str | None, port: int, no_browser: bool) -> None:
    """Click the same points in the pictures of DIR and write DIR/annotations.csv.

    Serves a page on this machine only. Every change is saved at once; Ctrl-C stops the server, and
    the same command continues. Suggested marks count once they are confirmed or moved.
    `pliant import DIR --out DATA` makes a dataset of the result.
    """
    from pliant.viewer.annotate_app import annotate_application
    from pliant.viewer.annotation import Annotation, Suggester
    from pliant.viewer.local_app import LocalServer

    names = [name.strip() for name in points.split(",") if name.strip()]
    earlier, marks = earlier_marks(folder)
    annotation = Annotation(folder, [*names, *earlier], marks)
    suggester = None
    if method is not None:
        suggester = Suggester(annotation, open_photo_method(method))
    application = partial(annotate_application, annotation, suggester)
    subject = "; ".join([plural(len(annotation.pictures), "picture"), *annotation.left_out])
    show_page(LocalServer(application, port), subject, no_browser=no_browser)
    open_marks = annotation.count("suggested")
    left = f", {open_marks} of them suggested: import leaves these out" if open_marks else ""
    echo(
        f"{plural(annotation.count(), 'mark')} in {annotation.path}{left}\n"
        f"Then: {to_call('pliant', 'import', folder, '--out', 'DATA')}"
    )


def earlier_marks(folder: Path) -> tuple[list[str], Marks]:
    """Return the points and marks of a folder's `annotations.csv`; empty where there is none.

    Raises:
        SpecError: A row is damaged, or names a picture that is not there.
    """
    from pliant.converters.marks_csv import collect_marks
    from pliant.spec.marks import ANNOTATIONS_CSV

    marks: Marks = {}
    path = folder / ANNOTATIONS_CSV
    if not path.exists():
        return [], marks
    found = collect_marks(path)
    for (picture, point), mark in found.marks.items():
        marks.setdefault(picture.relative_to(folder).as_posix(), {})[point] = mark
    return list(found.points), marks
