"""What checking a sequence gives to the rules above: its problems, and what identifies frames."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.cameras import Cameras
from pliant.spec.validation.rules.correspondences import FrameRows

SHAPE_POINTS: Final = 512
"""About so many points, spread over the table, stand for the shape."""


@dataclass
class FrameKeys:
    """What identifies the frames of a sequence.

    Attributes:
        pictures: uint64 each, digest of the decoded colour pixels; 0 for a blank picture.
        shapes: float64 (6,) each, mean and spread of the points in the camera's axes, metres.
        depths: uint64 each, digest of the decoded depth image.
    """

    pictures: dict[int, int] = field(default_factory=dict)
    shapes: dict[int, FloatArray] = field(default_factory=dict)
    depths: dict[int, int] = field(default_factory=dict)


def digest_of(pixels: npt.NDArray[Any]) -> int:
    """Return 63 bits that differ where pixels differ."""
    data = np.ascontiguousarray(pixels).data
    return int.from_bytes(hashlib.sha256(data).digest()[:8], "little") >> 1


def shape_key(cameras: Cameras, rows: FrameRows) -> FloatArray:
    """Return mean and spread of points of a frame in the camera's axes, float64 (6,), metres."""
    pose = cameras.world_to_camera[rows.frame]
    local = rows.xyz_m[:: 1 + len(rows.xyz_m) // SHAPE_POINTS] @ pose[:3, :3].T + pose[:3, 3]
    return np.concatenate([local.mean(axis=0), local.std(axis=0)])


@dataclass
class SequenceResult:
    """What checking a sequence gives to the rules above it.

    Attributes:
        id: The sequence.
        tier: The folder of its tier.
        split: Its split, None if its sequence.json is not readable.
        frames: Its frames, 0 likewise.
        findings: Its problems.
        points_digest: Hash of its point table, None if that is not sound.
        temporal: True for an episode.
        keys: What identifies each frame.
        boxes_px: float32 (F,), longer side of the queried object's visible box; NaN unknown.
        tables_sound: True if queries can be checked against its tables.
    """

    id: str
    tier: str
    split: str | None = None
    frames: int = 0
    findings: Findings = field(default_factory=Findings)
    points_digest: bytes | None = None
    temporal: bool = False
    keys: FrameKeys = field(default_factory=FrameKeys)
    boxes_px: npt.NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    tables_sound: bool = False
