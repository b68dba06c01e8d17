"""Coverage-guided fuzzing of every reader, by atheris (libFuzzer): `make fuzz SECONDS=60`.

    python -m tests.fuzz [--seconds 60] [READER…]

Every reader runs in a process of its own, at most 5 s an input and 2 GiB, and goes on from the
inputs that earlier runs kept below build/fuzz. What it finds is written to
tests/fuzz/findings/READER-…, which `test_findings.py` replays. At the end a table shows what all
runs did together (build/fuzz/figures.json). Exit code 1: something was found.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

FINDINGS = Path(__file__).parent / "findings"
BUILD = Path(__file__).parents[2] / "build" / "fuzz"
SECONDS_PER_INPUT, MEMORY_MB = 5, 2048


def main() -> int:
    """Fuzz the readers named, or all, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60, help="in all")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    parser.add_argument("readers", nargs="*")
    arguments = parser.parse_args()
    if arguments.child:
        fuzz(arguments.child, arguments.seconds)
        return 0
    from tests.fuzz.readers import READERS

    names = arguments.readers or list(READERS)
    each = max(1, arguments.seconds // len(names))
    failed = []
    for name in names:
        print(f"{name}: {each} s", flush=True)
        child = [sys.executable, "-m", "tests.fuzz", "--child", name, "--seconds", str(each)]
        done = subprocess.run(child, capture_output=True, text=True, errors="replace")
        record(name, done.stderr)
        if done.returncode:
            failed.append(name)
            print(done.stdout[-2000:] + done.stderr[-4000:], flush=True)
    print(table(json.loads((BUILD / "figures.json").read_text())))
    print(f"findings in: {', '.join(failed) or 'none'}")
    return 1 if failed else 0


def record(name: str, log: str) -> None:
    """Add what a child did to build/fuzz/figures.json."""
    path = BUILD / "figures.json"
    figures = json.loads(path.read_text()) if path.is_file() else {}
    done = re.search(r"^Done (\d+) runs in (\d+) second", log, re.MULTILINE)
    peak = re.search(r"^stat::peak_rss_mb: +(\d+)", log, re.MULTILINE)
    entry = figures.setdefault(name, {"executions": 0, "seconds": 0, "peak_mb": 0})
    if done and peak:
        entry["executions"] += int(done[1])
        entry["seconds"] += int(done[2])
        entry["peak_mb"] = max(entry["peak_mb"], int(peak[1]))
    path.write_text(json.dumps(figures, indent=1) + "\n")


def table(figures: Mapping[str, Mapping[str, int]]) -> str:
    """Return the figures as a Markdown table."""
    lines = ["| reader | executions | seconds | peak memory, MB |", "|---|---:|---:|---:|"]
    for name, each in figures.items():
        lines.append(
            f"| `{name}` | {each['executions']:,} | {each['seconds']} | {each['peak_mb']} |"
        )
    total, seconds = (
        sum(each[key] for each in figures.values()) for key in ("executions", "seconds")
    )
    return "\n".join([*lines, f"| all | {total:,} | {seconds} | |"])


def fuzz(name: str, seconds: int) -> None:
    """Fuzz one reader in this process; libFuzzer ends it."""
    import atheris

    with atheris.instrument_imports(include=["pliant"]):
        from pliant.spec.errors import PliantError
        from tests.fuzz.readers import MAX_BYTES, READERS
    reader = READERS[name]
    corpus = BUILD / name
    corpus.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(reader.seeds()):
        (corpus / f"seed-{number}").write_bytes(seed[:MAX_BYTES])
    FINDINGS.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as at:
        path = Path(at) / f"input{reader.suffix}"

        def one(data: bytes) -> None:
            path.write_bytes(data)
            try:
                with suppress(PliantError):
                    reader.read(path)
            except BaseException:  # libFuzzer itself keeps hangs and floods of memory
                finding = FINDINGS / f"{name}-{hashlib.sha1(data).hexdigest()[:12]}"
                finding.write_bytes(data)
                raise

        options = [
            f"-max_total_time={seconds}",
            f"-timeout={SECONDS_PER_INPUT}",
            f"-rss_limit_mb={MEMORY_MB}",
            f"-max_len={MAX_BYTES}",
            f"-artifact_prefix={FINDINGS}/{name}-",
            "-print_final_stats=1",
        ]
        atheris.Setup([sys.argv[0], *options, str(corpus)], one)
        atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())
