"""Speed over releases: the present tree's ratios next to those of the last release.

    python benchmarks/over_releases.py [NAME...]                 # compare with the last release
    python benchmarks/over_releases.py [NAME...] --keep VERSION  # write releases/VERSION.json

Runs `benchmarks/NAME.py --quick` for each NAME (default: all in `KEPT`) and takes figures that
other machines and other programs change little: ratios of two CPU times of one run, and CPU times
in units of a yardstick that is measured right before and after. Names each figure that is more
than 10 % worse than in the last release, and then ends with exit code 1. Lower is better
everywhere: a figure that should be high is kept as its inverse.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

HERE: Final = Path(__file__).resolve().parent
RELEASES: Final = HERE / "releases"
LIMIT: Final = 1.10
"""A figure that grows by more than this factor is a regression."""

Kind = Literal["ratio", "inverse", "cpu", "rate"]
"""`ratio` is kept as it is and `inverse` as its inverse; a CPU time (`cpu`) is divided by the
yardstick, and one is divided by a `rate` per CPU second and the yardstick."""

KEPT: Final[Mapping[str, Mapping[str, Kind]]] = {
    "evaluation": {
        "ratio_to_reading": "ratio",
        "ratio_to_reading_standard": "ratio",
        "ratio_to_reading_surfaces_paper": "ratio",
        "ratio_to_reading_surfaces_standard": "ratio",
    },
    "generation": {"cpu_s_per_image_raster": "cpu", "cpu_s_per_image_cloth3_raster": "cpu"},
    "loading": {"ratio_to_decoding": "inverse", "pairs_per_s": "rate"},
    "simulation": {"rope_frames_per_s": "rate", "cloth_cpu_s_tier_3": "cpu"},
    "streaming": {"ratio_to_written_cpu": "inverse", "cpu_s_per_frame_stream": "cpu"},
    "truth": {"raster_ms_rope": "cpu"},
    "validation": {"ratio_to_decoding": "ratio", "quick_cpu_s": "cpu"},
    "don": {"overhead_ratio": "ratio"},
    "timecycle": {"overhead_ratio": "ratio"},
    "service": {"scoring_cpu_ratio": "inverse"},
}
"""Benchmark -> the figures of its record that are kept."""


def yardstick_s() -> float:
    """Return the CPU seconds of a fixed piece of work, the least of several tries."""
    rng = np.random.default_rng(0)
    values, matrix = rng.random(400_000), rng.random((300, 300))
    tries = []
    for _ in range(7):
        start = time.process_time()
        np.sort(values)
        np.exp(values).cumsum()
        matrix @ matrix
        sum(range(200_000))
        tries.append(time.process_time() - start)
    return min(tries)


def kept(record: Mapping[str, Any], kinds: Mapping[str, Kind], unit_s: float) -> dict[str, float]:
    """Return the figures of a record that are kept, so that lower is better.

    Args:
        record: What a benchmark wrote with `--json`.
        kinds: Its entry in `KEPT`.
        unit_s: The yardstick, CPU seconds.
    """
    found = {}
    for name, kind in kinds.items():
        value = float(record[name]) ** (-1 if kind in ("inverse", "rate") else 1)
        found[name] = round(value / unit_s if kind in ("cpu", "rate") else value, 4)
    return found


def measured(name: str) -> dict[str, float]:
    """Run one benchmark and return its figures that are kept."""
    with tempfile.TemporaryDirectory(prefix="pliant-bench-") as folder:
        out = Path(folder) / "record.json"
        before = yardstick_s()
        command = [sys.executable, str(HERE / f"{name}.py"), "--quick", "--json", str(out)]
        subprocess.run(command, check=True, stdout=sys.stderr)
        unit_s = (before + yardstick_s()) / 2
        return kept(json.loads(out.read_text()), KEPT[name], unit_s)


def last_release(folder: Path) -> Path | None:
    """Return the file of the highest version, or None."""

    def version(path: Path) -> list[int]:
        return [int(number) for number in re.findall(r"\d+", path.stem)]

    return max(folder.glob("*.json"), key=version, default=None)


def regressions(
    now: Mapping[str, Mapping[str, float]], then: Mapping[str, Mapping[str, float]]
) -> list[str]:
    """Return `BENCHMARK FIGURE` of each figure that is worse by more than `LIMIT`.

    Args:
        now: Benchmark -> figure -> value, lower is better.
        then: The same of the last release; figures that one of them lacks are not compared.
    """
    return [
        f"{name} {figure}"
        for name, figures in now.items()
        for figure, value in figures.items()
        if value > LIMIT * then.get(name, {}).get(figure, np.inf)
    ]


def run(names: Sequence[str], keep: str | None) -> int:
    """Measure, then keep or compare; return the exit code."""
    last = last_release(RELEASES)
    then = json.loads(last.read_text()) if last is not None else {}
    now = {name: measured(name) for name in names}
    if keep is not None:
        RELEASES.mkdir(exist_ok=True)
        same = then if last is not None and last.stem == keep else {}
        text = json.dumps({**same, **now}, indent=1, sort_keys=True)
        (RELEASES / f"{keep}.json").write_text(text + "\n")
        return 0
    worse = regressions(now, then)
    print(f"Compared with {'nothing: no release is kept' if last is None else last.stem}:")
    for name, figures in now.items():
        for figure, value in figures.items():
            before = then.get(name, {}).get(figure)
            change = "new" if before is None else f"{100 * (value / before - 1):+.0f} %"
            mark = "  REGRESSION" if f"{name} {figure}" in worse else ""
            print(f"{name:12} {figure:40} {value:10.4g} {change:>7}{mark}")
    return 1 if worse else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(KEPT))
    parser.add_argument("--keep", metavar="VERSION", help="write the figures of a release")
    arguments = parser.parse_args()
    if unknown := sorted(set(arguments.names) - set(KEPT)):
        parser.error(f"no such benchmark: {', '.join(unknown)}; choose from {', '.join(KEPT)}")
    sys.exit(run(arguments.names or list(KEPT), arguments.keep))
