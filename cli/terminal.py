"""Output of commands: text that is safe to show, JSON, and progress bars."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


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


def echo_json(document: object, *, sort_keys: bool = False, ensure_ascii: bool = True) -> None:
    """Print a JSON document, the whole output of a command under `--json`.

    Args:
        document: JSON values.
        sort_keys: Whether keys are sorted.
        ensure_ascii: Whether other characters appear as escapes.
    """
    echo(json.dumps(document, indent=1, sort_keys=sort_keys, ensure_ascii=ensure_ascii))


def echo_result(document: object, text: str, *, as_json: bool) -> None:
    """Print what a command did: as one JSON document, or in words."""
    if as_json:
        echo_json(document)
    else:
        echo(text)


def rich_progress(unit: str = "", *, hidden: bool = False, transient: bool = True) -> Progress:
    """Return rich's display of tasks on stderr.

    Args:
        unit: What is counted, shown after the numbers.
        hidden: Show nothing.
        transient: Whether the display disappears at the end.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        unit,
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[facts]}"),
        console=Console(stderr=True),
        transient=transient,
        disable=hidden,
    )


class Bar:
    """One progress bar; call it with what is done and what there is in all."""

    def __init__(self, title: str, progress: Progress) -> None:
        self._title, self._progress = title, progress
        self._task: TaskID | None = None

    def __call__(self, done: int, total: int, *, title: str = "", facts: str = "") -> None:
        """Move the bar, which appears at the first call.

        Args:
            done: Units done.
            total: Units in all.
            title: What is being done now; empty keeps the bar's title.
            facts: Text after the bar.
        """
        if self._task is None:
            self._task = self._progress.add_task("", total=total, facts="")
        self._progress.update(
            self._task,
            description=title or self._title,
            completed=done,
            total=total,
            facts=facts,
        )

    @property
    def rate(self) -> float | None:
        """Units per second, None before it is known."""
        return None if self._task is None else self._progress.tasks[0].speed

    def print(self, text: str) -> None:
        """Print a line above the bar."""
        self._progress.console.print(text, highlight=False, soft_wrap=True)


@contextmanager
def progress_bar(
    title: str, unit: str = "", *, hidden: bool = False, transient: bool = True
) -> Iterator[Bar]:
    """Show a progress bar on stderr.

    Args:
        title: What is being done.
        unit: What is counted.
        hidden: Show nothing.
        transient: Whether the bar disappears at the end.

    Yields:
        The bar.
    """
    with rich_progress(unit, hidden=hidden, transient=transient) as progress:
        yield Bar(title, progress)


def plural(count: int, noun: str) -> str:
    """Return a count with its noun, such as `1 sequence` or `1,200 sequences`."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
