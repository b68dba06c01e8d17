"""Disturbs one call of a command: `interpose.c` as a library, and a child process for each point.

The process that does this starts under the library (`under_the_library`) and imports a command's
modules once; each point then costs a fork and the command itself.
"""

from __future__ import annotations

import importlib
import json
import mmap
import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

SOURCE: Final = Path(__file__).with_name("interpose.c")
KINDS: Final = ("none", "crash before", "crash after", "torn write", "ENOSPC", "EIO", "EINTR")
OPERATIONS: Final = {
    "w": "write", "o": "open", "m": "mkdir", "r": "rename", "s": "fsync", "t": "truncate",
    "a": "allocate", "u": "unlink",
}  # fmt: skip
_WAITING: Final = "wsoat"
"""Operations that a signal interrupts; the others never give EINTR."""
_NOT_FORKED: Final = ("bpy", "_bpy", "cycles", "rerun", "__mp")
"""Modules that do not survive a fork."""
_PATH, _CALLS = 4096, 65536
_LAYOUT: Final = struct.Struct(f"@{_PATH}sqqqii{_PATH}s{_CALLS}s")
_HANG_S: Final = 120.0


class Point(NamedTuple):
    """One fault: the number of a call, from 0, and what happens to it."""

    call: int
    kind: str


@dataclass(frozen=True)
class Ending:
    """How a command ended.

    Attributes:
        code: Exit code; -9 of a crash; None if it hung.
        output: What it printed, both streams.
        fired: Whether it came to the disturbed call.
        where: Operation and path of that call.
        operations: One letter for each call.
        written: Bytes that passed the library.
    """

    code: int | None
    output: str
    fired: bool
    where: str
    operations: str
    written: int


def under_the_library(module: str) -> Path:
    """Start this program again with the library loaded, unless it is; return a folder for it."""
    if "PLIANT_FAULT_PLAN" in os.environ:
        return Path(os.environ["PLIANT_FAULT_PLAN"]).parent
    compiler = shutil.which("cc")
    if compiler is None:
        sys.exit("a C compiler is missing: no `cc`")
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None  # where fsync costs nothing
    folder = Path(tempfile.mkdtemp(prefix="faults-", dir=memory))
    library, plan = folder / "interpose.so", folder / "plan"
    command = [compiler, "-O1", "-Wall", "-shared", "-fPIC", "-o", str(library), str(SOURCE)]
    subprocess.run([*command, "-ldl"], check=True)
    plan.write_bytes(bytes(_LAYOUT.size))
    os.environ["PLIANT_FAULT_PLAN"] = str(plan)
    os.environ["LD_PRELOAD"] = str(library)
    os.execv(sys.executable, [sys.executable, "-m", module, *sys.argv[1:]])


@contextmanager
def _plan() -> Iterator[mmap.mmap]:
    with open(os.environ["PLIANT_FAULT_PLAN"], "r+b") as file, mmap.mmap(file.fileno(), 0) as plan:
        yield plan


def run_disturbed(
    action: Callable[[], int], root: Path, point: Point | None, output: Path
) -> Ending:
    """Run a command in a child process and disturb one of its calls.

    Args:
        action: Returns an exit code.
        root: Calls that change something under this folder count.
        point: The call and the fault; None only counts.
        output: File that takes what is printed.
    """
    at, kind = (point.call, KINDS.index(point.kind)) if point else (-1, 0)
    with _plan() as plan:
        plan[:] = _LAYOUT.pack(os.fsencode(root.resolve()), 0, 0, at, kind, 0, b"", b"")
        sys.stdout.flush()
        child = os.fork()
        if child == 0:
            _be_the_child(action, output)
        code = _waited(child)
        _, calls, written, _, _, fired, where, letters = _LAYOUT.unpack(plan[:])
        plan[:1] = b"\0"
    operations = letters[:calls].decode()
    text = where.split(b"\0")[0].decode(errors="replace")
    name = OPERATIONS[operations[at]] if fired and 0 <= at < len(operations) else ""
    return Ending(
        code, output.read_text(errors="replace"), bool(fired), f"{name} {text}".strip(),
        operations, written,
    )  # fmt: skip


def _be_the_child(action: Callable[[], int], output: Path) -> None:
    code = 70
    try:
        os.setsid()  # a crash takes the processes that this one starts along
        descriptor = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(descriptor, 1)
        os.dup2(descriptor, 2)
        code = action()
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(BaseException):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _waited(child: int) -> int | None:
    """Return the exit code of a child, and end what it left running."""
    end = time.monotonic() + _HANG_S
    pause = 0.001
    while True:
        found, status = os.waitpid(child, os.WNOHANG)
        if found or time.monotonic() > end:
            break
        time.sleep(pause)
        pause = min(pause * 1.5, 0.05)
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    if found:
        return os.waitstatus_to_exitcode(status)
    os.waitpid(child, 0)
    return None


def import_what(action: Callable[[], int], root: Path, output: Path) -> None:
    """Import here what a command imports, so that its later runs need not."""
    names = output.with_suffix(".modules")

    def listing() -> int:
        code = action()
        names.write_text(json.dumps(list(sys.modules)))
        return code

    run_disturbed(listing, root, None, output)
    for name in json.loads(names.read_text()) if names.exists() else ():
        if name not in sys.modules and not name.startswith(_NOT_FORKED):
            with suppress(Exception):
                importlib.import_module(name)


def points_of(operations: str) -> list[Point]:
    """Return every fault of a command whose undisturbed run made these calls.

    A crash before a call leaves what a crash after the call before it leaves.
    """
    points = []
    for call, operation in enumerate(operations):
        for kind in KINDS[1:]:
            if kind == "crash before" and call:
                continue
            if kind == "torn write" and operation != "w":
                continue
            if kind == "ENOSPC" and operation == "u":
                continue
            if kind == "EINTR" and operation not in _WAITING:
                continue
            points.append(Point(call, kind))
    return points
