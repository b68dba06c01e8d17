"""Datasets are the same on every processor and with any number of threads.

Tested with AVX-512 switched off in NumPy and BLAS, and with Numba compiling for no processor in
particular.
"""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pliant.generator import portable
from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.generator.settings import ClothSettings
from tests.generator.runner.standin import InProcess

OLDER = {
    "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL",
    "OPENBLAS_CORETYPE": "Haswell",
}
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "4")
GENERIC = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
ROOT = Path(__file__).parents[2]
CONFIG = GenerateConfig(
    tiers=("rope", "cloth-1"),
    splits={"test": 2},
    seed=5,
    width=160,
    height=120,
    style="raster",
    cloth=ClothSettings(points_a_side=17, tracked_a_side=17),
)


def test_functions_are_those_of_the_c_library() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.normal(0, 20, (2, 500))
    np.testing.assert_array_equal(portable.sin(x), [math.sin(each) for each in x])
    np.testing.assert_array_equal(portable.cos(x), [math.cos(each) for each in x])
    expected = [math.atan2(a, b) for a, b in zip(y, x, strict=True)]
    np.testing.assert_array_equal(portable.arctan2(y, x), expected)


def test_a_product_is_the_product() -> None:
    rng = np.random.default_rng(1)
    rows, matrix = rng.normal(size=(4, 7, 3)), rng.normal(size=(3, 2))
    expected = (rows[..., None] * matrix).sum(axis=-2)
    np.testing.assert_allclose(portable.product(rows, matrix), expected, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(portable.product(rows[0, 0], matrix), expected[0, 0], atol=1e-15)
    assert portable.norm(np.array([3.0, -4.0])) == 5.0


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Checksums of the dataset as this process makes it, with one thread."""
    out = tmp_path_factory.mktemp("own") / "data"
    generate(CONFIG, out, engine=InProcess())
    return checksums(out)


def made(out: Path, environment: dict[str, str]) -> dict[str, str]:
    """Generate a dataset in a new process; return file -> sha256."""
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r})\n"
        "from pliant.generator.runner.run import generate\n"
        "from tests.generator.runner.standin import InProcess\n"
        "from tests.generator.test_portable import CONFIG\n"
        "generate(CONFIG, sys.argv[1], engine=InProcess())"
    )
    command = [sys.executable, "-c", code, str(out)]
    subprocess.run(command, env={**os.environ, **environment}, check=True)
    return checksums(out)


def checksums(out: Path) -> dict[str, str]:
    found = {
        str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(out.rglob("*"))
        if path.suffix in (".parquet", ".exr", ".png") or path.name == "cameras.json"
    }
    assert len(found) > 20
    return found


@pytest.mark.parametrize(
    "environment",
    [OLDER | THREADS, pytest.param(GENERIC, marks=pytest.mark.long)],
    ids=["older-and-threads", "generic"],
)
def test_datasets_do_not_depend_on_processor_and_threads(
    own: dict[str, str], environment: dict[str, str], tmp_path: Path
) -> None:
    """Byte for byte: cameras, tables, queries, depth and images of ropes and cloths.

    As on an older processor with four threads in every library; and compiled for no processor
    in particular.
    """
    assert made(tmp_path / "data", environment) == own
