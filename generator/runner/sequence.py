"""Making one sequence: draw it, pose it, see it, render it, write it."""

from __future__ import annotations

import functools
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from itertools import chain, islice
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import psutil
from scipy.ndimage import find_objects

from pliant.generator.config import BLENDER_STYLES, GenerateConfig
from pliant.generator.objects.tiers import describe_tier, sample_scene_object
from pliant.generator.rendering import open_renderer
from pliant.generator.runner.engine import SequenceResult
from pliant.generator.runner.sequence_writer import writing_sequence
from pliant.generator.scene.appearance import Appearance, sample_appearance
from pliant.generator.scene.camera import sample_camera
from pliant.generator.scene.noise import apply_noise
from pliant.generator.scene.scene_object import Pose, SceneObject
from pliant.generator.seeding import RandomStreams, SequenceTask, Stream
from pliant.generator.truth.frame_truth import FrameTruth, frame_truth
from pliant.spec.arrays import Rgb
from pliant.spec.camera import Camera
from pliant.spec.configuration import settings_to_dict
from pliant.spec.errors import GenerationError

T = TypeVar("T")

FRAMED_POSES: Final = 32
"""Independent configurations share a camera that sees so many of them whole."""


TakenFrame = tuple[Rgb, FrameTruth, dict[str, Any]]
"""Picture (H, W, 3), truth, and the frame's entry of `sequence.json`."""


@dataclass(frozen=True)
class Shooting:
    """A sequence that is being made.

    Attributes:
        scene_object: What is seen.
        camera: The camera of all frames.
        appearance: Colours, table and light.
        frames: The frames in order, each rendered when it is taken.
    """

    scene_object: SceneObject
    camera: Camera
    appearance: Appearance
    frames: Iterator[TakenFrame]


class SequenceMaker:
    """Makes sequences with one renderer, whose scene it keeps.

    Args:
        config: The dataset's config.
        root: The dataset's folder.
        threads: Threads of the renderer.
    """

    def __init__(self, config: GenerateConfig, root: Path, *, threads: int = 1) -> None:
        self.config = config
        self.root = root
        self.renderer = open_renderer(config.style, config.size, threads, config.depth_faults)
        self._tiers: set[str] = set()  # of which a sequence was made

    def make(self, task: SequenceTask, on_frame: Callable[[], None]) -> SequenceResult:
        """Make one sequence: populate, pose, annotate, render, write.

        Args:
            task: Which sequence.
            on_frame: Called after each frame.

        Raises:
            GenerationError: No acceptable configuration was found.
            CallError: The disk is full or cannot be written.
        """
        started, cpu_started = time.perf_counter(), time.process_time()
        clock = StageClock()
        shooting = self.shoot(task, clock)
        scene_object = shooting.scene_object
        frame_info: list[dict[str, Any]] = []
        ends_cpu_s: list[float] = []
        with writing_sequence(task.folder(self.root)) as writer:
            for rgb, truth, facts in shooting.frames:
                with clock("tables"):
                    writer.add_frame(rgb, truth, shooting.camera)
                frame_info.append(facts)
                ends_cpu_s.append(time.process_time())
                on_frame()
            with clock("tables"):
                appearance = shooting.appearance
                info = sequence_info(self.config, task, scene_object, appearance, frame_info)
                size = writer.finish(info, scene_object.points)
        clock.seconds["encode"] = writer.encode_cpu_s
        warm = task.tier in self._tiers
        self._tiers.add(task.tier)
        ended = time.process_time()
        # The first frame comes with the setup, the poses of an episode too: those of independent
        # configurations are made ahead, so the camera can frame them.
        each_s = (ends_cpu_s[-1] - ends_cpu_s[0]) / max(1, len(ends_cpu_s) - 1)
        if not scene_object.temporal:
            each_s += clock.seconds["pose"] / len(ends_cpu_s)
        return SequenceResult(
            id=task.id,
            frames=scene_object.frames,
            bytes=size,
            seconds=time.perf_counter() - started,
            cpu_s=ended - cpu_started,
            stage_cpu_s=clock.seconds,
            memory_bytes=psutil.Process().memory_info().rss,
            setup_cpu_s=max(0.0, ended - cpu_started - len(ends_cpu_s) * each_s),
            warm=warm,
        )

    def shoot(self, task: SequenceTask, clock: StageClock | None = None) -> Shooting:
        """Populate a sequence and choose its camera; its frames are rendered as they are taken.

        Args:
            task: Which sequence.
            clock: Adds up the time of each stage.

        Raises:
            GenerationError: No acceptable configuration was found.
        """
        clock = clock or StageClock()
        config, streams = self.config, RandomStreams(self.config.seed, task)
        with clock("sample"):
            scene_object = sample_scene_object(config, task)
        poses = (scene_object.pose(frame) for frame in range(scene_object.frames))
        with clock("pose"):
            framed = list(islice(poses, 1 if scene_object.temporal else FRAMED_POSES))
        with clock("sample"):
            rng = streams.generator(Stream.CAMERA)
            camera = sample_camera(rng, scene_object, config.camera, config.size, framed)
            rng, look, material = streams.generator(Stream.APPEARANCE), config.look, None
            if look.materials:
                material = streams.material(look.first_material + int(rng.integers(look.materials)))
            appearance = sample_appearance(rng, scene_object, look, material)
        queried = describe_tier(config, task.tier).queried_object

        def seen() -> Iterator[tuple[Pose, FrameTruth]]:
            coming = chain(framed, poses)
            for _ in range(scene_object.frames):
                with clock("pose"):
                    pose = next(coming)
                with clock("truth"):
                    truth = frame_truth(scene_object, pose, camera)
                yield pose, truth

        def frames() -> Iterator[TakenFrame]:
            with clock("render"):
                self.renderer.begin(scene_object, appearance, camera)
            for frame, (pose, truth) in enumerate(_ahead(seen())):
                with clock("render"):
                    faults = streams.generator(Stream.DEPTH_CAMERA, frame)
                    rgb = self.renderer.render(pose, truth, rng=faults)
                if config.noise is not None:
                    with clock("noise"):
                        rng = streams.generator(Stream.NOISE, frame)
                        rgb = apply_noise(rng, rgb, truth.surface, config.noise)
                if (rgb[0] == rgb[0, 0]).all() and (rgb == rgb[0, 0]).all():
                    raise GenerationError(
                        "the picture has one colour: noise or camera faults hide the object",
                        where=f"frame {frame}",
                        fix="Reduce depth_camera or noise, or make a larger image.",
                    )
                yield rgb, truth, frame_facts(scene_object, pose, truth, queried)

        return Shooting(scene_object, camera, appearance, frames())


