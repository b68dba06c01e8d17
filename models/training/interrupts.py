"""Ctrl-C is for the process that trains, between two steps; a launcher does not leave it alone."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker


@contextmanager
def interrupts_deferred() -> Iterator[None]:
    """Handle SIGINT and SIGTERM after the body instead of within it."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread handles signals
        return
    received: list[int] = []
    usual = {
        number: signal.signal(number, lambda number, _: received.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)
    if received:
        signal.raise_signal(received[0])


def stop_with_launcher() -> None:
    """Send this process SIGTERM once its parent has ended: a killed one stops no process itself."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def children_ignore_interrupts() -> Iterator[None]:
    """Let processes that the body starts ignore SIGINT; here it is handled after the body."""
    with interrupts_deferred():
        if sys.platform == "win32":  # processes inherit no signal mask there
            yield
            return
        resource_tracker.ensure_running()  # begun within, it would unblock the signal
        usual = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, usual)
