from __future__ import annotations

import ctypes
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pliant.spec import limits as limits_module
from pliant.spec.errors import MissingExtraError, SubmissionError
from pliant.spec.limits import LimitError, Limits, run_limited
from tests.spec import limited_functions as child

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and resource")


def gone(pid: int, within_s: float = 10) -> bool:
    """Whether a process has ended (a zombie has)."""
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        with suppress(FileNotFoundError):
            if Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z":
                time.sleep(0.05)
                continue
        return True
    return False


def test_result_of_a_child_is_returned_with_its_arrays() -> None:
    values = np.arange(3_000_000)
    doubled = run_limited(partial(child.double, values))
    assert np.array_equal(doubled, values * 2)
    doubled[0] = 1  # it can be written to, like any array


@pytest.mark.parametrize(
    ("function", "limits", "reason", "words"),
    [
        (partial(np.ones, 8 * 2**30, np.uint8), Limits(), "memory", "at most 4.3 GB"),
        pytest.param(
            partial(pa.allocate_buffer, 8 * 2**30),
            Limits(),
            "memory",
            "at most 4.3 GB",
            marks=pytest.mark.long,
        ),
        (child.loop, Limits(cpu_s=1), "time", "1 s of CPU time"),
        (partial(time.sleep, 600), Limits(wall_s=1.5), "time", "at most 1.5 s"),
        (partial(ctypes.string_at, 0), Limits(), "crash", "SIGSEGV"),
        pytest.param(
            partial(sys.exit, 0), Limits(), "crash", "SystemExit(0)", marks=pytest.mark.long
        ),
        (
            partial(Path.write_bytes, Path("large"), bytes(10**6)),
            Limits(file_bytes=10**5),
            "size",
            "100.0 kB",
        ),
    ],
)
def test_every_limit_gives_one_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, function, limits, reason, words
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LimitError) as caught:
        run_limited(function, limits=limits, path="submission.parquet")
    assert caught.value.reason == reason
    assert str(caught.value).startswith("submission.parquet: reading the file")
    assert words in str(caught.value)


def test_an_arrow_table_crosses_whole_and_fits_into_little_memory() -> None:
    table = pa.table({"u": np.arange(1e6), "name": ["a"] * 10**6})
    found = run_limited(partial(table.slice, 0), limits=Limits(memory_bytes=2**28))
    assert found.equals(table)


def test_process_that_the_child_started_ends_with_it(tmp_path: Path) -> None:
    record = tmp_path / "pid"
    assert run_limited(partial(child.fork_and_stay, record)) == "done"
    assert gone(int(record.read_text()))


def test_child_ends_with_its_parent(tmp_path: Path) -> None:
    record = tmp_path / "pid"
    code = """
import sys
from functools import partial
from pathlib import Path
from pliant.spec.limits import run_limited
from tests.spec.limited_functions import run_and_record
run_limited(partial(run_and_record, Path(sys.argv[1])))
"""
    parent = subprocess.Popen(
        [sys.executable, "-c", code, str(record)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    while not record.exists() or not record.read_text():
        assert parent.poll() is None
        time.sleep(0.05)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert gone(int(record.read_text()))


def test_errors_of_the_function_arrive_as_they_are() -> None:
    with pytest.raises(SubmissionError, match="cannot be scored") as refused:
        run_limited(child.refuse)
    assert [issue.code for issue in refused.value.issues] == ["ROW_MISSING"]
    with pytest.raises(MissingExtraError, match=r"pip install 'pliant\[train\]'"):
        run_limited(child.need_extra)
    with pytest.raises(ZeroDivisionError) as failed:
        run_limited(child.fail)
    assert "in fail" in failed.value.__notes__[0]  # where it happened in the child


def test_temporary_files_of_the_child_are_removed() -> None:
    assert not Path(run_limited(tempfile.mkdtemp)).parent.exists()


def test_child_without_network_reaches_nothing() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        work = partial(child.connect, server.getsockname()[1])
        assert run_limited(work) == "connected"
        if not namespaces_allowed():
            pytest.skip("the kernel gives this user no network namespace")
        with pytest.raises(OSError, match=r"unreachable|refused"):
            run_limited(work, limits=Limits(network=False))


def namespaces_allowed() -> bool:
    return any(
        subprocess.run(["unshare", *options, "true"], capture_output=True).returncode == 0
        for options in (["--net"], ["--user", "--net"])
    )


def test_system_without_resource_limits_time_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits_module, "resource", None)
    limits_module._apply(Limits(cpu_s=0))
    with pytest.raises(LimitError, match="takes too long"):
        run_limited(partial(time.sleep, 600), limits=Limits(wall_s=1))
