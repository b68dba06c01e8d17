"""Run a function that reads files from strangers in a child process with limits.

    table = run_limited(partial(read_submission, path), limits=Limits(wall_s=60), path=path)

The child is a new interpreter. It works from any thread, from a script without a
`__main__` guard and inside a worker process. It has no standard input or output, a
temporary folder of its own that is removed afterwards, and its process group is killed at
the end, so that nothing that it started stays. What the function raises is raised here.

The limits contain accidents and hostile data: memory, time, crashes of libraries. They are
not a sandbox against hostile code: the child runs as the same user.
"""

from __future__ import annotations

import ctypes
import errno
import importlib
import os
import pickle  # between this process and its own child
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal, TypeVar

from rich.filesize import decimal

from pliant.spec.errors import PliantError

resource: Any
try:
    resource = importlib.import_module("resource")
except ImportError:  # Windows: the child is limited in time alone
    resource = None

T = TypeVar("T")
Reason = Literal["memory", "time", "size", "crash"]
_Outcome = Literal["value", "raised", "memory", "size", "ended", "died"]

_CHILD = "import sys; sys.path[:] = {path!r}; from pliant.spec.limits import _child; _child()"
# Libraries that reserve address space for each core would exceed the limit on a large machine.
_ENVIRONMENT = {"MALLOC_ARENA_MAX": "2", "ARROW_DEFAULT_MEMORY_POOL": "system"}
_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000


@dataclass(frozen=True)
class Limits:
    """What a function may use.

    Attributes:
        memory_bytes: Memory beyond what the interpreter and its imports take. Linux alone:
            the limit is on address space, which macOS does not enforce.
        cpu_s: CPU time of all threads; not on Windows.
        wall_s: Time on the clock, start of the interpreter included.
        file_bytes: Size of each file that it writes; not on Windows.
        network: False removes the network where the kernel gives a user a namespace (Linux).
    """

    memory_bytes: int = 4 * 2**30
    cpu_s: int = 600
    wall_s: float = 600.0
    file_bytes: int = 4 * 2**30
    network: bool = True


class LimitError(PliantError):
    """A function ended at one of its limits, or crashed.

    Attributes:
        reason: `memory`, `time`, `size` (of a file that it wrote) or `crash`.
    """

    def __init__(self, reason: Reason, message: str, **kwargs: Any) -> None:
        self.reason = reason
        super().__init__(message, **kwargs)


