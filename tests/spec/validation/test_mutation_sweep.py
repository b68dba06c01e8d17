"""Random corruptions: each is reported or harmless; none raises, hangs or takes much memory.

`PLIANT_SWEEP=2000 pytest -m long FILE` draws as many as that.
"""

from __future__ import annotations

import os
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pliant.spec.validation.validate import validate
from tests.conformance.corruption import corrupt, restore
from tests.conformance.harmless import is_harmless
from tests.spec.conftest import DATASETS

PROCESS = Path("/proc/self")
BASE = DATASETS / "full"
COUNT = int(os.environ.get("PLIANT_SWEEP", "400"))


def memory_kib(field: str) -> int:
    """This process's VmRSS (now) or VmHWM (the most since `forget_the_peak`)."""
    line = next(each for each in (PROCESS / "status").read_text().splitlines() if field in each)
    return int(line.split()[1])


@pytest.fixture(scope="module")
def forget_the_peak() -> int:
    """Reset the peak, whatever earlier tests of this process took; returns VmRSS, KiB."""
    (PROCESS / "clear_refs").write_text("5")
    return memory_kib("VmRSS")


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("sweep") / "full"
    return Path(shutil.copytree(BASE, root))


@pytest.mark.parametrize("count", [10, pytest.param(COUNT, marks=pytest.mark.long)])
def test_reported_or_harmless(copy: Path, forget_the_peak: int, count: int) -> None:
    """Each corruption is reported or harmless; most matter, and memory stays small."""
    outcomes: Counter[str] = Counter()

    @settings(
        max_examples=count,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(seed=st.integers(0, 2**32 - 1))
    def sweep(seed: int) -> None:
        restore(BASE, copy)
        done = corrupt(copy, np.random.default_rng(seed))
        report = validate(copy)
        outcomes["reported" if report.counts else "harmless"] += 1
        if not report.counts:
            assert is_harmless(BASE, copy), done

    sweep()
    assert outcomes["reported"] > 0.6 * outcomes.total()
    assert memory_kib("VmHWM") - forget_the_peak < 2**20  # 1 GiB


def move_depth(channels: dict[str, np.ndarray[Any, Any]]) -> None:
    channels["Z"] -= np.float32(0.1)


def test_the_judge_is_no_rubber_stamp(copy: Path) -> None:
    """What the sweep calls harmless would not be so called if it mattered."""
    from tests.conformance import edits

    name = "sequences/rope/rope-train-000000"
    restore(BASE, copy)
    assert is_harmless(BASE, copy)
    for change in (
        edits.change_rows(f"{name}/correspondences.parquet", lambda r: r[3].update(u_px=9.0)),
        edits.change_rows(f"{name}/correspondences.parquet", lambda r: r[3].update(x_m=9.0)),
        edits.change_rows(f"{name}/points.parquet", lambda r: r[3].update(m0=0.5)),
        edits.change_rows("truth/test.parquet", lambda r: r[3].update(u_b=9.0)),
        edits.change_json(f"{name}/cameras.json", lambda d: d["frames"][0]["K"][0].reverse()),
        edits.change_exr(f"{name}/depth/000000.exr", move_depth),
        edits.remove(f"{name}/rgb/000000.png"),
    ):
        restore(BASE, copy)
        change(copy)
        assert not is_harmless(BASE, copy)
