"""A disk without room for the cache of decoded frames is an error before anything is mapped."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from pliant.loaders import FrameStore
from pliant.spec.dataset import Dataset

PROGRAM = """
import resource, sys
from pathlib import Path

from pliant.loaders import FrameStore
from pliant.spec.dataset import Dataset
from pliant.spec.errors import PliantError

resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
store = FrameStore(Dataset.open("sample"), "rope", "train", cache=Path(sys.argv[1]))
try:
    for number in range(len(store)):
        store.view(number)
except PliantError as error:
    sys.exit(str(error))
"""


@pytest.mark.long
def test_too_little_room_is_one_line(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.returncode  # -7 is SIGBUS, -25 SIGXFSZ
    assert "there is no room for the cache of decoded frames" in done.stderr
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_cache_has_its_full_size_on_the_disk(tmp_path: Path) -> None:
    store = FrameStore(Dataset.open("sample"), "rope", "train", cache=tmp_path)
    store.view(0)
    (file,) = tmp_path.iterdir()
    assert file.stat().st_blocks * 512 >= file.stat().st_size
