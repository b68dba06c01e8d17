"""Processes of a training end with the program that launched them."""

from __future__ import annotations

import select
import subprocess
import sys

_WORKER = (
    "import time; from pliant.models.training.interrupts import stop_with_launcher; "
    "stop_with_launcher(); print('ready', flush=True); time.sleep(100)"
)
_LAUNCHER = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {_WORKER!r}])"


def test_a_killed_launcher_leaves_no_process() -> None:
    with subprocess.Popen([sys.executable, "-c", _LAUNCHER], stdout=subprocess.PIPE) as launcher:
        assert launcher.stdout is not None
        assert launcher.stdout.readline() == b"ready\n"
        launcher.kill()
        ended, _, _ = select.select([launcher.stdout], [], [], 20)  # the worker has it open
        assert ended
        assert launcher.stdout.read() == b""
