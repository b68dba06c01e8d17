"""What checking a sequence gives to the rules above: its problems, and what identifies frames."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.camera import Camera
from pliant.spec.storage import layout
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.correspondences import FrameRows

SAME_M: Final = 1e-6

MAX_NEIGHBOURS: Final = 64
"""So many shapes are compared with each, next to it in the order of their first numbers: a bound
on the work where very many have the same one."""

SHAPE_POINTS: Final = 512
"""About so many points, spread over the table, stand for the shape."""


@dataclass
class FrameKeys:
    """What identifies the frames of a sequence.

    Attributes:
        pictures: uint64 each, digest of the decoded colour pixels; 0 for a blank picture.
        shapes: float64 (15,) each, what `shape_key` returns, metres.
        depths: uint64 each, digest of the decoded depth image.
    """

    pictures: dict[int, int] = field(default_factory=dict)
    shapes: dict[int, FloatArray] = field(default_factory=dict)
    depths: dict[int, int] = field(default_factory=dict)


def digest_of(pixels: npt.NDArray[Any]) -> int:
    """Return 63 bits that differ where pixels differ."""
    data = np.ascontiguousarray(pixels).data
    return int.from_bytes(hashlib.sha256(data).digest()[:8], "little") >> 1


def shape_key(camera: Camera, rows: FrameRows) -> FloatArray:
    """Return mean, spread and three points of a frame in the camera's axes, float64 (15,), metres.

    The three points tell an object from the same object turned to where its outline coincides.
    """
    local = camera.to_camera(rows.xyz_m[:: 1 + len(rows.xyz_m) // SHAPE_POINTS])
    some = local[[0, len(local) // 3, 2 * len(local) // 3]]
    return np.concatenate([local.mean(axis=0), local.std(axis=0), some.ravel()])


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


def compare_frames(sequences: list[SequenceResult], findings: Findings) -> None:
    """Compare all frames of a dataset with each other.

    Args:
        sequences: Every sequence that has a split.
        findings: Gets `SPLIT_SHARED` (frames of two splits) and `FRAME_REPEATED` (of one).
    """
    pairs: dict[str, set[tuple[int, int, int, int]]] = {
        "the same colour pixels": _same_numbers([s.keys.pictures for s in sequences]),
        "the same depth and surface pixels": _same_numbers([s.keys.depths for s in sequences]),
        "the same point positions before the camera": _same_shapes(sequences),
    }
    shared: dict[tuple[str, str], dict[str, list[str]]] = {}
    repeated: dict[str, list[str]] = {}
    for what, found in pairs.items():
        for first, frame_a, second, frame_b in sorted(found):
            a, b = sequences[first], sequences[second]
            if first == second and (a.temporal or frame_a == frame_b):
                continue
            text = f"{a.id} frame {frame_a} and {b.id} frame {frame_b}"
            if a.split != b.split:
                splits = (str(a.split), str(b.split))
                shared.setdefault(splits, {}).setdefault(what, []).append(text)
            else:
                repeated.setdefault(what, []).append(text)
    for (one, other), whats in sorted(shared.items()):
        text = "; ".join(f"{len(each)} pairs of frames have {what}" for what, each in whats.items())
        example = next(iter(whats.values()))[0]
        findings.add(
            "SPLIT_SHARED", layout.SEQUENCES_TABLE, f"{one}, {other}", f"{text}: {example}"
        )
    for what, each in repeated.items():
        findings.add(
            "FRAME_REPEATED",
            layout.SEQUENCES_TABLE,
            "",
            f"{len(each)} pairs of frames of one split have {what}, such as {each[0]}",
        )


def _same_numbers(keys: list[dict[int, int]]) -> set[tuple[int, int, int, int]]:
    """Return pairs (sequence, frame, sequence, frame) of equal keys: each with the first one."""
    first: dict[int, tuple[int, int]] = {}
    found = set()
    for index, frames in enumerate(keys):
        for frame, key in frames.items():
            if key == 0:
                continue
            place = first.setdefault(key, (index, frame))
            if place != (index, frame):
                found.add((*place, index, frame))
    return found


def _same_shapes(sequences: list[SequenceResult]) -> set[tuple[int, int, int, int]]:
    """Return pairs of frames of one tier whose points agree to a micrometre."""
    found = set()
    for tier in {sequence.tier for sequence in sequences}:
        places = [
            (index, frame)
            for index, sequence in enumerate(sequences)
            if sequence.tier == tier
            for frame in sequence.keys.shapes
        ]
        if len(places) < 2:
            continue
        shapes = np.array([sequences[index].keys.shapes[frame] for index, frame in places])
        order = np.argsort(shapes[:, 0], kind="stable")
        shapes = shapes[order]
        for step in range(1, min(len(order), MAX_NEIGHBOURS + 1)):
            near = shapes[step:, 0] - shapes[:-step, 0] <= SAME_M
            if not near.any():
                break
            same = np.abs(shapes[step:] - shapes[:-step]).max(axis=1) <= SAME_M
            for row in np.flatnonzero(same):
                pair = sorted((places[order[row]], places[order[row + step]]))
                found.add((*pair[0], *pair[1]))
    return found
