"""How fast a dataset is validated, next to merely decoding the same files.

Generates a set in style `raster` (640x480, rope and cloth), then measures, on the same files,
with the same libraries in one process: full validation, and decoding every PNG, EXR, Parquet and
JSON file and throwing the contents away. The ratio of the two is taken in CPU time, which other
work on the machine does not disturb; `…_wall` is that of wall times.

`quick_ms_per_sequence_N` is the CPU time of a quick validation of N sequences of one small frame,
copies of one, without its fixed cost (that of one sequence).
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pyarrow as pa
import pyarrow.parquet as pq
import record
from PIL import Image

from pliant.benchmarks.suite.work import Meter
from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.spec.io.parquet import write_table
from pliant.spec.storage import layout
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


def repeat_sequence(root: Path, count: int) -> None:
    """Add copies of the only sequence of a dataset, until there are `count`."""
    table = pq.read_table(root / layout.SEQUENCES_TABLE)
    (first,) = (root / layout.SEQUENCES_DIR / "rope").iterdir()
    names = [first.name, *(f"rope-train-{number:06d}" for number in range(1, count))]
    info = json.loads((first / layout.SEQUENCE_JSON).read_bytes())
    for number, name in enumerate(names[1:], 1):
        folder = layout.sequence_dir(root, "rope", name)
        shutil.copytree(first, folder)
        copied = {**info, "id": name, "index": number}
        (folder / layout.SEQUENCE_JSON).write_text(json.dumps(copied))
    table = pa.concat_tables([table] * count).set_column(0, table.schema.field(0), [names])
    write_table(root / layout.SEQUENCES_TABLE, table, "sequences", {})


def quick_per_sequence(counts: tuple[int, ...]) -> dict[str, record.Value]:
    """Return the CPU ms of a quick validation per sequence, for sets of several sizes."""
    found: dict[str, record.Value] = {}
    config = GenerateConfig(
        tiers=("rope",), splits={"train": 1}, width=160, height=120, style="raster"
    )
    with tempfile.TemporaryDirectory() as scratch:
        one = Path(scratch) / "1"
        generate(config, one, workers=1)
        fixed, _ = timed(lambda: validate(one, quick=True), 5)
        for count in counts:
            root = Path(scratch) / str(count)
            shutil.copytree(one, root)
            repeat_sequence(root, count)
            report = validate(root, quick=True)
            if not report.valid or report.sequences != count:  # frames are repeated: a warning
                raise SystemExit(f"the set of {count} is not valid: {report.issues[:1]}")
            cpu_s, _ = timed(lambda: validate(root, quick=True), 2)  # noqa: B023
            found[f"quick_ms_per_sequence_{count}"] = 1e3 * (cpu_s - fixed) / (count - 1)
    return found


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
        **quick_per_sequence((100, 1000) if quick else (100, 1000, 10_000)),
    }


if __name__ == "__main__":
    record.main("validation", measure, __doc__)
