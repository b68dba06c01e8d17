from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pliant.generator.compiled import KEPT

CALLEE = """
from pliant.generator.compiled import compiled
from shop.room.constants import FACTOR

@compiled
def scaled(x):
    return {sign}FACTOR * x
"""

CALLER = """
from pliant.generator.compiled import compiled
from shop.room.callee import scaled

@compiled
def total(x):
    return below(x) + 1

@compiled
def below(x):
    return scaled(x)

print(total(10.0), sum(total.stats.cache_hits.values()))
"""


@pytest.fixture
def shop(tmp_path: Path) -> Path:
    """A package of which one module calls a compiled function of another."""
    room = tmp_path / "shop" / "room"
    room.mkdir(parents=True)
    for folder in (room, room.parent):
        (folder / "__init__.py").write_text("")
    (room / "constants.py").write_text("FACTOR = 2.0\n")
    (room / "callee.py").write_text(CALLEE.format(sign=""))
    (room / "caller.py").write_text(CALLER)
    return room


def run(room: Path, **environment: str) -> tuple[float, int]:
    """Call the package in a new process: its result, and how many functions were cached."""
    root = room.parent.parent
    clean = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    variables = {**clean, "PYTHONPATH": str(root), "XDG_CACHE_HOME": str(root / "cache")}
    done = subprocess.run(
        [sys.executable, "-B", "-c", "import shop.room.caller"],
        env={**variables, **environment}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    result, hits = done.stdout.split()
    return float(result), int(hits)


@pytest.mark.long
def test_an_edited_callee_or_constant_in_another_file_gives_the_new_result(shop: Path) -> None:
    assert run(shop) == (21, 0)
    assert run(shop) == (21, 1)  # and what did not change is not compiled again
    (shop / "callee.py").write_text(CALLEE.format(sign="-"))
    assert run(shop) == (-19, 0)
    (shop / "constants.py").write_text("FACTOR = 3.0\n")
    assert run(shop) == (-29, 0)


def test_cache_folders_of_old_sources_are_removed(shop: Path) -> None:
    base = shop.parent.parent / "cache" / "pliant" / "numba"
    old = [base / f"caller-{number:016x}" for number in range(KEPT + 2)]
    for number, folder in enumerate(old):
        folder.mkdir(parents=True)
        os.utime(folder, (time.time() - 1000 + number,) * 2)
    other = base / "caller-of-another-module"
    other.mkdir()
    run(shop)
    assert [folder.is_dir() for folder in old] == [False] * 3 + [True] * (KEPT - 1)
    assert other.is_dir()
    assert len(list(base.glob("caller-*"))) == KEPT + 1
    assert len(list(base.glob("callee-*"))) == 1


def test_the_cache_goes_where_numba_is_told(shop: Path, tmp_path: Path) -> None:
    run(shop, NUMBA_CACHE_DIR=str(tmp_path / "named"))
    assert list((tmp_path / "named" / "pliant").glob("caller-*/**/*.nbc"))
    assert not (tmp_path / "cache").exists()


def test_without_a_folder_that_can_be_written_nothing_is_kept(shop: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert run(shop, XDG_CACHE_HOME=str(tmp_path / "file")) == (21, 0)