def run_limited(
    function: Callable[[], T], *, limits: Limits = Limits(), path: Path | str | None = None
) -> T:
    """Return what a function returns, computed in a child process with limits.

    Args:
        function: A function of an importable module without arguments, or a
            `functools.partial` of one; its arguments and its result can be pickled. Arrays and
            Arrow tables cross without a second copy in the child.
        limits: What it may use.
        path: The file that it reads, for the messages.

    Raises:
        LimitError: It needs more than a limit, or it crashed.
        Exception: Whatever the function raises.
    """
    request = pickle.dumps(limits) + pickle.dumps(function)
    with tempfile.TemporaryDirectory(prefix="pliant-", ignore_cleanup_errors=True) as folder:
        child = subprocess.Popen(
            [sys.executable, "-c", _CHILD.format(path=sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            env={**os.environ, **_ENVIRONMENT, "TMPDIR": folder, "TEMP": folder},
        )
        answers: list[tuple[_Outcome, Any]] = []
        reader = threading.Thread(target=_receive, args=(child.stdout, answers), daemon=True)
        try:
            reader.start()
            assert child.stdin is not None
            with suppress(BrokenPipeError):
                child.stdin.write(request)
                child.stdin.flush()  # it stays open: the child ends when this process does
            child.wait(limits.wall_s)
        except subprocess.TimeoutExpired:
            raise _limit_error("time", limits, path) from None
        finally:
            _kill(child)
            reader.join(5)  # a process that left the group could keep the pipe open
    return _result(answers, child.returncode, limits, path)


def _result(
    answers: list[tuple[_Outcome, Any]], status: int, limits: Limits, path: Path | str | None
) -> Any:
    kind: _Outcome
    value: Any
    kind, value = answers[0] if answers else ("died", None)
    if kind == "value":
        return value
    if kind == "raised":
        raise value
    if kind == "memory" or kind == "size":
        raise _limit_error(kind, limits, path)
    if -status == getattr(signal, "SIGXCPU", None):
        raise _limit_error("time", limits, path)
    died = signal.Signals(-status).name if status < 0 else f"exit status {status}"
    raise LimitError(
        "crash",
        "reading the file crashed",
        path=path,
        found=value or died,
        fix="The file is damaged, or needs more memory than is allowed.",
    )


def _limit_error(reason: Reason, limits: Limits, path: Path | str | None) -> LimitError:
    message, allowed = {
        "memory": ("reading the file needs too much memory", decimal(limits.memory_bytes)),
        "time": (
            "reading the file takes too long",
            f"{limits.wall_s:g} s, and {limits.cpu_s} s of CPU time",
        ),
        "size": ("reading the file writes too much", f"{decimal(limits.file_bytes)} per file"),
    }[reason]
    return LimitError(reason, message, path=path, required=f"at most {allowed}")


def _kill(child: subprocess.Popen[bytes]) -> None:
    """End a child and the processes that it started."""
    with suppress(OSError):
        os.killpg(child.pid, signal.SIGKILL) if hasattr(os, "killpg") else child.kill()
    child.wait()
    with suppress(OSError):
        child.stdin.close()  # type: ignore[union-attr]


def _receive(stream: IO[bytes], answers: list[tuple[_Outcome, Any]]) -> None:
    """Read one message: its pickle, and the buffers of its arrays."""
    with stream, suppress(EOFError, pickle.UnpicklingError):
        sizes, body = pickle.load(stream)
        buffers = [bytearray(size) for size in sizes]
        for buffer in buffers:
            if stream.readinto(buffer) != len(buffer):  # type: ignore[attr-defined]
                return
        answers.append(pickle.loads(body, buffers=buffers))


def _child() -> None:
    """Run one request of the parent."""
    requests = sys.stdin.buffer
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no part of the answer
    try:
        limits = pickle.load(requests)
        _leave_network(limits)  # while this process has one thread
        function = pickle.load(requests)
        threading.Thread(target=_end_with_parent, args=(requests,), daemon=True).start()
        _apply(limits)
        _send(output, ("value", function()))
    except BaseException as error:
        _send(output, _failure(error))
    os._exit(0)


def _end_with_parent(requests: IO[bytes]) -> None:
    requests.read()
    os._exit(1)


def _leave_network(limits: Limits) -> None:
    """Enter a network namespace without interfaces, where the kernel allows it."""
    if not limits.network and sys.platform == "linux":
        libc = ctypes.CDLL(None)
        if libc.unshare(_CLONE_NEWNET):  # needs a privilege, or a user namespace around it
            libc.unshare(_CLONE_NEWUSER | _CLONE_NEWNET)


def _apply(limits: Limits) -> None:
    """Limit this process."""
    if resource is None:
        return
    bounds = {
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_FSIZE: limits.file_bytes,
        resource.RLIMIT_CPU: limits.cpu_s,
    }
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        bounds[resource.RLIMIT_AS] = pages * resource.getpagesize() + limits.memory_bytes
    for kind, bound in bounds.items():
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (bound if hard < 0 else min(bound, hard), hard))


def _failure(error: BaseException) -> tuple[_Outcome, Any]:
    """Return an exception as a message that the parent can read."""
    cause: BaseException | None = error
    while cause is not None:
        number = cause.errno if isinstance(cause, OSError) else None
        if isinstance(cause, MemoryError) or number == errno.ENOMEM:
            return "memory", None
        if number == errno.EFBIG:
            return "size", None
        cause = cause.__cause__
    if not isinstance(error, Exception):
        return "ended", repr(error)
    if not isinstance(error, PliantError):
        error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    return "raised", error


def _send(output: IO[bytes], message: tuple[_Outcome, Any]) -> None:
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(message, protocol=5, buffer_callback=buffers.append)
    raw = [buffer.raw() for buffer in buffers]
    pickle.dump(([len(part) for part in raw], body), output)
    for part in raw:
        output.write(part)
    output.flush()
