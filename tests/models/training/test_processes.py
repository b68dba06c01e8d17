"""The processes of a training: `precision: auto`, and processes that end with their launcher."""

from __future__ import annotations

import select
import subprocess
import sys
from pathlib import Path

import pytest

from pliant.models.training import processes
from pliant.models.training.processes import bfloat16_is_native, halved

CPU_FLAGS = Path("/proc/cpuinfo")


@pytest.mark.skipif(not CPU_FLAGS.exists(), reason="Linux says what the processor has")
def test_the_processor_is_known() -> None:
    flags = CPU_FLAGS.read_text()
    assert bfloat16_is_native("cpu") == ("avx512_bf16" in flags or "amx_bf16" in flags)


@pytest.mark.parametrize("native", [True, False])
def test_auto_follows_the_processor(native: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "bfloat16_is_native", lambda _: native)
    assert halved("auto", "cpu") is native
    assert halved("bfloat16", "cpu")
    assert not halved("float32", "cpu")


_WORKER = (
    "import time; from pliant.models.training.processes import stop_with_launcher; "
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
