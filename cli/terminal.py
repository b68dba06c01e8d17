"""What commands show, JSON, progress bars, local pages, and their end by Ctrl-C or SIGTERM."""

from __future__ import annotations

import json
import os
import shlex
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

import click

from pliant.spec.text import duration, escaped

if TYPE_CHECKING:
    from rich.progress import Progress

    from pliant.viewer.local_app import LocalServer

LOG_EVERY_S: Final = 30.0
"""Seconds between the lines of a command whose stderr is not a terminal."""

_RATE_S: Final = 1800.0
"""The rate is that of the last so many seconds, and of rich's last 1,000 calls at most."""


def echo(text: str, *, err: bool = False) -> None:
    r"""Print a text; control, bidirectional and surrogate characters in it appear as escapes.

    Names of files, datasets and methods come from others: they must neither control the terminal
    nor stop a command whose output has an encoding without surrogates.

    Args:
        text: What to print; line feeds and tabs are kept.
        err: Whether it goes to the standard error.
    """
    click.echo(escaped(text, lines=True), err=err)


def echo_json(document: object, *, sort_keys: bool = False) -> None:
    """Print a JSON document, the whole output of a command under `--json`.

    Args:
        document: JSON values.
        sort_keys: Whether keys are sorted.
    """
    echo(json.dumps(document, indent=1, sort_keys=sort_keys))


def echo_result(document: object, text: str, *, as_json: bool) -> None:
    """Print what a command did: as one JSON document, or in words."""
    if as_json:
        echo_json(document)
    else:
        echo(text)


def rich_progress(unit: str = "", *, hidden: bool = False, time_left: bool = False) -> Progress:
    """Return rich's display of tasks on stderr.

    Args:
        unit: What is counted, shown after the numbers.
        hidden: Show nothing.
        time_left: Show rich's estimate of the time left.
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
        *([TimeRemainingColumn()] if time_left else []),
        TextColumn("{task.fields[facts]}"),
        console=Console(stderr=True),
        transient=True,
        disable=hidden,
        speed_estimate_period=_RATE_S,
    )


class Bar:
    """How far a command is, its measured rate, and the time left by that rate.

    On a terminal it is a bar. Elsewhere, in a log, `line` is its text.

    Args:
        title: What is being done.
        unit: What is counted.
        progress: The display of the bar.
    """

    def __init__(self, title: str, unit: str, progress: Progress) -> None:
        self._title, self._unit, self._progress = title, unit, progress
        self._begun = time.monotonic()
        self._facts = ""

    def __call__(self, done: int, total: int, *, title: str = "", facts: str = "") -> None:
        """Move the bar, which appears at the first call.

        Args:
            done: Units done.
            total: Units in all.
            title: What is being done now; empty keeps the title.
            facts: Text after the bar.
        """
        self._facts = facts
        if not self._progress.tasks:
            self._progress.add_task(self._title, total=total, facts="")
        (task,) = self._progress.task_ids
        self._progress.update(task, description=title or None, completed=done, total=total)
        self._progress.update(task, facts=self._rate_and_facts())

    def line(self) -> str:
        """Return the state in one line, for a log."""
        if not self._progress.tasks:
            return f"{self._title}: preparing, {duration(time.monotonic() - self._begun)} so far"
        (task,) = self._progress.tasks
        done = f"{task.completed:,} of {task.total:,} {self._unit}"
        return f"{self._title}: {done}, {self._rate_and_facts()}".rstrip(", ")

    def _rate_and_facts(self) -> str:
        """Return the rate, the time left by it, and the facts.

        The first call is where measuring begins, so the time of preparations does not count.
        """
        (task,) = self._progress.tasks
        texts = []
        if rate := task.speed:
            texts = [f"{rate:.2g} {self._unit}/s"]
            if left_s := task.time_remaining:
                texts.append(f"{duration(left_s)} left")
        return ", ".join(text for text in (*texts, self._facts) if text)

    def print(self, text: str) -> None:
        """Print a line above the bar."""
        self._progress.console.print(text, highlight=False, soft_wrap=True)


@contextmanager
def progress_bar(title: str, unit: str = "", *, hidden: bool = False) -> Iterator[Bar]:
    """Show progress on stderr: a bar on a terminal, elsewhere a line every 30 s if it is a new one.

    Args:
        title: What is being done.
        unit: What is counted.
        hidden: Show nothing.

    Yields:
        The bar.
    """
    in_log = not sys.stderr.isatty()
    with rich_progress(unit, hidden=hidden or in_log) as progress:
        bar = Bar(title, unit, progress)
        if hidden or not in_log:
            yield bar
            return
        ended = threading.Event()

        def write_lines() -> None:
            written = ""
            while not ended.wait(LOG_EVERY_S):
                if (line := bar.line()) != written:
                    echo(line, err=True)
                written = line

        writer = threading.Thread(target=write_lines, daemon=True)
        writer.start()
        try:
            yield bar
        finally:
            ended.set()
            writer.join()


def to_call(*parts: object) -> str:
    """Return a command in the form that a shell takes: paths with spaces in quotes."""
    return shlex.join(map(str, parts))


@contextmanager
def terminated_like_interrupted(message: str) -> Iterator[None]:
    """Let SIGTERM raise KeyboardInterrupt here and in the processes started from here.

    A cluster sends SIGTERM before it takes a machine away. Ctrl-C needs no help: a terminal sends
    it to all of a command's processes.

    Args:
        message: Said on stderr on the way out; empty for nothing.
    """
    import multiprocessing  # takes 6 ms, and every command imports this module

    def interrupt(number: int, frame: object) -> None:
        for child in multiprocessing.active_children():
            if child.pid is not None:
                os.kill(child.pid, signal.SIGINT)
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may take signals
        return
    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    except KeyboardInterrupt:
        if message:
            echo(message, err=True)
        raise
    finally:
        signal.signal(signal.SIGTERM, before)


def show_page(server: LocalServer, subject: str, *, no_browser: bool) -> None:
    """Print a server's address, open it in the browser, and serve until Ctrl-C.

    Args:
        server: The server; it is closed at the end.
        subject: What the page shows.
        no_browser: Do not open a browser.
    """
    import webbrowser

    echo(f"{subject}\n{server.address} (Ctrl-C ends)")
    if not no_browser:
        webbrowser.open(server.address)
    server.run()
