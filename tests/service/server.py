"""Runs `pliant serve` as its users do: a process of its own, on a free port."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_MAIN = "from pliant.cli.main import main; main()"


class Server:
    """A running service.

    Args:
        root: The challenge's folder.
        log: File that receives its log.
        options: More options of `pliant serve`.
    """

    def __init__(self, root: Path, log: Path, *options: str) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.address = f"http://127.0.0.1:{port}"
        self._command = [sys.executable, "-c", _MAIN, "serve", str(root), "--port", str(port)]
        self._command += options
        self._log = log
        self.start()

    def start(self) -> None:
        """Start it, after `kill` again on the same port."""
        with open(self._log, "ab") as log:
            self.process = subprocess.Popen(
                self._command, stdout=log, stderr=log, start_new_session=True
            )

    def wait(self, seconds: float = 180) -> None:
        """Wait until it answers."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            with suppress(OSError), urllib.request.urlopen(f"{self.address}/healthz", timeout=5):
                return
            assert self.process.poll() is None, self._log.read_text()
            time.sleep(0.1)
        raise AssertionError(self._log.read_text())

    def kill(self) -> None:
        """Kill it and its workers at once, as a power cut would."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def stop(self) -> int:
        """Stop it gracefully and return its exit code."""
        self.process.terminate()
        return self.process.wait(60)


@contextmanager
def serving(root: Path, log: Path, *options: str) -> Iterator[Server]:
    """Run a service for as long as the body runs."""
    server = Server(root, log, *options)
    try:
        server.wait()
        yield server
    finally:
        server.kill()
