from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from pliant.cli.interrupts import terminated_like_interrupted


def test_sigterm_interrupts_and_the_old_handler_comes_back(
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), terminated_like_interrupted("Go on with --resume"):
        os.kill(os.getpid(), signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before
    assert capsys.readouterr().err == "Go on with --resume\n"


PARENT = """
import multiprocessing, os, signal, sys, time
from pliant.cli.interrupts import terminated_like_interrupted

def work(ready):
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        ready.set()
        while True:  # a signal just before a long sleep would wait for its end
            time.sleep(0.05)
    except KeyboardInterrupt:
        print("child saved", flush=True)

if __name__ == "__main__":
    ready = multiprocessing.Event()
    child = multiprocessing.Process(target=work, args=(ready,))
    try:
        with terminated_like_interrupted(""):
            child.start()
            ready.wait()
            os.kill(os.getpid(), signal.SIGTERM)
            while True:
                time.sleep(0.05)
    except KeyboardInterrupt:
        child.join(30)
        sys.exit(child.exitcode)
"""


def test_processes_started_from_here_are_interrupted_too() -> None:
    done = subprocess.run([sys.executable, "-c", PARENT], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "child saved\n"), done.stderr