def sequence_info(
    config: GenerateConfig,
    task: SequenceTask,
    scene_object: SceneObject,
    appearance: Appearance,
    frame_info: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    """Return the fields of `sequence.json` that are known before its files are written."""
    parameters = {**scene_object.info, "look": appearance}
    if config.depth_faults is not None:
        parameters["depth_camera"] = config.depth_faults
    return {
        "id": task.id,
        "tier": task.tier,
        "split": task.split,
        "shape": scene_object.shape,
        "index": task.index,
        "seed": config.public_seed or 0,
        "temporal": scene_object.temporal,
        "frames": len(frame_info),
        "style": config.style,
        "noise": settings_to_dict(config.noise),
        "parameters": settings_to_dict(parameters),
        "frame_info": frame_info,
        "tools": tool_versions(config.style),
    }


@functools.cache
def tool_versions(style: str) -> dict[str, str]:
    """Return name -> version of what decides the bytes of a sequence."""
    names = ["pliant", "numpy", "numba", "pyarrow", "OpenEXR"] + ["bpy"] * (style in BLENDER_STYLES)
    found: dict[str, str] = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def frame_facts(
    scene_object: SceneObject, pose: Pose, truth: FrameTruth, queried: int
) -> dict[str, Any]:
    """Return a frame's entry of `sequence.json`: the sampler's facts and what the camera sees."""
    states = np.asarray(truth.visibility)[~scene_object.points.centreline]
    # Left, top, right and bottom: the edges of the outermost pixels, px; None if it is not seen.
    box = None
    for rows, columns in find_objects((truth.surface.object_id == queried).astype(np.uint8)):
        box = [columns.start, rows.start, columns.stop, rows.stop]
    return {
        **settings_to_dict(pose.info),
        "self_occluded": float(np.mean(states == "self_occluded")),
        "box_px": box,
    }


class StageClock:
    """CPU seconds of the calling thread, summed by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Add the CPU time of a block to a stage."""
        start = time.thread_time()
        yield
        self.seconds[stage] += time.thread_time() - start


def _ahead(items: Iterator[T]) -> Iterator[T]:
    """Yield items while the one after is computed on another thread."""
    with ThreadPoolExecutor(1, thread_name_prefix="ahead") as pool:
        coming = pool.submit(next, items, None)
        while (item := coming.result()) is not None:
            coming = pool.submit(next, items, None)
            yield item
