"""An output folder is written whole or not at all, whatever ends the process."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pliant.spec.errors import CallError
from pliant.spec.io.staging import is_left_alone, staged, staged_both
from pliant.spec.io.writing import replacing
from tests.privilege import without_privilege

PROGRAM = """
import signal, sys, time
from pathlib import Path
from pliant.cli.terminal import terminated_like_interrupted
from pliant.spec.io.staging import staged

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
with terminated_like_interrupted(""), staged(Path(sys.argv[1])) as place:
    (place / "half").write_text("half")
    print("ready", flush=True)
    while True:  # a signal just before a long sleep would wait for its end
        time.sleep(0.05)
"""


def killed(out: Path, number: signal.Signals) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(out)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    process.send_signal(number)
    process.wait(30)
    process.stdout.close()


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_stopped_process_leaves_nothing(tmp_path: Path, number: signal.Signals) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "earlier").touch()
    killed(out, number)
    assert names(tmp_path) == ["out"]
    assert names(out) == ["earlier"]


def test_the_next_run_removes_what_a_killed_one_left(tmp_path: Path) -> None:
    out = tmp_path / "out"
    killed(out, signal.SIGKILL)
    (left,) = names(tmp_path)
    assert left.startswith(".out.")
    with staged(out) as place:
        (place / "whole").touch()
    assert names(tmp_path) == ["out"]
    assert names(out) == ["whole"]


def test_an_error_inside_leaves_the_earlier_folder(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with staged(out) as place:
        (place / "first").touch()
    with pytest.raises(CallError, match="cannot be written"), staged(out) as place:
        (place / "missing" / "file").write_text("")
    assert names(tmp_path) == ["out"]
    assert names(out) == ["first"]


def test_a_source_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.touch()
    unread = PermissionError(errno.EACCES, "Permission denied", str(source))
    with (
        pytest.raises(CallError, match=r"/source: the file cannot be read"),
        staged(tmp_path / "a"),
    ):
        raise unread
    assert names(tmp_path) == ["source"]


WRITING = """
import sys
from pathlib import Path
from pliant.spec.io.staging import staged

with staged(Path(sys.argv[1])) as place:
    print("written")
    (place / "second").touch()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs prctl")
def test_a_read_only_folder_is_not_replaced(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "first").touch()
    out.chmod(0o555)
    done = subprocess.run(
        [sys.executable, "-c", WRITING, str(out)],
        capture_output=True,
        text=True,
        preexec_fn=without_privilege,
    )
    out.chmod(0o755)
    assert "CallError" in done.stderr
    assert "found Permission denied. Name another place" in done.stderr
    assert done.stdout == ""
    assert names(tmp_path) == ["out"]
    assert names(out) == ["first"]


def test_an_error_while_the_earlier_folder_is_removed_leaves_nothing_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, failed, unlink = tmp_path / "out", list[object](), os.unlink

    def failing_once(path: str, *, dir_fd: int | None = None) -> None:
        if not failed:
            failed.append(path)
            raise OSError(errno.EIO, "I/O error")
        unlink(path, dir_fd=dir_fd)

    with staged(out) as place:
        (place / "a.txt").write_text("earlier")
    monkeypatch.setattr(os, "unlink", failing_once)
    with staged(out) as place:
        (place / "a.txt").write_text("later")
    assert failed == ["a.txt"]
    assert os.listdir(tmp_path) == ["out"]
    assert (out / "a.txt").read_text() == "later"


def test_on_windows_no_process_is_ended_to_learn_whether_it_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = tmp_path / ".x.999999999.partial.json"
    left.touch()
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(os, "kill", lambda *_: pytest.fail("os.kill ends processes there"))
    with replacing(tmp_path / "x.json") as partial:
        partial.touch()
    assert left.exists()


def test_the_next_writing_of_a_file_removes_what_a_killed_one_left(tmp_path: Path) -> None:
    ended = subprocess.Popen(["true"])
    ended.wait()
    for name in (f".a.{ended.pid}.partial.json", f".a.{os.getpid()}.partial.txt"):
        (tmp_path / name).touch()
    with replacing(tmp_path / "a.json") as partial:
        partial.touch()
    assert names(tmp_path) == [f".a.{os.getpid()}.partial.txt", "a.json"]


