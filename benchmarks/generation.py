"""How fast datasets are made, where the time goes, and what a frame costs on disk.

Rope episodes at 640x480 through the whole pipeline (simulation, truth, colour, PNG, EXR,
tables, sync) by two workers of one thread each. `images_per_s_*` is the sustained rate: from
the first tenth of the frames until the first worker ends, start-up left out. CPU seconds per
image are steadier than rates: take those on a machine that does other things.

`scaling_2_workers*` is two workers, a core each, against one worker on one core.
`gain_of_2nd_worker*` is the same two against one worker that has both cores to itself: its second
core already encodes images and works out the next frame's truth, so a second worker gains less,
and least where rendering is short compared with the rest (`raster`).
"""

from __future__ import annotations

import functools
import multiprocessing
import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from record import Value, main

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.engine import STAGES, Failed, Finished, Rendered, SequenceResult
from pliant.generator.runner.engine_local import LocalEngine
from pliant.generator.runner.plan import plan_tasks
from pliant.generator.runner.run import open_sequence_maker
from pliant.generator.seeding import SequenceTask

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
        for stage, share in rope.shares().items():
            record[f"share_{style}_{stage}"] = share
        record[f"bytes_per_frame_{style}"] = rope.bytes_per_frame
        if style == "fast":  # the default: its shares and bytes bear the plain names
            record |= {f"share_{stage}": share for stage, share in rope.shares().items()}
            record["bytes_per_frame"] = rope.bytes_per_frame
        if style in ("raster", "fast"):
            suffix = "" if style == "raster" else f"_{style}"
            with _one_core():
                bound = run("rope", style, frames[style] // 2, workers=1)
            free = run("rope", style, frames[style] // 2, workers=1)
            record[f"scaling_2_workers{suffix}"] = rope.images_per_s / bound.images_per_s
            record[f"gain_of_2nd_worker{suffix}"] = rope.images_per_s / free.images_per_s
    for style in ("raster",) if quick else STYLES:
        cloth = run("cloth-3", style, 12 if quick else 20, workers=2)
        record[f"images_per_s_cloth3_{style}"] = cloth.images_per_s
        record[f"cpu_s_per_image_cloth3_{style}"] = cloth.cpu_s_per_image
        record[f"bytes_per_frame_cloth3_{style}"] = cloth.bytes_per_frame
    for style in STYLES:
        with _one_core():  # as a worker is
            record |= apart(floors, style, 3 if quick else 10)
    record |= encoders(2 if quick else 6)
    record |= apart(memory, "fast", 60 if quick else 1000)
    return record


class Run:
    """What one run showed."""

    def __init__(self, results: list[SequenceResult], ticks: list[tuple[float, int]]) -> None:
        self.results = results
        self.frames = sum(result.frames for result in results)
        self.images_per_s = _sustained(ticks, self.frames)
        self.cpu_s_per_image = sum(result.cpu_s for result in results) / self.frames
        self.bytes_per_frame = sum(result.bytes for result in results) / self.frames

    def shares(self) -> dict[str, float]:
        """Share of the CPU time of each stage; what no stage claims is the renderer's threads."""
        total = sum(result.cpu_s for result in self.results)
        spent = {
            stage: sum(result.stage_cpu_s.get(stage, 0.0) for result in self.results)
            for stage in STAGES
        }
        spent["render"] = total - sum(cpu_s for stage, cpu_s in spent.items() if stage != "render")
        return {stage: cpu_s / total for stage, cpu_s in spent.items()}


def _sustained(ticks: list[tuple[float, int]], frames: int) -> float:
    """Return the rate between a tenth of the frames and the first worker's end."""
    warm = [tick for tick in ticks if tick[1] >= frames / 10]
    if len(warm) < 3:  # too short a run to leave the start out
        return ticks[-1][1] / (ticks[-1][0] - ticks[0][0])
    (start, first), (end, last) = warm[0], warm[-1]
    return (last - first) / (end - start)


def run(tier: str, style: str, frames: int, *, workers: int) -> Run:
    """Make one episode per worker."""
    config = _config(tier, style, frames, workers)
    results: list[SequenceResult] = []
    with _folder() as root:
        ticks, done = [(time.perf_counter(), 0)], 0
        for event in LocalEngine(workers).events(plan_tasks(config), _maker(config, root)):
            if isinstance(event, Failed):
                raise SystemExit(event.error)
            if isinstance(event, Rendered):
                done += event.frames
                if not results:
                    ticks.append((time.perf_counter(), done))
            if isinstance(event, Finished):
                results.append(event.result)
    return Run(results, ticks)


def floors(style: str, frames: int) -> dict[str, Value]:
    """CPU seconds of rendering alone: pose and truth are at hand, nothing is written."""
    from pliant.generator.objects.tiers import sample_scene_object
    from pliant.generator.runner.sequence import SequenceMaker
    from pliant.generator.truth.frame_truth import frame_truth

    config = _config("rope", style, frames + 1, 1)
    task = SequenceTask("rope", "train", 0)
    with _folder() as root:
        maker = SequenceMaker(config, root, root / "scratch")
        scene_object = sample_scene_object(config, task)
        camera, appearance = maker.view(task, scene_object, [scene_object.pose(0)])
        poses = [scene_object.pose(frame) for frame in range(frames + 1)]
        truths = [frame_truth(scene_object, pose, camera) for pose in poses]
        maker.renderer.begin(scene_object, appearance, camera)
        maker.renderer.render(poses[0], truths[0])
        start = time.process_time()
        for pose, truth in zip(poses[1:], truths[1:], strict=True):
            maker.renderer.render(pose, truth)
        spent = (time.process_time() - start) / frames
        maker.close()
    return {f"floor_render_cpu_s_{style}": spent}


def encoders(frames: int) -> dict[str, Value]:
    """CPU time and size of a frame's images as written, and as they might be."""
    import OpenEXR

    from pliant.generator.runner.run import generate
    from pliant.spec.dataset import Dataset
    from pliant.spec.io.exr import write_surface
    from pliant.spec.io.png import write_rgb

    record: dict[str, Value] = {}
    with _folder() as root:
        generate(_config("rope", "fast", frames, 1), root / "set")
        sequence = Dataset.open(root / "set").sequences[0]
        rgb = [sequence.rgb(frame) for frame in range(frames)]
        surface = [sequence.surface(frame) for frame in range(frames)]
        for level in (0, 1, 3, 6, 9):
            _timed(
                record,
                f"png_level_{level}",
                root / "a.png",
                [functools.partial(write_rgb, root / "a.png", image, level=level) for image in rgb],
            )
        record["floor_encode_cpu_s"] = (
            _timed(
                record,
                "exr_zip",
                root / "a.exr",
                [functools.partial(write_surface, root / "a.exr", image) for image in surface],
            )
            + float(record["cpu_ms_png_level_1"] or 0) / 1000
        )
        for name in ("NO", "RLE", "ZIPS", "PIZ", "DWAA"):
            compression = getattr(OpenEXR, f"{name}_COMPRESSION")
            _timed(
                record,
                f"exr_{name.lower()}",
                root / "a.exr",
                [
                    functools.partial(_write_exr, root / "a.exr", _channels(image), compression)
                    for image in surface
                ],
            )
        record["exr_dwaa_error_max"] = _loss(root / "a.exr", surface[-1])
    return record


def memory(style: str, frames: int) -> dict[str, Value]:
    """Resident memory of a worker after a tenth of the frames of an episode, and after all."""
    from pliant.generator.runner.sequence import SequenceMaker, resident_bytes

    config = _config("rope", style, frames, 1, width=160, height=120)
    seen: list[int] = []
    with _folder() as root:
        maker = SequenceMaker(config, root, root / "scratch")
        maker.make(SequenceTask("rope", "train", 0), lambda: seen.append(resident_bytes()))
        maker.close()
    tenth = seen[frames // 10 - 1]
    return {
        "memory_frames": frames,
        "memory_mb_after_tenth": tenth / 1e6,
        "memory_mb_after_all": seen[-1] / 1e6,
        "memory_ratio": seen[-1] / tenth,
    }


def _config(tier: str, style: str, frames: int, sequences: int, **changes: Any) -> GenerateConfig:
    return GenerateConfig(
        tiers=(tier,),
        splits={"train": sequences},
        frames=max(frames, 2),
        episodes=True,
        style=style,
        **changes,
    )


def _maker(config: GenerateConfig, root: Path) -> Any:
    return functools.partial(open_sequence_maker, config, root, root / "scratch", 1)


@contextmanager
def _one_core() -> Iterator[None]:
    """Leave one core to this process and those it starts meanwhile, where the system can."""
    if not hasattr(os, "sched_getaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


@contextmanager
def _folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="pliant-benchmark-") as folder:
        yield Path(folder)


def _timed(record: dict[str, Value], name: str, path: Path, writes: list[Any]) -> float:
    sizes = []
    start = time.process_time()
    for write in writes:
        write()
        sizes.append(path.stat().st_size)
    spent = (time.process_time() - start) / len(writes)
    record[f"cpu_ms_{name}"] = 1000 * spent
    record[f"bytes_{name}"] = float(np.mean(sizes))
    return spent


def _channels(surface: Any) -> dict[str, npt.NDArray[Any]]:
    return {
        "Z": surface.depth_m,
        "surface.m0": surface.m0,
        "surface.m1": surface.m1,
        "surface.object": surface.object_id,
    }


def _write_exr(path: Path, channels: Mapping[str, Any], compression: Any) -> None:
    import OpenEXR

    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, dict(channels), 1) as image:
        image.write(str(path))


def _loss(path: Path, surface: Any) -> float:
    """Return how far the channels of a compressed file are from what was written."""
    import OpenEXR

    worst = 0.0
    with OpenEXR.File(str(path), True, False, 1) as image:
        for name, channel in image.channels().items():
            wanted = _channels(surface)[name].astype(np.float64)
            found = channel.pixels.astype(np.float64)
            # The background's infinite depth must stay infinite: as a difference it is NaN.
            finite = np.isfinite(wanted)
            lost = not np.array_equal(finite, np.isfinite(found))
            off = np.abs(wanted[finite] - found[finite]).max(initial=0.0)
            worst = max(worst, float("inf") if lost else float(off))
    return worst


def apart(function: Any, *arguments: Any) -> dict[str, Value]:
    """Call a function in a process of its own, so that one Blender's state marks no other."""
    context = multiprocessing.get_context("spawn")
    with context.Pool(1) as pool:
        result: dict[str, Value] = pool.apply(function, arguments)
    return result


if __name__ == "__main__":
    main("generation", measure, __doc__)
