"""Rules of cameras.json: one camera per frame, each a camera indeed."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.spec.camera import Camera
from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.context import Context

ROTATION_TOLERANCE = 1e-6


def check_cameras(
    context: Context, document: dict[str, Any], frames: int, problems: FileProblems
) -> list[Camera] | None:
    """Check the cameras of a sequence.

    Args:
        context: The dataset.
        document: The cameras.json, valid by its schema.
        frames: Frames of the sequence.
        problems: Gets `CAMERA_INVALID` and `IDENTITY_DIFFERS`.

    Returns:
        The cameras if all of them are good.
    """
    before = problems.total
    width, height = size = (document["width"], document["height"])
    if size != context.size:
        problems.add(
            "IDENTITY_DIFFERS",
            "width, height",
            f"found {width} x {height}; dataset.json has {context.size[0]} x {context.size[1]}",
        )
    numbers = [entry["frame"] for entry in document["frames"]]
    if numbers != list(range(frames)):
        problems.add(
            "CAMERA_INVALID",
            "frames",
            f"required: frames 0 to {frames - 1}, each once, in order; found {len(numbers)} "
            f"entries from {numbers[0]} to {numbers[-1]}",
        )
        return None
    K = np.array([entry["K"] for entry in document["frames"]], np.float64)
    poses = np.array([entry["world_to_camera"] for entry in document["frames"]], np.float64)
    fixed = K[:, [0, 1, 2, 2, 2], [1, 0, 0, 1, 2]] != np.array([0, 0, 0, 0, 1.0])
    problems.add_rows(
        "CAMERA_INVALID",
        np.any(fixed, axis=1) | (K[:, 0, 0] <= 0) | (K[:, 1, 1] <= 0),
        lambda i: (
            f"frames[{i}].K",
            f"required: [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], fx, fy > 0; found {K[i].tolist()}",
        ),
    )
    R = poses[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        gap = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        determinant = np.linalg.det(R)
    turned = ~((gap <= ROTATION_TOLERANCE) & (determinant > 0))
    last = np.any(poses[:, 3] != np.array([0, 0, 0, 1.0]), axis=1)
    problems.add_rows(
        "CAMERA_INVALID",
        turned | last,
        lambda i: (
            f"frames[{i}].world_to_camera",
            "required: a rotation (right-handed, orthonormal to 1e-6), a translation, and the "
            "last row 0 0 0 1",
        ),
    )
    if problems.total != before:
        return None
    return [Camera(K[i], poses[i], size) for i in range(frames)]
