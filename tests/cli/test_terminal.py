"""Progress of long commands: in a log a line every so often, with the measured rate."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rich import console

from pliant.cli import terminal
from pliant.cli.terminal import (
    Bar,
    progress_bar,
    rich_progress,
    terminated_like_interrupted,
    to_call,
)
from pliant.cli.train import _Progress
from pliant.spec.text import duration, plural


def test_durations_for_people() -> None:
    assert [duration(s) for s in (3, 600, 36000)] == ["3.0 s", "10 min", "10.0 h"]


def test_counts_for_people() -> None:
    assert [plural(n, "frame") for n in (0, 1, 1200)] == ["0 frames", "1 frame", "1,200 frames"]
    assert [plural(n, "query") for n in (1, 2)] == ["1 query", "2 queries"]


def test_a_command_to_copy_has_its_paths_in_quotes() -> None:
    assert to_call("pliant", "check", Path("a b.parquet")) == "pliant check 'a b.parquet'"


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    for module in (time, console):
        monkeypatch.setattr(module, "monotonic", lambda: now[0])
    return now


def test_the_time_left_is_that_of_the_measured_rate(clock: list[float]) -> None:
    """A slow beginning (reading frames, compiling) does not count."""
    bar = Bar("Training", "steps", rich_progress(hidden=True))
    clock[0] = 100
    assert bar.line() == "Training: preparing, 2 min so far"
    for step in range(1, 11):
        bar(step, 3610, facts="loss 0.500")
        clock[0] += 2
    assert bar.line() == "Training: 10 of 3,610 steps, 0.5 steps/s, 2.0 h left, loss 0.500"
    for step in range(11, 1400):  # it becomes quicker: the last calls count
        bar(step, 3610)
        clock[0] += 1
    assert bar.line() == "Training: 1,399 of 3,610 steps, 1 steps/s, 37 min left"
    bar(3610, 3610)
    assert "left" not in bar.line()


def test_a_resumed_run_counts_what_it_did_itself(clock: list[float]) -> None:
    bar = Bar("Training", "steps", rich_progress(hidden=True))
    for step in (1001, 1002, 1003):
        bar(step, 1103)
        clock[0] += 10
    assert bar.line() == "Training: 1,003 of 1,103 steps, 0.1 steps/s, 17 min left"


def test_a_log_has_lines_also_before_the_first_step(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(terminal, "LOG_EVERY_S", 0.05)

    def wait_for(line: str) -> None:
        shown = ""
        end = time.monotonic() + 60
        while not re.search(line, shown):
            assert time.monotonic() < end, shown
            time.sleep(0.02)
            written = capfd.readouterr()
            assert written.out == ""
            shown += written.err

    with progress_bar("Training", "steps") as bar:
        wait_for(r"Training: preparing, \d+\.\d s so far\n")
        bar(1, 4)
        time.sleep(0.02)
        bar(2, 4, facts="loss 1.250")
        wait_for(r"Training: 2 of 4 steps, [\d.]+ steps/s, \d+\.\d s left, loss 1\.250\n")
    capfd.readouterr()
    time.sleep(0.2)
    assert capfd.readouterr().err == ""  # nothing after the end


def test_a_log_has_no_line_twice(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(terminal, "LOG_EVERY_S", 0.01)
    with progress_bar("Training", "steps") as bar:
        bar(2, 2, facts="measuring")
        time.sleep(0.5)
    assert capfd.readouterr().err == "Training: 2 of 2 steps, measuring\n"


def test_a_log_says_that_a_trained_run_is_measured() -> None:
    """The measurements take as long as many steps, and no step comes then."""
    bar = Bar("Training", "steps", rich_progress(hidden=True))
    progress = _Progress(bar, 2)
    progress(1, {"loss": 3.0})
    assert bar.line().endswith("1 of 2 steps, loss 3.000")
    progress(2, {"val/rmse_px": 4.0})
    assert bar.line().endswith("loss 3.000, val RMSE 4.0 px, measuring the trained network")


def test_json_and_terminals_have_no_lines(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(terminal, "LOG_EVERY_S", 0.01)
    with progress_bar("Training", "steps", hidden=True) as bar:
        bar(1, 2)
        time.sleep(0.1)
    assert capfd.readouterr() == ("", "")


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
from pliant.cli.terminal import terminated_like_interrupted

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
