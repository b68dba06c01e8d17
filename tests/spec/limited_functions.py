"""What the child processes of test_limits.py run: what no function of a library does."""

from __future__ import annotations

import os
import signal
import socket
import time
from pathlib import Path

import numpy as np

from pliant.spec.errors import Issue, MissingExtraError, SubmissionError


def double(values: np.ndarray) -> np.ndarray:
    print("on standard output, as a library does")
    return values * 2


def loop() -> None:
    while True:
        pass


def fork_and_stay(record: Path) -> str:
    """Start a process that outlives this one, and return."""
    if (child := os.fork()) == 0:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        time.sleep(600)
        os._exit(0)
    record.write_text(str(child))
    return "done"


def refuse() -> None:
    issue = Issue("ROW_MISSING", "error", "a.parquet", "row 3", "a row is missing")
    raise SubmissionError("the submission cannot be scored", issues=[issue], path="a.parquet")


def need_extra() -> None:
    raise MissingExtraError("the method", "train")


def fail() -> None:
    raise ZeroDivisionError("a fault of the code")


def connect(port: int) -> str:
    with socket.create_connection(("127.0.0.1", port), timeout=5):
        return "connected"


def run_and_record(record: Path) -> None:
    record.write_text(str(os.getpid()))
    time.sleep(600)
