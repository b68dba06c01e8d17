"""Arguments, options and parsers that several commands have."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])


class LocalPath(click.Path):
    """A path on this machine; a URL, in which `Path` would merge slashes, is refused."""

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Any:
        """Return the value as a `Path`."""
        if "://" in str(value):
            self.fail(f"{str(value)!r} is a URL; required: a path on this machine", param, ctx)
        return super().convert(value, param, ctx)


PATH: Final = LocalPath(path_type=Path)
FILE: Final = LocalPath(path_type=Path, dir_okay=False)


def set_option(example: str) -> Callable[[F], F]:
    """Return `--set KEY=VALUE`, as `pliant.spec.configuration.with_overrides` takes it.

    Args:
        example: A setting that the command accepts, such as `seed=3`.
    """
    return click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        help=f"Change one setting: a dotted key and a value in YAML, such as {example}. "
        "Overrides files and other options.",
    )


def _parsed(
    context: click.Context, parameter: click.Parameter, values: tuple[str, ...]
) -> dict[str, Any]:
    del context, parameter
    if not values:
        return {}
    from pliant.spec.configuration import with_overrides

    return with_overrides({}, values)


method_options = click.option(
    "--set",
    "options",
    multiple=True,
    metavar="KEY=VALUE",
    callback=_parsed,
    help="Option of the method, with its value in YAML, such as seed=3; for a trained model, a "
    "setting of `answer`, such as blank_square=any.",
)
"""`--set KEY=VALUE`: keyword arguments for `open_method`."""

json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON document on stdout."
)

split_option = click.option(
    "--split", default="test", show_default=True, help="Split whose queries to answer."
)

reports_argument = click.argument("reports", metavar="REPORTS…", nargs=-1, required=True, type=PATH)


def path_option(
    name: str, metavar: str, text: str, *, kind: click.Path = PATH, **more: Any
) -> Callable[[F], F]:
    """Return an option whose value is a path.

    Args:
        name: Its name, such as `--truth`.
        metavar: How help shows the value.
        text: Its help.
        kind: `PATH`, or `FILE`, which refuses a folder.
        more: What else `click.option` takes, such as `required=True`.
    """
    return click.option(name, metavar=metavar, type=kind, help=text, **more)


def port_options(function: F, default: str = "any free port") -> F:
    """Add `--port` and `--no-browser`, the options of a local web page."""
    port = click.option(
        "--port", type=click.IntRange(0, 65535), default=0, help=f"Port; default: {default}."
    )
    quiet = click.option(
        "--no-browser", is_flag=True, help="Print the address, do not open a browser."
    )
    return port(quiet(function))


def out_option(metavar: str, text: str, kind: click.Path = PATH) -> Callable[[F], F]:
    """Return `--out`, the required path of what a command writes."""
    return path_option("--out", metavar, text, kind=kind, required=True)


def _not_text(context: click.Context, parameter: click.Parameter, path: Path) -> Path:
    del context, parameter
    if path.suffix.lower() in (".csv", ".json", ".jsonl"):
        raise click.BadParameter(f"{path} would be a Parquet file. Name it so: SUB.parquet")
    return path


submission_out_option = path_option(
    "--out",
    "SUB.parquet",
    "The submission to write; an earlier submission there is replaced.",
    required=True,
    callback=_not_text,
)


def data_option(text: str) -> Callable[[F], F]:
    """Return `--data`, the required folder of a dataset."""
    return path_option("--data", "DIR", text, required=True)


def kind_option(matches: str) -> Callable[[F], F]:
    """Return `--kind`, the kind of a submission.

    Args:
        matches: Whose keypoint matches the second kind contains.
    """
    text = f"Answers to the queries, or {matches} own keypoint matches."
    return choice_option("--kind", ["answers", "matches"], text, "answers")


def choice_option(
    name: str, choices: Sequence[str], text: str, default: str | None = None
) -> Callable[[F], F]:
    """Return an option that takes one of some names.

    Args:
        name: Its name, such as `--split`.
        choices: The names.
        text: Its help.
        default: The default, which help shows; None for none.
    """
    return click.option(
        name,
        type=click.Choice(choices),
        default=default,
        show_default=default is not None,
        help=text,
    )


def workers_option(of_what: str = "") -> Callable[[F], F]:
    """Return `--workers`, a number of processes that changes no output.

    Args:
        of_what: What the processes are for, after their name.
    """
    text = f"Number of worker processes{of_what}; does not change the output."
    return click.option("--workers", default=1, show_default=True, metavar="N", help=text)


def image_size(text: str) -> tuple[int, int]:
    """Return (width, height) from a text such as `640x480`.

    Raises:
        CallError: It is not of this form.
    """
    match = re.fullmatch(r"\s*(-?\d{1,6})\s*x\s*(-?\d{1,6})\s*", text.lower())
    if match is None:
        from pliant.spec.errors import CallError

        raise CallError(
            "the size cannot be read",
            where="--size",
            found=repr(text)[:40],
            required="WxH, such as 640x480",
        )
    return int(match[1]), int(match[2])
