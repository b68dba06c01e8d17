"""The render styles: CPU seconds an image and distance from a reference of 192 samples.

cpu_s_STYLE_KIND    median CPU seconds of `Renderer.render` (640 x 480, one thread), warm
psnr_db_STYLE_KIND  peak signal-to-noise against the full frame at 192 samples, lowest of the scenes
begin_s_STYLE       CPU seconds of `Renderer.begin`, once a sequence
rss_mib_*           resident memory of a `fast` renderer after 10 frames and at the end
"""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt
from record import Value, main

from pliant.generator.objects.cloth import ClothSettings, sample_cloth
from pliant.generator.objects.rope import RopeSettings, sample_rope
from pliant.generator.rendering import open_renderer
from pliant.generator.runner.sequence import resident_bytes
from pliant.generator.scene.appearance import Appearance, AppearanceSettings, sample_appearance
from pliant.generator.scene.camera import CameraSettings, sample_camera
from pliant.generator.scene.scene_object import Pose, SceneObject
from pliant.generator.seeding import RandomStreams, SequenceTask
from pliant.generator.truth.frame_truth import FrameTruth, frame_truth
from pliant.spec.camera import Camera

SIZE = (640, 480)
STYLES = ("photo", "fast", "raster")  # what shows an appearance; `real-depth` shows none
Scene = tuple[str, SceneObject, Pose, Camera, Appearance, FrameTruth]


def scenes(quick: bool) -> list[Scene]:
    """Return scenes of a laid rope, a braid and a cloth."""

    def streams(tier: str, index: int) -> RandomStreams:
        return RandomStreams(0, SequenceTask(tier, "train", index))

    braid = RopeSettings(structure="braid", strands=8, rows=640)
    found = []
    for index in range(1 if quick else 3):
        for kind, scene_object in (
            ("rope", sample_rope(RopeSettings(), streams("rope", index))),
            ("braid", sample_rope(braid, streams("rope", 10 + index))),
            ("cloth", sample_cloth(ClothSettings(), streams("cloth-2", index))),
        ):
            pose, rng = scene_object.pose(0), np.random.default_rng(index)
            camera = sample_camera(rng, scene_object, CameraSettings(), SIZE, [pose])
            appearance = sample_appearance(rng, scene_object, AppearanceSettings())
            truth = frame_truth(scene_object, pose, camera)
            found.append((kind, scene_object, pose, camera, appearance, truth))
    return found


def references(every: list[Scene], samples: int) -> list[npt.NDArray[np.uint8]]:
    """Render the scenes with many samples and no denoiser."""
    from pliant.generator.rendering.cycles_styles import PhotoRenderer

    renderer = PhotoRenderer(SIZE, 2)
    images = []
    for _, scene_object, pose, camera, appearance, truth in every:
        renderer.begin(scene_object, appearance, camera)
        renderer.set_quality(samples, denoise=False)
        images.append(renderer.render(pose, truth))
    renderer.close()
    return images


def measure(quick: bool) -> dict[str, Value]:
    every = scenes(quick)
    wanted = references(every, 48 if quick else 192)
    record: dict[str, Value] = {"reference_samples": 48 if quick else 192}
    for style in STYLES:
        renderer = open_renderer(style, SIZE, 1, gpu=False)
        costs: dict[str, list[float]] = {}
        quality: dict[str, list[float]] = {}
        begin = []
        for (kind, scene_object, pose, camera, appearance, truth), reference in zip(
            every, wanted, strict=True
        ):
            started = time.process_time()
            renderer.begin(scene_object, appearance, camera)
            begin.append(time.process_time() - started)
            image = renderer.render(pose, truth)
            error = float(((image.astype(np.float64) - reference) ** 2).mean())
            quality.setdefault(kind, []).append(10 * np.log10(255**2 / error))
            for _ in range(3):
                started = time.process_time()
                renderer.render(pose, truth)
                costs.setdefault(kind, []).append(time.process_time() - started)
        for kind, spent in costs.items():
            record[f"cpu_s_{style}_{kind}"] = float(np.median(spent))
            record[f"psnr_db_{style}_{kind}"] = float(min(quality[kind]))
        record[f"begin_s_{style}"] = float(np.median(begin))
        if style == "fast":
            _, scene_object, pose, camera, appearance, truth = every[0]
            renderer.begin(scene_object, appearance, camera)
            for frame in range(20 if quick else 300):
                renderer.render(pose, truth)
                if frame == 9:
                    record["rss_mib_after_10"] = resident_bytes() / 2**20
            record["rss_mib_at_end"] = resident_bytes() / 2**20
        renderer.close()
    return record


if __name__ == "__main__":
    main("styles", measure, __doc__)
