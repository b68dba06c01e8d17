"""A stand-in for the real maker: a flat sheet that costs nothing, and faults on demand.

It lies outside the test modules because worker processes import it by name.
"""

from __future__ import annotations

import errno
import functools
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.engine import Engine, Event, OpenMaker, Rendered, attempt
from pliant.generator.runner.progress import RunState, Summary
from pliant.generator.runner.run import generate
from pliant.generator.runner.sequence import SequenceMaker, Shooting, StageClock, TakenFrame
from pliant.generator.scene.scene_object import Points, Pose, SceneObject
from pliant.generator.seeding import RandomStreams, SequenceTask, Stream
from pliant.generator.truth.frame_truth import FrameTruth
from pliant.generator.truth.rasteriser import Hits
from pliant.spec.camera import Camera
from pliant.spec.errors import GenerationError
from pliant.spec.io.exr import Surface
from pliant.spec.io.reading import sha256_file

NO_HITS = Hits(np.zeros((0, 0), np.int32), np.zeros((0, 0)), np.zeros((0, 0, 2)))
SIDE = 4  # points along a side of the sheet
GRID = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), -1).reshape(-1, 2)
COUNT = len(GRID)
POINTS = Points(
    np.ones(COUNT, np.int32),
    np.arange(COUNT, dtype=np.int32),
    np.zeros(COUNT, bool),
    (GRID / SIDE).astype(np.float32),
    np.zeros((COUNT, 0), np.int32),
)


class StandInMaker(SequenceMaker):
    """Draws a square that moves; `faults` maps a sequence id to what goes wrong with it."""

    def __init__(
        self, config: GenerateConfig, root: Path, faults: Mapping[str, str], frame_s: float
    ) -> None:
        super().__init__(config.replace(style="raster", depth_camera=None), root)
        self.config, self.faults, self.frame_s = config, faults, frame_s
        self._tiers = {"rope"}  # nothing has to be loaded

    def shoot(self, task: SequenceTask, clock: StageClock | None = None) -> Shooting:
        temporal, frames = self.config.episodes, self.config.frames
        pose = Pose({})
        scene_object = SceneObject(
            task.tier, "rope", None, temporal, frames, (), POINTS, lambda _: pose, 1.0, 0.01
        )
        camera = Camera(np.diag([100.0, 100.0, 1.0]), np.eye(4), self.config.size)
        appearance: Any = {}
        return Shooting(scene_object, camera, appearance, self._frames(task))

    def _frames(self, task: SequenceTask) -> Iterator[TakenFrame]:
        width, height = self.config.size
        streams = RandomStreams(self.config.seed, task)
        for frame in range(self.config.frames):
            rng = streams.generator(Stream.NOISE, frame)
            time.sleep(self.frame_s)
            if frame == self.config.frames // 2:
                self._fail(task)
            left, top = int(rng.integers(0, width - 8)), int(rng.integers(0, height - 8))
            mask = np.zeros((height, width), bool)
            mask[top : top + 8, left : left + 8] = True
            half = mask.astype(np.float32) * 0.5
            depth_m = np.where(mask, 1.0, np.inf).astype(np.float32)
            truth = FrameTruth(
                surface=Surface(depth_m, half, half, mask.astype(np.uint32)),
                uv_px=GRID * 2.0 + (left + 1.0, top + 1.0),
                depth_m=np.ones(COUNT),
                visibility=["visible"] * COUNT,
                xyz_m=np.zeros((COUNT, 3)),
                hits=NO_HITS,
                world_vertices=np.zeros((0, 3)),
            )
            rgb = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
            yield rgb, truth, {"box_px": [left, top, left + 8, top + 8], "self_occluded": 0.0}

    def _fail(self, task: SequenceTask) -> None:
        fault = self.faults.get(task.id)
        if fault == "raise":
            raise ValueError("no such knot")
        if fault == "impossible":
            raise GenerationError("no rope fits", path="rope.yaml")
        if fault == "segfault":
            os.kill(os.getpid(), signal.SIGSEGV)
        if fault == "full":
            raise OSError(errno.ENOSPC, "No space left on device", "000000.exr")
        if fault == "hang":
            time.sleep(3600)
        if fault == "memory":
            used = psutil.Process().memory_info().vms
            resource.setrlimit(resource.RLIMIT_AS, (used + 2**28, resource.RLIM_INFINITY))
            np.ones(2**28)
        if fault == "once":
            marker = self.root / ".pliant" / f"failed-{task.id}"
            if not marker.exists():
                marker.touch()
                os.kill(os.getpid(), signal.SIGKILL)


class InProcess:
    """An engine that makes the tasks here, one after another: no process has to start."""

    workers = 1

    def events(
        self, tasks: Sequence[SequenceTask], open_maker: OpenMaker
    ) -> Generator[Event, None, None]:
        opened = functools.cache(open_maker)
        for task in tasks:
            frames: list[SequenceTask] = []
            event = attempt(opened, task, functools.partial(frames.append, task))
            yield Rendered(task, len(frames))
            yield event


def maker(
    config: GenerateConfig,
    root: Path,
    faults: Mapping[str, str] | None = None,
    frame_s: float = 0.0,
) -> Callable[[], StandInMaker]:
    """Return what `generate` takes as `open_maker`."""
    return functools.partial(StandInMaker, config, Path(root), faults or {}, frame_s)


def digests(root: Path) -> dict[str, str]:
    """Return file -> sha256 of a dataset, the run's own records left out."""
    return {
        path.relative_to(root).as_posix(): sha256_file(path)
        for path in sorted(root.rglob("*"))
        if path.is_file() and ".pliant" not in path.parts
    }


def small_config(**changes: Any) -> GenerateConfig:
    """Return a config of six rope sequences of four tiny frames."""
    fields: dict[str, Any] = {
        "tiers": ("rope",),
        "splits": {"train": 3, "test": 3},
        "frames": 4,
        "episodes": True,
        "width": 48,
        "height": 32,
        "style": "raster",
        **changes,
    }
    return GenerateConfig(**fields)


def make(
    out: Path,
    *,
    workers: int = 0,
    engine: Engine | None = None,
    progress: Callable[[RunState], None] | None = None,
    faults: Mapping[str, str] | None = None,
    frame_s: float = 0.0,
    **changes: Any,
) -> Summary:
    """Make the small set with some changes, here unless workers or an engine are given."""
    config = small_config(**changes)
    return generate(
        config,
        out,
        workers=workers or 1,
        engine=engine or ("local" if workers else InProcess()),
        progress=progress,
        open_maker=maker(config, out, faults, frame_s),
    )


if __name__ == "__main__":  # OUT WORKERS: a run in a process of its own, to be killed
    make(Path(sys.argv[1]), workers=int(sys.argv[2]), frame_s=0.05)
