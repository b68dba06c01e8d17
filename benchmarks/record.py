"""What every benchmark shares: its flags, and a flat record naming machine and commit."""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pliant.benchmarks.suite.work import processor_name
from pliant.spec.cores import cpu_cores
from pliant.spec.errors import PliantError

Value = float | int | str | bool | None


def machine() -> dict[str, Value]:
    """Return what the figures were measured on."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=False,
    ).stdout.strip()
    return {
        "machine": f"{processor_name()}, {cpu_cores()} cores",
        "python": platform.python_version(),
        "commit": commit or "unknown",
        "measured": datetime.now(UTC).strftime("%Y-%m-%d"),
    }


def cpu_s(work: Callable[[], object]) -> float:
    """Return the CPU seconds of a call, those of all threads of this process."""
    started = time.process_time()
    work()
    return time.process_time() - started


def main(
    name: str,
    measure: Callable[..., Mapping[str, Value]],
    doc: str | None,
    arguments: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Parse the flags of `benchmarks/NAME.py`, measure, print and optionally write the record.

    Args:
        name: The benchmark's name.
        measure: Takes `quick`, and further arguments by name, and returns flat figures.
        doc: The module's docstring, shown by `--help`.
        arguments: Further arguments of the program, as `add_argument` takes them.
    """
    parser = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for flag, options in (arguments or {}).items():
        parser.add_argument(flag, **options)
    parser.add_argument("--quick", action="store_true", help="end within 2 minutes on 2 cores")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the record there")
    given = vars(parser.parse_args())
    out = given.pop("json")
    try:
        figures = measure(**given)
    except PliantError as error:
        parser.exit(error.exit_code, f"Error: {error}\n")
    record = {"benchmark": name, "quick": given["quick"], **machine(), **figures}
    for key, value in record.items():
        print(f"{key:40} {value:.6g}" if isinstance(value, float) else f"{key:40} {value}")
    if out:
        out.write_text(json.dumps(record, indent=1) + "\n")
