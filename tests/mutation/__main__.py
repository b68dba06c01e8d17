"""Mutation testing: `make mutants SAMPLE=100`.

    python -m tests.mutation [--sample 100] [--seed 0] [--unseen SEED:SIZE] [TARGET…]

One process; each mutant runs in a fork (see `runner.py`). OUT/TARGET.jsonl keeps the results, and
mutants with a result there are not run again; `--survivors` runs only those that survived.
survivors.yaml lists the surviving mutants that no test can or should kill, with the reason.
Exit code 1: there are survivors without a reason.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType
from typing import Any

import pytest
import yaml
from scipy.stats import binomtest

from tests.mutation.mutants import Mutant, mutants_of
from tests.mutation.runner import KILLED, SURVIVED, TIMEOUT, UNCOVERED, Runner

ROOT = Path(__file__).resolve().parents[2]
REASONS = Path(__file__).with_name("survivors.yaml")


@dataclass(frozen=True)
class Target:
    """Source files and the tests that are to notice their mutants."""

    source: str
    tests: tuple[str, ...]
    expression: str = ""  # of pytest's -k
    uncompiled: tuple[str, ...] = ()  # modules that Numba leaves alone: functions can be replaced


TARGETS = {
    "ledger": Target("service/ledger.py", ("tests/service/test_attempts.py",), "not postgresql"),
    "statistics": Target(
        "evaluator/statistics",
        ("tests/evaluator/test_statistics_by_hand.py", "tests/evaluator/test_sign_flips.py"),
    ),
    "metrics": Target("evaluator/metrics", ("tests/evaluator",), "not browser"),
    "validation": Target("spec/validation", ("tests/spec/validation",)),
    "truth": Target(
        "generator/truth",
        ("tests/generator/truth",),
        uncompiled=("pliant.generator.truth", "pliant.generator.rendering.raster_style"),
    ),
}


def main() -> int:
    """Run the targets named, or all, each in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sample", type=int, help="mutants per target (default: all)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (default: 0)")
    parser.add_argument(
        "--unseen", type=_sample, action="append", default=[], metavar="SEED:SIZE",
        help="leave out the mutants of an earlier sample; may be repeated",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "mutation")
    parser.add_argument("--survivors", action="store_true", help="run only survivors, again")
    parser.add_argument("--cpu-seconds", type=float, default=20, help="tests per mutant")
    parser.add_argument("-k", default="", help="only these tests, as pytest's -k: a lower bound")
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=", ".join(TARGETS))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    open_questions = 0
    names: list[str] = arguments.targets or list(TARGETS)
    for name in names:
        child = os.fork()
        if child == 0:
            run(name, arguments)
            os._exit(0)
        os.waitpid(child, 0)
        open_questions += summarise(name, arguments)
    return 1 if open_questions else 0


def _sample(text: str) -> tuple[int, int]:
    seed, size = text.split(":")
    return int(seed), int(size)


def chosen(name: str, arguments: argparse.Namespace) -> tuple[list[Mutant], int]:
    """Return a target's mutants in random order, as many as asked for, and how many there are.

    An edit of a function changes the places of its own mutants in that order, and no others.
    """
    source = ROOT / TARGETS[name].source
    files = sorted(source.rglob("*.py")) if source.is_dir() else [source]
    found = [mutant for file in files for mutant in mutants_of(file, ROOT)]

    def drawn(seed: int) -> list[Mutant]:
        return sorted(
            found, key=lambda each: hashlib.sha256(f"{seed} {each.name}".encode()).digest()
        )

    seen = {each.name for seed, size in arguments.unseen for each in drawn(seed)[:size]}
    unseen = [each for each in drawn(arguments.seed) if each.name not in seen]
    return unseen[: arguments.sample], len(found)


def read_results(path: Path) -> dict[str, str]:
    """Return key -> status; the last line of a mutant counts."""
    lines = path.read_text().splitlines() if path.exists() else []
    return {row["key"]: row["status"] for row in map(json.loads, lines)}


def run(name: str, arguments: argparse.Namespace) -> None:
    """Run a target's mutants without a result."""
    again = (SURVIVED, UNCOVERED) if arguments.survivors else (None,)
    results = arguments.out / f"{name}.jsonl"
    done = read_results(results)
    mutants = [each for each in chosen(name, arguments)[0] if done.get(each.key) in again]
    if not mutants:
        return
    target = TARGETS[name]
    if target.uncompiled:
        _leave_uncompiled(target.uncompiled)

    def report(mutant: Mutant, status: str, tests: int) -> None:
        with results.open("a") as out:
            out.write(json.dumps({"key": mutant.key, "status": status, "tests": tests}) + "\n")
        place = f"{mutant.file.relative_to(ROOT)}:{mutant.lines.start}"
        print(f"{status:9} {place} {mutant.before} -> {mutant.after}", flush=True)

    options = ["-q", "-s", "-p", "no:cacheprovider", "-o", "timeout=0", "-m", "not long"]
    options += ["-k", arguments.k or target.expression]
    options += ["-o", "tmp_path_retention_policy=none", f"--rootdir={ROOT}"]
    options += [f"--basetemp={arguments.out.resolve() / name}"]  # others clear pytest's own
    tests = [str(ROOT / each) for each in target.tests]
    pytest.main([*options, *tests], plugins=[Runner(mutants, report, arguments.cpu_seconds)])


def _leave_uncompiled(modules: tuple[str, ...]) -> None:
    module = importlib.import_module("pliant.generator.compiled")

    def unless_named(decorator: Callable[[FunctionType], Any]) -> Callable[[FunctionType], Any]:
        return lambda each: each if each.__module__.startswith(modules) else decorator(each)

    for name in ("compiled", "inlined"):
        setattr(module, name, unless_named(getattr(module, name)))


def summarise(name: str, arguments: argparse.Namespace) -> int:
    """Print a target's score; return how many survivors have no reason."""
    results = read_results(arguments.out / f"{name}.jsonl")
    mutants, population = chosen(name, arguments)
    mutants = [mutant for mutant in mutants if mutant.key in results]
    reasons = {
        (row["file"], row["function"], change): row["reason"]
        for row in yaml.safe_load(REASONS.read_text()) or []
        for change in row["changes"]
    }
    killed, argued, open_ = 0, 0, []
    for mutant in mutants:
        if results[mutant.key] in (KILLED, TIMEOUT):
            killed += 1
            continue
        file = str(mutant.file.relative_to(ROOT))
        change = f"{mutant.before} -> {mutant.after}"
        if (file, mutant.function, change) in reasons:
            argued += 1
        else:
            open_.append(f"{results[mutant.key]}: {file}:{mutant.lines.start} {change}")
    print("\n".join(open_))
    count = max(1, len(mutants))
    noticed = killed + argued
    low, high = binomtest(noticed, count).proportion_ci(method="wilson")
    print(
        f"{name}: {len(mutants)} of {population} mutants, {killed} killed, {argued} argued, "
        f"{len(open_)} open; killed {killed / count:.3f}, killed or argued "
        f"{noticed / count:.3f} (95 % {low:.3f} to {high:.3f})",
        flush=True,
    )
    return len(open_)


if __name__ == "__main__":
    sys.exit(main())
