"""`pliant match`: one pixel of a picture found in another."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pliant.cli.options import json_option, method_options, out_option, path_option
from pliant.cli.terminal import echo_result


def _position(ctx: click.Context, param: click.Parameter, value: str) -> tuple[float, float]:
    try:
        u, v = (float(part) for part in value.split(","))
    except ValueError as error:
        raise click.BadParameter(
            f"found {value!r}; required: two numbers, such as 320.5,240.5", ctx, param
        ) from error
    return u, v


@click.command()
@click.argument("method")
@path_option("--source", "A.png", "Has the pixel.", required=True)
@path_option("--target", "B.png", "Is searched.", required=True)
@click.option(
    "--at",
    required=True,
    callback=_position,
    metavar="U,V",
    help="The pixel; the centre of the first one is 0.5,0.5.",
)
@out_option("FIG.png", "The figure: png, pdf, svg or jpg.")
@path_option(
    "--mask-source",
    "FILE",
    "Picture that is black outside the object; an object on black is its own mask.",
)
@path_option("--mask-target", "FILE", "The same for the target.")
@method_options
@json_option
def command(
    method: str,
    source: Path,
    target: Path,
    at: tuple[float, float],
    out: Path,
    mask_source: Path | None,
    mask_target: Path | None,
    options: dict[str, Any],
    as_json: bool,
) -> None:
    """Find a pixel of one picture in another, and draw match, heat map and confidence.

    METHOD is a name that `pliant methods` lists (all but oracle), the folder of a training run,
    or a matcher of your own: path/to/my.py:Matcher or package.module:Matcher. Without
    --mask-target the whole target is searched.
    """
    from pliant.api import open_method
    from pliant.baselines.matcher import SplitMatcher
    from pliant.baselines.photo import read_view
    from pliant.spec.errors import CallError
    from pliant.viewer.match_figure import check_figure_path, draw_match, match_photo

    check_figure_path(out)
    matcher = open_method(method, **options)
    if isinstance(matcher, SplitMatcher):
        raise CallError(f"the method {method!r} answers the queries of a dataset, not photographs")
    view_a, view_b = read_view(source, mask_source), read_view(target, mask_target)
    match = match_photo(matcher, view_a, view_b, at)
    draw_match(match, view_a, view_b, out)
    confidence = "" if match.heat is None else f", confidence {match.heat.confidence:.2f}"
    text = (
        f"{matcher.name}: ({at[0]:g}, {at[1]:g}) of {source} is at ({match.uv_b_px[0]:.1f}, "
        f"{match.uv_b_px[1]:.1f}) of {target}{confidence}; drawn in {out}"
    )
    files = {"source": str(source), "target": str(target), "figure": str(out)}
    echo_result({**match.as_dict(), **files}, text, as_json=as_json)
