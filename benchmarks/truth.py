"""The truth of a frame: its cost, and how it compares with Cycles' passes and with its own files.

raster_ms_*             CPU ms of `frame_truth`: surface image, projection, visibility (640 x 480)
cycles_pass_ms_*        CPU ms of Cycles' depth and object passes of the same frames, warm
id_mismatch_px          pixels whose object differs from Cycles', over all frames
depth_error_max_m       largest difference of depth from Cycles' where the objects agree
depth_errors_over_1e5   pixels whose depth differs by more than 1e-5 m
reprojection_error_max_px  table's position (float32) through the camera file, against the table's
"""

from __future__ import annotations

import numpy as np
from cycles_passes import PassRenderer, compare_with_cycles
from record import Value, cpu_s, main

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.tiers import sample_scene_object
from pliant.generator.scene.camera import CameraSettings, sample_camera
from pliant.generator.seeding import SequenceTask
from pliant.generator.truth.frame_truth import frame_truth

SIZE = (640, 480)


def measure(quick: bool) -> dict[str, Value]:
    renderer = PassRenderer(SIZE)
    pixels = frames = mismatches = depth_errors = 0
    depth_error = reprojection = 0.0
    record: dict[str, Value] = {}
    cloths = ["cloth-1", "cloth-2", "cloth-3"]
    for name, tiers in (("rope", ["rope"] * (6 if quick else 40)), ("cloth", cloths)):
        raster_ms, cycles_ms = [], []
        for index, tier in enumerate(tiers):
            config, task = GenerateConfig(tiers=(tier,)), SequenceTask(tier, "train", index)
            scene_object = sample_scene_object(config, task)
            pose = scene_object.pose(0)
            for view in range(1 if quick else 4):
                rng = np.random.default_rng([index, view])
                camera = sample_camera(rng, scene_object, CameraSettings(), SIZE, [pose])
                truth = frame_truth(scene_object, pose, camera)
                raster_s = [
                    cpu_s(lambda: frame_truth(scene_object, pose, camera))  # noqa: B023
                    for _ in range(5)
                ]
                raster_ms.append(1e3 * float(np.median(raster_s)))
                found = compare_with_cycles(renderer, scene_object, truth, camera)
                cycles_ms.append(1e3 * found.cycles_cpu_s)
                mismatches += found.id_mismatch_px
                depth_errors += found.depth_errors
                depth_error = max(depth_error, found.depth_error_max_m)
                pixels += int((truth.surface.object_id > 0).sum())
                frames += 1
                stored = truth.xyz_m.astype(np.float32).astype(np.float64)
                off = camera.project(stored)[:, :2] - truth.uv_px.astype(np.float32)
                reprojection = max(reprojection, float(np.abs(off).max()))
        record[f"raster_ms_{name}"] = float(np.median(raster_ms))
        record[f"cycles_pass_ms_{name}"] = float(np.median(cycles_ms))
    record |= {
        "id_mismatch_px": mismatches,
        "depth_error_max_m": depth_error,
        "depth_errors_over_1e5": depth_errors,
        "reprojection_error_max_px": reprojection,
        "frames": frames,
        "object_pixels": pixels,
    }
    return record


if __name__ == "__main__":
    main("truth", measure, __doc__)
