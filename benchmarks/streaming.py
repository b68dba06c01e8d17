"""Training batches from a stream, against writing the dataset and loading it.

Both ways make the same batches of the same rope episodes at 640x480 (style `raster`, network input
160x120) with two worker processes, from the config to the last batch, in turns.

ratio_to_written      speed of the stream over that of `generate` and the loader together
ratio_to_written_cpu  the same in CPU seconds of all processes, which other work on the machine
                      does not disturb
ratio_to_generate     speed of the stream over that of `generate` alone
frames_per_s_stream   rendered frames per second that become batches
frames_per_s_written  the same by way of files
bytes_per_frame       what a written frame takes on the disk, which the stream does not
"""

from __future__ import annotations

import resource
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import torch
from record import Value, main
from torch.utils.data import DataLoader

import pliant
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
    times: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        generate(config.replace(splits={"train": 1}, frames=2), root / "warm")  # compiles
        for number in range(rounds):
            batches = []
            for way in (_written, _streamed):
                batches.append(way(config, steps, root / str(number), times))
            for mine, other in zip(*batches, strict=True):
                for name in mine:
                    torch.testing.assert_close(mine[name], other[name], rtol=0, atol=0)
        files = [each for each in (root / "0" / "set").rglob("*") if each.is_file()]
        size = sum(each.stat().st_size for each in files)
    spent = {name: statistics.median(values) for name, values in times.items()}
    total = sequences * frames
    return {
        "frames": total,
        "batches": steps,
        "ratio_to_written": spent["written"] / spent["streamed"],
        "ratio_to_written_cpu": spent["written_cpu"] / spent["streamed_cpu"],
        "ratio_to_generate": spent["generate"] / spent["streamed"],
        "frames_per_s_stream": total / spent["streamed"],
        "frames_per_s_written": total / spent["written"],
        "cpu_s_per_frame_stream": spent["streamed_cpu"] / total,
        "cpu_s_per_frame_written": spent["written_cpu"] / total,
        "bytes_per_frame": size / total,
    }


def _written(config: GenerateConfig, steps: int, root: Path, times: dict[str, list[float]]) -> Any:
    with _Timer("written", times):
        with _Timer("generate", times):
            generate(config, root / "set", workers=WORKERS)
        store = FrameStore(pliant.load(root / "set"), "rope", "train", cache=root / "written")
        order = StepOrder(BATCH, 0, steps)
        return list(DataLoader(PairDataset(store), batch_sampler=order, num_workers=WORKERS))


def _streamed(config: GenerateConfig, steps: int, root: Path, times: dict[str, list[float]]) -> Any:
    with _Timer("streamed", times):
        stream = pliant.stream(config, batch=BATCH, steps=steps, cache=root / "streamed")
        return list(DataLoader(stream, batch_size=None, num_workers=WORKERS))


class _Timer:
    """Adds the seconds of a block and the CPU seconds of all processes to a list."""

    def __init__(self, name: str, times: dict[str, list[float]]) -> None:
        self._name, self._times = name, times

    def __enter__(self) -> None:
        self._started = time.perf_counter(), _cpu_s()

    def __exit__(self, *_: object) -> None:
        wall, cpu = self._started
        self._times.setdefault(self._name, []).append(time.perf_counter() - wall)
        self._times.setdefault(f"{self._name}_cpu", []).append(_cpu_s() - cpu)


def _cpu_s() -> float:
    uses = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(use.ru_utime + use.ru_stime for use in uses)


if __name__ == "__main__":
    main("streaming", measure, __doc__)
