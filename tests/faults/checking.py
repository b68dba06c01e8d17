"""One command under faults: what it does undisturbed, and what must hold at each point."""

from __future__ import annotations

import shutil
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

from tests.faults.commands import Command
from tests.faults.injection import Ending, Point, import_what, points_of, run_disturbed


class Trial:
    """A command and the points at which it was disturbed.

    Args:
        name: The command's name.
        command: The command.
        place: Folder with `inputs/`, for the runs.

    Attributes:
        operations: One letter for each call of the undisturbed run.
        tried: Kind of fault -> points at which it came to that.
        failures: What did not hold, with the point.
    """

    def __init__(self, name: str, command: Command, place: Path) -> None:
        self.name, self._command = name, command
        self._inputs, self._work = place / "inputs", place / "work"
        self._output = place / "output"
        self.tried: Counter[str] = Counter()
        self.failures: list[str] = []
        self._start = time.monotonic()
        self._prepare()
        self._before = command.state(self._work)
        import_what(self._action(), self._work, self._output)
        self._prepare()
        undisturbed = run_disturbed(self._action(), self._work, None, self._output)
        assert undisturbed.code == 0, undisturbed.output
        self._after = command.state(self._work)
        self._names = _names(self._work)
        self.operations = undisturbed.operations
        size = sum(p.stat().st_size for p in self._work.rglob("*") if p.is_file())
        self.unseen_bytes = max(0, size - undisturbed.written - self._begun_bytes)

    def try_point(self, point: Point) -> None:
        """Disturb the command at a point, then run it again."""
        self._prepare()
        ending = run_disturbed(self._action(), self._work, point, self._output)
        if not ending.fired:
            return
        self.tried[point.kind] += 1
        wrong = self._wrong_at_first(point, ending) or self._wrong_again()
        if wrong:
            self.failures.append(f"{point.call}:{point.kind} ({ending.where}): {wrong}")

    def figures(self) -> dict[str, Any]:
        """Return the counts as JSON."""
        return {
            "calls": len(self.operations),
            "points": len(points_of(self.operations)),
            "tried": sum(self.tried.values()),
            "passed": sum(self.tried.values()) - len(self.failures),
            "failed": len(self.failures),
            "kinds": dict(self.tried),
            "seconds": round(time.monotonic() - self._start),
            "bytes_unseen": self.unseen_bytes,
            "failures": self.failures,
        }

    def _prepare(self) -> None:
        shutil.rmtree(self._work, ignore_errors=True)
        self._work.mkdir()
        self._command.prepare(self._inputs, self._work)
        self._begun_bytes = sum(p.stat().st_size for p in self._work.rglob("*") if p.is_file())

    def _action(self, *, again: bool = False) -> Any:
        chosen = (self._command.again if again else None) or self._command.action
        return partial(chosen, self._inputs, self._work)

    def _wrong_at_first(self, point: Point, ending: Ending) -> str | None:
        """Return what is wrong after the disturbed run, None if nothing is."""
        crash = point.kind.startswith(("crash", "torn"))
        if ending.code is None:
            return "it hung"
        if crash:
            if ending.code != -9:
                return f"not crashed: {ending.output[-2000:]}"
        elif ending.code not in (0, 1, 2):
            return f"exit code {ending.code}: {ending.output[-2000:]}"
        elif "Traceback" in ending.output:
            return f"traceback: {ending.output[-2000:]}"
        elif ending.code and "Error: " not in ending.output:
            return f"no error message: {ending.output[-2000:]}"
        if self._command.continues and ending.code != 0:
            return None  # the run that follows shows whether anything was lost
        state = self._command.state(self._work)
        if crash or ending.where.startswith("unlink"):  # unfinished files may be left then
            state = _visible(state)
        if state == self._after:
            return None
        if crash:
            return self._torn(state)
        if ending.code == 0:
            return _differs(state, self._after, "after exit code 0")
        return _differs(state, self._before, "earlier state")

    def _torn(self, state: dict[str, Any]) -> str | None:
        """Return which output is neither that of before nor the new one, None if none is."""
        for name in sorted({path.split("/")[0] for path in {*state, *self._before}}):
            found, before, after = (
                {path: each for path, each in states.items() if path.split("/")[0] == name}
                for states in (state, self._before, self._after)
            )
            if found not in (before, after):
                return _differs(found, before, "after the crash")
        return None

    def _wrong_again(self) -> str | None:
        """Return what is wrong after the same command again, None if nothing is."""
        ending = run_disturbed(self._action(again=True), self._work, None, self._output)
        if ending.code is None:
            return "again: it hung"
        if ending.code != 0 and ("Traceback" in ending.output or "Error: " not in ending.output):
            return f"again: exit code {ending.code}: {ending.output[-2000:]}"
        wrong = _differs(self._command.state(self._work), self._after, "again")
        if wrong and ending.code:
            wrong += f"; {ending.output[-500:]}"
        if wrong is None and (left := _names(self._work) - self._names):
            wrong = f"again: left behind {sorted(left)[:4]}"
        return wrong


def _visible(state: dict[str, Any]) -> dict[str, Any]:
    """Return a state without hidden files, such as unfinished ones."""
    return {name: each for name, each in state.items() if not name.startswith(".")}


def _names(work: Path) -> set[str]:
    """Return the hidden files and folders in a folder: what is unfinished has such names."""
    return {p.relative_to(work).as_posix() for p in work.rglob(".*")}


def _differs(found: dict[str, Any], expected: dict[str, Any], when: str) -> str | None:
    """Return how a state differs from the expected one, None if it does not."""
    keys = sorted(k for k in {*found, *expected} if found.get(k) != expected.get(k))
    kinds = {(True, True): "other", (True, False): "more", (False, True): "missing"}
    text = ", ".join(f"{key} ({kinds[key in found, key in expected]})" for key in keys[:4])
    return f"{when}: {len(keys)} files differ: {text}" if keys else None
