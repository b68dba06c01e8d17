"""Output to the terminal, safe to show."""

from __future__ import annotations

import click


def echo(text: str, *, err: bool = False) -> None:
    r"""Print a text; control, bidirectional and surrogate characters in it appear as escapes.

    Names of files, datasets and methods come from others: they must neither control the terminal
    nor stop a command whose output has an encoding without surrogates.

    Args:
        text: What to print; line feeds and tabs are kept.
        err: Whether it goes to the standard error.
    """
    from pliant.spec.text import escaped  # not needed for `pliant --help`

    click.echo(escaped(text, lines=True), err=err)
