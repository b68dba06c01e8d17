"""Run tests against mutants, each in a fork of one process in which the tests are collected.

The process runs every test once and notes which lines it executes and its CPU time. A mutant's
function is replaced in the fork, which runs the tests that execute the changed line until one
fails: first those that noticed another mutant of the file, then those that take little time.
Fixtures of the session are made once, by the original.
"""

from __future__ import annotations

import functools
import gc
import os
import resource
import signal
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, cast

import pytest
from _pytest.runner import runtestprotocol
from coverage import Coverage

from tests.mutation.mutants import Mutant

KILLED, SURVIVED, UNCOVERED, TIMEOUT = "killed", "survived", "uncovered", "timeout"
Functions = dict[tuple[Path, str, int], list[FunctionType]]
MOST_TESTS = 250  # per mutant: the failed one is the exit code of the fork
WALL_S = 900
"""A fork that takes longer hangs, at a lock that its parent had, or the machine is overloaded: that
says nothing about the mutant, which counts as surviving."""


class Runner:
    """A plug-in of pytest that runs mutants in place of the session's tests.

    Attributes:
        mutants: What to run.
        report: Takes a mutant, its status and the tests that were run.
        cpu_s: CPU time of the tests of one mutant, about; the quickest are taken.
    """

    def __init__(
        self, mutants: Sequence[Mutant], report: Callable[[Mutant, str, int], None], cpu_s: float
    ) -> None:
        self.mutants, self.report, self.cpu_s = mutants, report, cpu_s
        self._files = {mutant.file for mutant in mutants}
        self._lines: dict[tuple[Path, int], set[str]] | None = None  # ids of tests and modules
        self._costs: dict[pytest.Item, float] = {}
        self._coverage = Coverage(
            data_file=None, config_file=False, include=sorted(map(str, self._files)), messages=False
        )
        self._test = ""
        self._sound: set[pytest.Item] = set()
        self._killers: dict[Path, set[pytest.Item]] = defaultdict(set)

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self) -> None:
        """Let Hypothesis draw the same examples in every fork."""
        from hypothesis import settings

        settings.register_profile("mutation", deadline=None, derandomize=True, database=None)
        settings.load_profile("mutation")

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run the tests once, then the mutants."""
        items = self._trace(session.items)
        session._setupstate.teardown_exact(cast(pytest.Item, session))  # all but its own fixtures
        print(f"{len(items)} of {len(session.items)} tests pass", flush=True)
        functions = self._functions()
        for mutant in self.mutants:
            chosen = self._tests_of(mutant, items)
            status, failed = self._outcome(mutant, functions, chosen)
            while failed is not None and not self._passes_unchanged(failed):
                items.remove(failed)
                chosen = self._tests_of(mutant, items)
                status, failed = self._outcome(mutant, functions, chosen)
            if failed is not None:
                self._killers[mutant.file].add(failed)
            self.report(mutant, status, len(chosen))
        return True

    def _outcome(
        self, mutant: Mutant, functions: Functions, chosen: Sequence[pytest.Item]
    ) -> tuple[str, pytest.Item | None]:
        """Return a mutant's status, and the test that failed."""
        if not chosen:
            return UNCOVERED, None
        failed = self._fork(
            lambda: _run_mutant(mutant, functions, chosen),
            10 + 5 * sum(self._costs[item] for item in chosen),
        )
        if failed is None:
            return TIMEOUT, None
        return (SURVIVED, None) if failed < 0 else (KILLED, chosen[failed])

    def _passes_unchanged(self, item: pytest.Item) -> bool:
        """Return whether a test passes in a fork without a mutant, else it is left out."""
        if item not in self._sound:
            if self._fork(lambda: _run([item]), 10 + 5 * self._costs[item]) != -1:
                print(f"left out, fails in a fork: {item.nodeid}", flush=True)
                return False
            self._sound.add(item)
        return True

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef[Any], request: pytest.FixtureRequest
    ) -> Generator[None, Any, Any]:
        """Let the lines that a module's fixture executes count for all tests of its module."""
        if fixturedef.scope != "module" or self._lines is not None:
            return (yield)
        self._coverage.switch_context(request.node.nodeid)
        try:
            return (yield)
        finally:
            self._coverage.switch_context(self._test)

    def _trace(self, items: Sequence[pytest.Item]) -> list[pytest.Item]:
        """Run the tests and note the lines that each executes; return those that pass."""
        passed = []
        self._coverage.start()
        for index, item in enumerate(items):
            following = items[index + 1] if index + 1 < len(items) else item
            before = _cpu_s()
            self._test = item.nodeid
            self._coverage.switch_context(item.nodeid)
            reports = runtestprotocol(item, log=False, nextitem=following)
            self._costs[item] = _cpu_s() - before
            if all(report.passed for report in reports):
                passed.append(item)
            for report in reports:
                if report.failed:
                    print(f"fails: {item.nodeid}\n{report.longreprtext[-500:]}", flush=True)
        self._coverage.stop()
        self._lines = {
            (file, line): set(contexts)
            for file in self._files
            for line, contexts in self._coverage.get_data().contexts_by_lineno(str(file)).items()
        }
        return passed

    def _tests_of(self, mutant: Mutant, items: Iterable[pytest.Item]) -> list[pytest.Item]:
        assert self._lines is not None
        covering: set[str] = set()
        for line in mutant.lines:
            covering |= self._lines.get((mutant.file, line), set())
        chosen: list[pytest.Item] = []
        spent = 0.0
        killers = self._killers[mutant.file]
        for item in sorted(
            (item for item in items if covering & {item.nodeid, _module(item)}),
            key=lambda item: (item not in killers, self._costs[item]),
        ):
            spent += self._costs[item]
            if chosen and (spent > self.cpu_s or len(chosen) == MOST_TESTS):
                break
            chosen.append(item)
        return chosen

    def _functions(self) -> Functions:
        found: Functions = defaultdict(list)
        for each in gc.get_objects():
            if type(each) is FunctionType:  # isinstance would ask weak proxies
                code: CodeType = each.__code__
                file = Path(os.path.realpath(code.co_filename))
                if file in self._files:
                    found[file, code.co_qualname, code.co_firstlineno].append(each)
        return found

    def _fork(self, run: Callable[[], int], cpu_s: float) -> int | None:
        """Return what `run` returns in a fork, -1 to 253; None if it takes too much CPU or dies.

        -1 after `WALL_S`.
        """
        child = os.fork()
        if child == 0:
            silence = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1, 2):
                os.dup2(silence, stream)
            os.setpgid(0, 0)
            limit = int(cpu_s) + 1
            resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
            signal.alarm(WALL_S)
            code = 255
            with suppress(BaseException):
                code = run() + 1
            os._exit(code)
        _, status = os.waitpid(child, 0)
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what a killed test has left
        if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGALRM:
            return -1
        if os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 255:
            return None
        return os.WEXITSTATUS(status) - 1


def _run_mutant(mutant: Mutant, functions: Functions, items: Sequence[pytest.Item]) -> int:
    for each in gc.get_objects():
        if type(each) is functools._lru_cache_wrapper:
            each.cache_clear()
    for function in functions[mutant.file, mutant.function, mutant.line]:
        function.__code__ = mutant.code
    return _run(items)


def _run(items: Sequence[pytest.Item]) -> int:
    """Run tests until one fails; return its index, or -1 if all pass."""
    for index, item in enumerate(items):
        following = items[index + 1] if index + 1 < len(items) else item
        reports = runtestprotocol(item, log=False, nextitem=following)
        if any(report.failed for report in reports):
            return index
    return -1


def _module(item: pytest.Item) -> str:
    module = item.getparent(pytest.Module)
    return module.nodeid if module else ""


def _cpu_s() -> float:
    own, children = (
        resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime
