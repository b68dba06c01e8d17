"""`pliant match`: points of a picture found in another."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from pliant.cli.options import json_option, method_options, out_option, path_option
from pliant.cli.terminal import echo_result, progress_bar
from pliant.spec.text import number_in

if TYPE_CHECKING:
    from pliant.baselines.matcher import Matcher


def _positions(
    ctx: click.Context, param: click.Parameter, values: tuple[str, ...]
) -> list[tuple[float, float]]:
    found = []
    for value in values:
        try:
            u, v = map(number_in, value.split(","))
        except ValueError as error:
            raise click.BadParameter(
                f"found {value!r}; required: two numbers, such as 320.5,240.5", ctx, param
            ) from error
        found.append((u, v))
    return found


_MORE_PICTURES: Final = tuple(
    f"{kind}_{side}" for kind in ("mask", "objects", "depth") for side in ("source", "target")
)


@click.command()
@click.argument("method")
@path_option("--source", "A.png", "Picture with the points.", required=True)
@path_option("--target", "B.png", "Picture to search.", required=True)
@click.option(
    "--at",
    multiple=True,
    callback=_positions,
    metavar="U,V",
    help="A pixel of the source; the centre of the first one is 0.5,0.5. May be repeated.",
)
@click.option(
    "--grid",
    type=click.IntRange(1, 2000),
    metavar="N",
    help="Match about N points of a regular grid on the source's object.",
)
@out_option("FIG.png", "The figure: png, pdf, svg or jpg.")
@path_option(
    "--mask-source",
    "FILE",
    "Picture that is black outside the object; an object on black is its own mask.",
)
@path_option("--mask-target", "FILE", "The same for the target.")
@path_option(
    "--objects-source",
    "FILE",
    "Picture that is black outside the rope and its ball; with --mask-source of the rope alone.",
)
@path_option("--objects-target", "FILE", "The same for the target.")
@path_option(
    "--depth-source", "FILE", "Depth image: 16-bit millimetres (png, tif) or metres (npy)."
)
@path_option("--depth-target", "FILE", "The same for the target.")
@click.option(
    "--max-size",
    type=click.IntRange(16, 8192),
    default=1024,
    show_default=True,
    metavar="PX",
    help="Reduce larger pictures to this longer side; positions are in pixels of the pictures.",
)
@method_options
@json_option
def command(
    method: str, source: Path, target: Path, out: Path, as_json: bool, **given: Any
) -> None:
    """Find pixels of one picture in another, and draw matches, heat map and confidence.

    METHOD is a name that `pliant methods` lists (all but oracle), the folder of a training run,
    or a matcher of your own: path/to/my.py:Matcher or package.module:Matcher. Without a mask, a
    background of one colour gives one; on others don-rope and don-cloth find the object, and other
    methods search the whole target. A rope's ball is separated from a mask that contains it. The
    heat map is drawn for a single point.

    Pictures are JPEG, PNG, TIFF, WebP, AVIF, JPEG 2000, TGA, BMP, GIF or of another format of
    Pillow.
    """
    from pliant.spec.errors import CallError
    from pliant.viewer.match_figure import check_figure_path, draw_match
    from pliant.viewer.photo_match import grid_points, match_photo
    from pliant.viewer.photo_views import PhotoFiles, read_photo_view

    at = given["at"]
    if bool(at) == (given["grid"] is not None):
        found = "both" if at else "none"
        raise CallError("name the points by --at U,V or by --grid N", found=found)
    check_figure_path(out)
    _check_kept(out, source, target, *(given[name] for name in _MORE_PICTURES))
    matcher = open_photo_method(method, **given["options"])
    title = f"Matching with {matcher.name}"
    with progress_bar(title, "steps") as bar:
        bar(0, 3, title="Reading the pictures")
        a, b = (
            read_photo_view(
                PhotoFiles(
                    path, *(given[f"{kind}_{side}"] for kind in ("mask", "objects", "depth"))
                ),
                given["max_size"],
                asked,
            )
            for side, path, asked in (("source", source, at), ("target", target, ()))
        )
        at = at or grid_points(matcher, a.view, given["grid"], a.size)
        bar(1, 3, title=title)
        match = match_photo(matcher, a.view, b.view, at, sizes=(a.size, b.size))
        bar(2, 3, title="Drawing")
        draw_match(match, a.view, b.view, out)
    document = {
        **match.as_dict(),
        "notes": [*a.notes, *b.notes, *match.notes],
        "source": str(source),
        "target": str(target),
        "figure": str(out),
    }
    text = "\n".join(_lines(document))
    echo_result(document, text, as_json=as_json)


def open_photo_method(method: str, **options: Any) -> Matcher:
    """Open a method by its name, and refuse one that answers whole splits alone.

    Raises:
        CallError: It does, or `open_method` does not take the name or the options.
    """
    from pliant.api import open_method
    from pliant.baselines.matcher import SplitMatcher
    from pliant.spec.errors import CallError

    matcher = open_method(method, **options)
    if isinstance(matcher, SplitMatcher):
        raise CallError(f"the method {method!r} answers the queries of a dataset, not photographs")
    return matcher


def _check_kept(out: Path, *pictures: Path | None) -> None:
    """Refuse to replace a picture by the figure of it."""
    from pliant.spec.errors import CallError

    for each in pictures:
        if each is not None and each.exists() and out.exists() and out.samefile(each):
            raise CallError(
                "the figure would replace a picture that it shows",
                path=out,
                where="--out",
                fix="Name another file.",
            )


def _lines(document: dict[str, Any]) -> list[str]:
    """Return the result for people: a line per point, notes, warnings, and the figure."""
    source, target = document["source"], document["target"]
    points = [
        f"{document['method']}: {_point(point)} of {source} is at {_point(point, 'match_px')} of "
        f"{target}{_certainty(point)}"
        for point in document.get("points", [document])
    ]
    warned = [f"Warning: {warning}" for warning in document["warnings"]]
    return [*points, *document["notes"], *warned, f"Drawn in {document['figure']}"]


def _point(point: dict[str, Any], name: str = "query_px") -> str:
    u, v = point[name]
    return f"({u:.1f}, {v:.1f})"


def _certainty(point: dict[str, Any]) -> str:
    from pliant.baselines.matcher import written_familiarity

    written = {"confidence": "{:.2f}".format, "familiarity": written_familiarity}
    named = ((name, write) for name, write in written.items() if point[name] is not None)
    return "".join(f", {name} {write(point[name])}" for name, write in named)
