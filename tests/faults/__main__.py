"""Disturbs every call by which a command changes files, one at a time, and checks what is left.

    python -m tests.faults [COMMAND…] [--sample N] [--seed S] [--point CALL:KIND]
        [--json F]

A crash, a torn write, a full disk, EIO or EINTR; then the same command runs again. The first run
must end with the undisturbed result or one error and the earlier state; the second one with the
undisturbed result. Exit code 1: some point failed. `--point` replays one of them.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import sys
from pathlib import Path
from typing import Any

from tests.faults.checking import Trial
from tests.faults.commands import COMMANDS
from tests.faults.injection import Point, points_of, under_the_library
from tests.faults.inputs import make_inputs


def main() -> int:
    """Disturb the commands named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sample", type=int, help="so many points of each command; default: all")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--point", help="CALL:KIND, such as '12:torn write'")
    parser.add_argument("--json", type=Path, help="file for the figures")
    parser.add_argument("commands", nargs="*", metavar="COMMAND")
    arguments = parser.parse_args()
    place = under_the_library("tests.faults")
    try:
        (place / "inputs").mkdir()
        names = arguments.commands or list(COMMANDS)
        if any(COMMANDS[name].inputs for name in names):
            make_inputs(place / "inputs")
        found = {}
        for name in names:
            trial = Trial(name, COMMANDS[name], place)
            for point in chosen(trial, arguments):
                trial.try_point(point)
            found[name] = trial.figures()
            print(f"{name}: " + summary(found[name]), flush=True)
    finally:
        shutil.rmtree(place, ignore_errors=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=1) + "\n")
    return 1 if any(each["failed"] for each in found.values()) else 0


def chosen(trial: Trial, arguments: argparse.Namespace) -> list[Point]:
    """Return the points to try."""
    if arguments.point:
        call, _, kind = arguments.point.partition(":")
        return [Point(int(call), kind)]
    points = points_of(trial.operations)
    if arguments.sample is None or arguments.sample >= len(points):
        return points
    return sorted(random.Random(arguments.seed).sample(points, arguments.sample))


def summary(figures: dict[str, Any]) -> str:
    """Return the figures of a command for people."""
    lines = [
        f"{figures['calls']} calls, {figures['points']} points, {figures['tried']} tried, "
        f"{figures['passed']} passed, {figures['failed']} failed, {figures['seconds']} s"
    ]
    return "\n  ".join([*lines, *figures["failures"][:20]])


if __name__ == "__main__":
    sys.exit(main())