PAIR = """
import os, sys
from pathlib import Path
from pliant.spec.io import staging

def rename(path, target, original=Path.rename):
    if target.name == "out":
        if sys.argv[2] == "killed":
            os.kill(os.getpid(), 9)
        raise OSError(5, "Input/output error")
    return original(path, target)

Path.rename = rename
folder = Path(sys.argv[1])
with staging.staged_both(folder / "out", folder / "other") as places:
    for place in places:
        (place / "file").touch()
"""


def test_of_two_folders_both_are_there_or_neither(tmp_path: Path) -> None:
    out, other = tmp_path / "out", tmp_path / "other"
    codes = {}
    for how in ("error", "killed"):
        done = subprocess.run([sys.executable, "-c", PAIR, str(tmp_path), how], capture_output=True)
        codes[how] = (done.returncode, is_left_alone(other, out), len(names(tmp_path)))
    assert codes == {"error": (1, False, 0), "killed": (-9, True, 2)}
    with staged_both(out, other) as places:
        for place in places:
            (place / "new").touch()
    assert names(tmp_path) == ["other", "out"]
    assert names(other) == names(out) == ["new"]


WRITER = """
import sys
from pathlib import Path
from pliant.spec.errors import CallError
from pliant.spec.io.staging import staged
from pliant.spec.io.writing import replacing

out, name, refused = Path(sys.argv[1]), sys.argv[2], 0
for number in range(40):
    try:
        with staged(out) as place:
            for each in range(5):
                (place / str(each)).write_text(name)
        with replacing(out.with_suffix(".txt")) as file:
            file.write_text(name * 1000)
    except CallError:
        refused += 1
print(refused)
"""


def test_two_processes_that_write_one_folder(tmp_path: Path) -> None:
    """At every moment each writes all of it or gets an error; what is left is of one of them."""
    out = tmp_path / "out"
    both = [
        subprocess.Popen(
            [sys.executable, "-c", WRITER, str(out), name], stdout=subprocess.PIPE, text=True
        )
        for name in "ab"
    ]
    refused = [int(each.communicate(timeout=120)[0]) for each in both]
    assert [each.returncode for each in both] == [0, 0]
    assert sum(refused) < 80
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "out.txt"]
    assert len({path.read_text() for path in out.iterdir()}) == 1
    assert len(list(out.iterdir())) == 5
    assert set(out.with_suffix(".txt").read_text()) in ({"a"}, {"b"})


@pytest.mark.parametrize("names", [("out", "out"), ("out", "out/other"), ("other/out", "other")])
def test_two_folders_are_apart(names: tuple[str, str], tmp_path: Path) -> None:
    """The second rename would replace the folder that contains the first one."""
    one, two = (tmp_path / name for name in names)
    with pytest.raises(CallError, match="one is inside the other"), staged_both(one, two):
        pytest.fail("the body is not run")
    assert list(tmp_path.iterdir()) == []


def fill(folder: Path) -> None:
    """Write what another process finished in the meantime."""
    folder.mkdir(exist_ok=True)
    (folder / "theirs").touch()


def stage_new(out: Path) -> None:
    with staged(out, new=True):
        fill(out)


def stage_both(out: Path, other: Path) -> None:
    with staged_both(out, other):
        fill(other)


def test_a_new_folder_does_not_replace_the_one_of_another_process(tmp_path: Path) -> None:
    """Both found no folder at the start; the first to end has it, and it keeps both of a pair."""
    out, other = tmp_path / "out", tmp_path / "other"
    with pytest.raises(CallError, match="exists already"):
        stage_new(tmp_path / "single")
    with pytest.raises(CallError, match="exists already"):
        stage_both(out, other)
    assert names(tmp_path) == ["other", "single"]
    assert names(tmp_path / "single") == names(other) == ["theirs"]
