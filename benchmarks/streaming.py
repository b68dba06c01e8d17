"""Training batches from a stream, against writing the dataset and loading it.

Both ways make the same batches of the same rope episodes at 640x480 (style `raster`, network input
160x120) with two worker processes, from the config to the last batch, in turns.

ratio_to_written      speed of the stream over that of `generate` and the loader together
ratio_to_written_cpu  the same in CPU seconds of all processes, which other work on the machine
                      does not disturb
frames_per_s_stream   rendered frames per second that become batches
"""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path
from typing import Any

import torch
from record import Value, main
from torch.utils.data import DataLoader

import pliant
from pliant.benchmarks.suite.work import Cost, Meter
from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.loaders import FrameStore, PairDataset, StepOrder

WORKERS, BATCH = 2, 8


def measure(quick: bool) -> dict[str, Value]:
    """Take the times of both ways in turns."""
    sequences, frames, steps, rounds = (6, 12, 20, 1) if quick else (12, 25, 60, 2)
    config = GenerateConfig(
        tiers=("rope",), splits={"train": sequences}, frames=frames, episodes=True, style="raster"
    )
    times: dict[str, list[Cost]] = {"written": [], "streamed": []}
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        generate(config.replace(splits={"train": 1}, frames=2), root / "warm")  # compiles
        for number in range(rounds):
            batches = []
            for name, way in (("written", _written), ("streamed", _streamed)):
                meter = Meter()
                batches.append(way(config, steps, root / str(number)))
                times[name].append(meter.cost)
            for mine, other in zip(*batches, strict=True):
                for name in mine:
                    torch.testing.assert_close(mine[name], other[name], rtol=0, atol=0)
    wall = {name: statistics.median(each.wall_s for each in costs) for name, costs in times.items()}
    cpu = {name: statistics.median(each.cpu_s for each in costs) for name, costs in times.items()}
    total = sequences * frames
    return {
        "frames": total,
        "batches": steps,
        "ratio_to_written": wall["written"] / wall["streamed"],
        "ratio_to_written_cpu": cpu["written"] / cpu["streamed"],
        "frames_per_s_stream": total / wall["streamed"],
        "cpu_s_per_frame_stream": cpu["streamed"] / total,
    }


def _written(config: GenerateConfig, steps: int, root: Path) -> Any:
    generate(config, root / "set", workers=WORKERS)
    store = FrameStore(pliant.load(root / "set"), "rope", "train", cache=root / "written")
    order = StepOrder(BATCH, 0, steps)
    return list(DataLoader(PairDataset(store), batch_sampler=order, num_workers=WORKERS))


def _streamed(config: GenerateConfig, steps: int, root: Path) -> Any:
    stream = pliant.stream(config, batch=BATCH, steps=steps, cache=root / "streamed")
    return list(DataLoader(stream, batch_size=None, num_workers=WORKERS))


if __name__ == "__main__":
    main("streaming", measure, __doc__)
