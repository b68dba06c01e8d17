"""How fast datasets are made, where the time goes, and what a frame costs on disk.

Rope episodes at 640x480 through the whole pipeline (simulation, truth, colour, PNG, EXR,
tables, sync) by two workers of one thread each. `images_per_s_*` is the sustained rate: from
the first tenth of the frames until the first worker ends, start-up left out. CPU seconds per
image are steadier than rates: take those on a machine that does other things.

`scaling_2_workers*` is two workers, a core each, against one worker on one core.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from record import Value, main

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.engine import STAGES, Failed, Finished, Rendered, SequenceResult
from pliant.generator.runner.engine_local import LocalEngine
from pliant.generator.runner.plan import plan_tasks
from pliant.generator.runner.run import sequence_maker

STYLES = ("raster", "fast", "photo")
FRAMES = {"raster": 150, "fast": 150, "photo": 50}
FRAMES_QUICK = {"raster": 30, "fast": 16, "photo": 6}


def measure(quick: bool) -> dict[str, Value]:
    frames = FRAMES_QUICK if quick else FRAMES
    record: dict[str, Value] = {}
    for style in STYLES:
        rope = run("rope", style, frames[style], workers=2)
        record[f"images_per_s_{style}"] = rope.images_per_s
        record[f"cpu_s_per_image_{style}"] = rope.cpu_s_per_image
        for stage, share in rope.shares.items():
            record[f"share_{style}_{stage}"] = share
        record[f"bytes_per_frame_{style}"] = rope.bytes_per_frame
        if style == "fast":  # the default: its shares and bytes bear the plain names
            record |= {f"share_{stage}": share for stage, share in rope.shares.items()}
            record["bytes_per_frame"] = rope.bytes_per_frame
        if style in ("raster", "fast"):
            suffix = "" if style == "raster" else f"_{style}"
            with _one_core():
                bound = run("rope", style, frames[style] // 2, workers=1)
            record[f"scaling_2_workers{suffix}"] = rope.images_per_s / bound.images_per_s
    for style in ("raster",) if quick else STYLES:
        cloth = run("cloth-3", style, 12 if quick else 20, workers=2)
        record[f"images_per_s_cloth3_{style}"] = cloth.images_per_s
        record[f"cpu_s_per_image_cloth3_{style}"] = cloth.cpu_s_per_image
        record[f"bytes_per_frame_cloth3_{style}"] = cloth.bytes_per_frame
    return record


class Run(NamedTuple):
    """What one run showed."""

    images_per_s: float
    cpu_s_per_image: float
    bytes_per_frame: float
    shares: dict[str, float]
    """Share of the CPU time of each stage; what no stage claims is the renderer's threads."""


def _sustained(ticks: list[tuple[float, int]], frames: int) -> float:
    """Return the rate between a tenth of the frames and the first worker's end."""
    warm = [tick for tick in ticks if tick[1] >= frames / 10]
    if len(warm) < 3:  # too short a run to leave the start out
        return ticks[-1][1] / (ticks[-1][0] - ticks[0][0])
    (start, first), (end, last) = warm[0], warm[-1]
    return (last - first) / (end - start)


def run(tier: str, style: str, frames: int, *, workers: int) -> Run:
    """Make one episode per worker."""
    config = GenerateConfig(
        tiers=(tier,), splits={"train": workers}, frames=frames, episodes=True, style=style
    )
    results: list[SequenceResult] = []
    with tempfile.TemporaryDirectory(prefix="pliant-benchmark-") as folder:
        maker = sequence_maker(config, Path(folder))
        ticks, done = [(time.perf_counter(), 0)], 0
        for event in LocalEngine(workers).events(plan_tasks(config), maker):
            if isinstance(event, Failed):
                raise SystemExit(event.error)
            if isinstance(event, Rendered):
                done += event.frames
                if not results:
                    ticks.append((time.perf_counter(), done))
            if isinstance(event, Finished):
                results.append(event.result)
    total_frames = sum(result.frames for result in results)
    total_s = sum(result.cpu_s for result in results)
    spent = {stage: sum(each.stage_cpu_s.get(stage, 0.0) for each in results) for stage in STAGES}
    spent["render"] += total_s - sum(spent.values())
    return Run(
        _sustained(ticks, total_frames),
        total_s / total_frames,
        sum(result.bytes for result in results) / total_frames,
        {stage: cpu_s / total_s for stage, cpu_s in spent.items()},
    )


@contextmanager
def _one_core() -> Iterator[None]:
    """Leave one core to this process and those it starts meanwhile."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


if __name__ == "__main__":
    main("generation", measure, __doc__)
