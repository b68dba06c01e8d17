"""Coverage-guided fuzzing of every reader, by atheris (libFuzzer): `make fuzz SECONDS=60`.

    python -m tests.fuzz [--seconds 60] [READER…]

Every reader runs in a process of its own: at most 5 CPU seconds an input, 2 GiB in all, and for an
input 100 MB more than twice the size of the arrays that it returns. It goes on from the
inputs that earlier runs kept below build/fuzz. What it finds is written to
tests/fuzz/findings/READER-…, which `test_findings.py` replays. libFuzzer's counts are printed
after each reader. Exit code 1: something was found.
"""

from __future__ import annotations

import argparse
import hashlib
import logging
import os
import re
import resource
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import is_dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from tests.fuzz.reader import Reader

FINDINGS = Path(__file__).parent / "findings"
BUILD = Path(__file__).parents[2] / "build" / "fuzz"
SECONDS_PER_INPUT, MEMORY_MB, MEMORY_PER_INPUT_MB = 5, 2048, 100
SCRATCH = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""Temporary folders are in memory, if there is such a place."""
HANG_SECONDS = 120
"""An input is ended after so much time: on a loaded machine far more than CPU seconds."""


def main() -> int:
    """Fuzz the readers named, or all, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60, help="in all")
    parser.add_argument("readers", nargs="*")
    arguments = parser.parse_args()
    import atheris

    BUILD.mkdir(parents=True, exist_ok=True)
    log = BUILD / "log.txt"
    with log.open("wb") as stream, redirected(stream), atheris.instrument_imports(["pliant"]):
        from tests.fuzz.readers import READERS
    names = arguments.readers or list(READERS)
    each = max(1, arguments.seconds // len(names))
    failed = []
    for name in names:
        print(f"{name}: {each} s", flush=True)
        with tempfile.TemporaryDirectory(dir=SCRATCH) as place:  # libFuzzer tidies nothing up
            child = os.fork()  # the imports are made and instrumented once
            if child == 0:
                tempfile.tempdir = place
                with log.open("wb") as stream, redirected(stream):
                    fuzz(name, READERS[name], each)
            status = os.waitpid(child, 0)[1]
        text = log.read_text(errors="replace")
        print("\n".join(re.findall(r"^stat::.*", text, re.MULTILINE)), flush=True)
        if status:
            failed.append(name)
            print(text[-4000:], flush=True)
    print(f"findings in: {', '.join(failed) or 'none'}")
    return 1 if failed else 0


@contextmanager
def redirected(stream: IO[bytes]) -> Iterator[None]:
    """Send what this process and its libraries print to a file."""
    kept = [os.dup(number) for number in (1, 2)]
    for number in (1, 2):
        os.dup2(stream.fileno(), number)
    try:
        yield
    finally:
        for number, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, number)
            os.close(copy)


def fuzz(name: str, reader: Reader, seconds: int) -> None:
    """Fuzz one reader in this process; libFuzzer ends it."""
    import atheris

    from pliant.spec.errors import PliantError
    from tests.fuzz.reader import MAX_BYTES

    logging.disable(logging.CRITICAL)
    corpus = BUILD / name
    corpus.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(reader.seeds()):
        (corpus / f"seed-{number}").write_bytes(seed[:MAX_BYTES])
    FINDINGS.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as at:
        path = Path(at) / f"input{reader.suffix}"

        def one(data: bytes) -> None:
            path.write_bytes(data)
            before, decoded, start = peak_mb(), 0.0, time.process_time()
            try:
                with suppress(PliantError):
                    decoded = array_mb(reader.read(path))
                taken = peak_mb() - before
                assert time.process_time() - start <= SECONDS_PER_INPUT, "took too long"
                assert taken <= MEMORY_PER_INPUT_MB + 2 * decoded, f"took {taken:.0f} MB"
            except BaseException:  # libFuzzer itself keeps hangs and floods of memory
                finding = FINDINGS / f"{name}-{hashlib.sha1(data).hexdigest()[:12]}"
                finding.write_bytes(data)
                traceback.print_exc()
                os._exit(1)

        options = [
            f"-max_total_time={seconds}",
            f"-timeout={HANG_SECONDS}",
            f"-rss_limit_mb={MEMORY_MB}",
            f"-max_len={MAX_BYTES}",
            f"-artifact_prefix={FINDINGS}/{name}-",
            "-print_final_stats=1",
        ]
        atheris.Setup([sys.argv[0], *options, str(corpus)], one)
        atheris.Fuzz()


def peak_mb() -> float:
    """Return the most memory that this process has had so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def array_mb(found: object) -> float:
    """Return the size of the arrays and tables in what a reader returned."""
    if is_dataclass(found):
        found = list(vars(found).values())
    if isinstance(found, dict):
        found = list(found.values())
    if isinstance(found, (list, tuple)):
        return sum(map(array_mb, found))
    return float(getattr(found, "nbytes", 0)) / 2**20


if __name__ == "__main__":
    sys.exit(main())
