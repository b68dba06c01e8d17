"""SIGTERM, which a cluster sends before it takes a machine away, stops a command as Ctrl-C does."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from pliant.cli.terminal import echo


@contextmanager
def terminated_like_interrupted(message: str) -> Iterator[None]:
    """Let SIGTERM raise KeyboardInterrupt here and in the processes started from here.

    Ctrl-C reaches those by itself: a terminal sends it to all of a command's processes.

    Args:
        message: Said on stderr on the way out; empty for nothing.
    """

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
