"""CPU time of validating a dataset, relative to decoding the same files.

Generates a set in style `raster` (640x480, rope and cloth), then measures, on the same files,
with the same libraries in one process: full validation, and decoding every PNG, EXR, Parquet and
JSON file and throwing the contents away. The ratio of the two is taken in CPU time, which other
work on the machine does not disturb; `…_wall` is that of wall times.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pyarrow.parquet as pq
import record
from PIL import Image

from pliant.benchmarks.suite.work import Meter
from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.spec.validation.validate import validate

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


def timed(work: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Return the least CPU and wall seconds of some runs."""
    costs = []
    for _ in range(repeats):
        meter = Meter()
        work()
        costs.append(meter.cost)
    return min(each.cpu_s for each in costs), min(each.wall_s for each in costs)


def measure(quick: bool) -> dict[str, record.Value]:
    frames = 10 if quick else 60
    repeats = 3 if quick else 5
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch) / "set"
        splits = {"train": 1, "test": 1}
        config = GenerateConfig(
            tiers=("rope", "cloth-1"), splits=splits, frames=frames, episodes=True, style="raster"
        )
        generate(config, root, workers=1)
        paths = [path for path in sorted(root.rglob("*")) if path.is_file()]
        paths = [path for path in paths if ".pliant" not in path.parts]
        report = validate(root)
        if report.counts:
            raise SystemExit(f"the set is not valid: {report.issues[0]}")
        decode_all(paths)  # both sides start with the files in memory
        decoding = timed(lambda: decode_all(paths), repeats)
        validating = timed(lambda: validate(root), repeats)
        quick_run = timed(lambda: validate(root, quick=True), repeats)
        size = sum(path.stat().st_size for path in paths)
    return {
        "frames": report.frames,
        "bytes": size,
        "ratio_to_decoding": validating[0] / decoding[0],
        "ratio_to_decoding_wall": validating[1] / decoding[1],
        "decoding_cpu_s": decoding[0],
        "validation_cpu_s": validating[0],
        "quick_cpu_s": quick_run[0],
    }


if __name__ == "__main__":
    record.main("validation", measure, __doc__)
