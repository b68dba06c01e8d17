"""What every benchmark shares: its flags, and a flat record naming machine and commit."""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path

from pliant.benchmarks.suite.work import processor_name
from pliant.spec.cores import cpu_cores

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


def main(name: str, measure: Callable[[bool], Mapping[str, Value]], doc: str | None) -> None:
    """Parse the flags of `benchmarks/NAME.py`, measure, print and optionally write the record.

    Args:
        name: The benchmark's name.
        measure: Takes `quick` and returns flat figures.
        doc: The module's docstring, shown by `--help`.
    """
    parser = argparse.ArgumentParser(description=doc)
    parser.add_argument("--quick", action="store_true", help="end within 2 minutes on 2 cores")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the record there")
    arguments = parser.parse_args()
    record = {"benchmark": name, "quick": arguments.quick, **machine(), **measure(arguments.quick)}
    for key, value in record.items():
        print(f"{key:32} {value:.6g}" if isinstance(value, float) else f"{key:32} {value}")
    if arguments.json:
        arguments.json.write_text(json.dumps(record, indent=1) + "\n")
