"""Killed at random moments and resumed: the set is byte-identical to one made at once.

`PLIANT_KILLS=20` runs as many kills as the benchmark promises; the suite runs two.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.generator.runner.standin import digests

KILLS = int(os.environ.get("PLIANT_KILLS", "2"))
SCRIPT = Path(__file__).with_name("standin.py")


def start(out: Path, workers: int = 1) -> subprocess.Popen[bytes]:
    with out.with_suffix(".err").open("wb") as errors:
        return subprocess.Popen(
            [sys.executable, str(SCRIPT), str(out), str(workers)],
            start_new_session=True,
            stderr=errors,
            preexec_fn=_heed_interrupts,
        )


def _heed_interrupts() -> None:
    """Undo what a shell does to its background jobs: they are started deaf to Ctrl-C."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def files(out: Path) -> int:
    """How many images were written, those of unfinished sequences included."""
    names = [name for _, _, found in os.walk(out) for name in found]  # folders may vanish
    return sum(name.endswith((".png", ".exr")) for name in names)


def sequences(out: Path) -> int:
    return len(list((out / "sequences").glob("*/rope-*")))  # others are unfinished


@pytest.mark.long
def test_killed_at_random_moments(uninterrupted, tmp_path):
    out = tmp_path / "set"
    moments = random.Random(KILLS)
    held = 0
    for kill in range(KILLS):
        run = start(out, workers=1 + kill % 2)
        # A moment is a number of new files, so that it does not depend on the machine's load.
        wanted = files(out) + moments.randint(0, 35)
        while run.poll() is None and files(out) < wanted:
            time.sleep(0.005)
        time.sleep(moments.uniform(0.0, 0.1))
        with contextlib.suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        held = max(held, sequences(out))
        if (out / "dataset.json").exists():  # finished before the kill: begin another set
            assert digests(out) == uninterrupted
            out = tmp_path / f"set-{kill}"
    run = start(out)
    assert run.wait(60) == 0, out.with_suffix(".err").read_text()
    assert digests(out) == uninterrupted
    assert held, "no kill ever came after a finished sequence"
    assert not list((out / "sequences" / "rope").glob(".*"))


@pytest.mark.long
def test_interrupted_in_a_terminal(uninterrupted, tmp_path):
    out = tmp_path / "set"
    run = start(out)
    deadline = time.monotonic() + 30
    while sequences(out) < 1 and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(run.pid, signal.SIGINT)  # as a terminal does: parent and workers alike
    assert run.wait(30) != 0
    assert "KeyboardInterrupt" in out.with_suffix(".err").read_text()
    assert 1 <= sequences(out) < 6
    assert not list((out / "sequences" / "rope").glob(".*"))  # nothing is left half-written
    assert not (out / "dataset.json").exists()
    run = start(out)
    assert run.wait(60) == 0
    assert digests(out) == uninterrupted
