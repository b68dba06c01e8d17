"""Frames that are there twice: in two splits, or twice in one.

Compared is what the files say, not their bytes, so that another encoder hides nothing: the decoded
pixels, and the positions of the points before the camera to the micrometre.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pliant.spec.storage import layout
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.result import SequenceResult

SAME_M: Final = 1e-6


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
        step = 1
        while step < len(order):
            near = shapes[step:, 0] - shapes[:-step, 0] <= SAME_M
            if not near.any() or step > 64:
                break
            same = np.abs(shapes[step:] - shapes[:-step]).max(axis=1) <= SAME_M
            for row in np.flatnonzero(same):
                pair = sorted((places[order[row]], places[order[row + step]]))
                found.add((*pair[0], *pair[1]))
            step += 1
    return found
