"""How fast a dataset is validated, next to merely decoding the same files.

Generates a set in style `raster` (640x480, rope and cloth), then measures, on the same files,
with the same libraries and the same number of processes: full validation, and decoding every
PNG, EXR, Parquet and JSON file and throwing the contents away. The ratio of the two is taken
in CPU time, which other work on the machine does not disturb; wall times stand next to it.
"""

from __future__ import annotations

import json
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import OpenEXR
import pyarrow.parquet as pq
import record
from PIL import Image

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.spec.validation.validate import validate

WORKERS = 2
CHANNELS = ["Z", "surface.m0", "surface.m1", "surface.object"]


def decode(path: Path) -> None:
    """Decode one file with the library that validation uses for it."""
    if path.suffix == ".png":
        np.asarray(Image.open(path))
    elif path.suffix == ".exr":
        image = OpenEXR.InputFile(str(path))
        image.channels(CHANNELS)
        image.close()
    elif path.suffix == ".parquet":
        pq.ParquetFile(path).read(use_threads=False)
    elif path.suffix == ".json":
        json.loads(path.read_bytes())


def decode_all(paths: list[Path]) -> None:
    for path in paths:
        decode(path)


def decode_parallel(folders: list[list[Path]]) -> None:
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(WORKERS, mp_context=spawn) as pool:
        list(pool.map(decode_all, folders))


def cpu_s() -> float:
    own = resource.getrusage(resource.RUSAGE_SELF)
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def timed(work: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Return the least CPU and wall seconds of some runs."""
    best = [float("inf"), float("inf")]
    for _ in range(repeats):
        start = cpu_s(), time.perf_counter()
        work()
        best[0] = min(best[0], cpu_s() - start[0])
        best[1] = min(best[1], time.perf_counter() - start[1])
    return best[0], best[1]


def measure(quick: bool) -> dict[str, record.Value]:
    frames = 10 if quick else 60
    repeats = 3 if quick else 5
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch) / "set"
        config = GenerateConfig(
            tiers=("rope", "cloth-1"),
            splits={"train": 1, "test": 1},
            frames=frames,
            episodes=True,
            style="raster",
        )
        generate(config, root, workers=1)
        paths = [path for path in sorted(root.rglob("*")) if path.is_file()]
        paths = [path for path in paths if ".pliant" not in path.parts]
        sequences = sorted(root.glob("sequences/*/*"))
        folders = [[path for path in paths if folder in path.parents] for folder in sequences]
        report = validate(root)
        if report.counts:
            raise SystemExit(f"the set is not valid: {report.issues[0]}")
        decode_all(paths)  # both sides start with the files in memory
        decoding = timed(lambda: decode_all(paths), repeats)
        validating = timed(lambda: validate(root), repeats)
        quick_run = timed(lambda: validate(root, quick=True), repeats)
        decoding_2 = timed(lambda: decode_parallel(folders), repeats)
        validating_2 = timed(lambda: validate(root, workers=WORKERS), repeats)
        size = sum(path.stat().st_size for path in paths)
    return {
        "frames": report.frames,
        "bytes": size,
        "ratio_to_decoding": validating[0] / decoding[0],
        "ratio_to_decoding_wall": validating[1] / decoding[1],
        "ratio_to_decoding_wall_2_workers": validating_2[1] / decoding_2[1],
        "decoding_cpu_s": decoding[0],
        "validation_cpu_s": validating[0],
        "quick_cpu_s": quick_run[0],
        "validation_wall_2_workers_s": validating_2[1],
        "decoding_wall_2_workers_s": decoding_2[1],
        "frames_per_cpu_s": report.frames / validating[0],
        "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


if __name__ == "__main__":
    record.main("validation", measure, __doc__)
