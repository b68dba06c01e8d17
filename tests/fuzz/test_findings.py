"""Readers on right files, on damaged ones, and on everything that fuzzing has found."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba")
pytest.importorskip("torch")
pytest.importorskip("fastapi")

from pliant.spec.errors import PliantError
from tests.fuzz.__main__ import FINDINGS
from tests.fuzz.reader import MAX_BYTES
from tests.fuzz.readers import READERS

FOUND = [path for path in sorted(FINDINGS.glob("*")) if path.name != "README.md"]


@pytest.mark.parametrize("path", FOUND, ids=lambda path: path.name)
def test_what_fuzzing_found(path: Path, tmp_path: Path) -> None:
    name = next(each for each in READERS if path.name.startswith(f"{each}-"))
    copy = tmp_path / f"input{READERS[name].suffix}"
    copy.write_bytes(path.read_bytes())
    with suppress(PliantError):
        READERS[name].read(copy)


@pytest.mark.parametrize("name", READERS)
def test_damaged_files(name: str, tmp_path: Path) -> None:
    """40 damages in all, 4 per right file: bytes changed, removed, repeated, the end missing."""
    reader = READERS[name]
    path = tmp_path / f"input{reader.suffix}"
    rng = np.random.default_rng(list(name.encode()))
    seeds = list(reader.seeds())
    for seed in seeds:
        for damage in range(max(4, 40 // len(seeds))):
            data = bytearray(seed)
            at = int(rng.integers(len(data)))
            if damage % 4 == 0:
                data[at:] = b""
            elif damage % 4 == 1:
                del data[at : at + int(rng.integers(1, 9))]
            elif damage % 4 == 2:
                data[at:at] = data[max(0, at - int(rng.integers(1, 200))) : at]
            else:
                for place in rng.integers(len(data), size=int(rng.integers(1, 20))):
                    data[place] = int(rng.integers(256))
            path.write_bytes(data[: 4 * MAX_BYTES])
            with suppress(PliantError):
                reader.read(path)
