"""Which layers and views two frames lack: imported and withheld frames have fewer files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from pliant.spec.queries import RecordedPair
from pliant.spec.sequence import RecordedFrame, SequenceRecord
from pliant.spec.storage import layout

NO_SCENE: Final = "3D needs tracked points and cameras, which the dataset does not have here"

_NO_DEPTH: Final = "the dataset does not have depth here"
_NO_INDEX: Final = "index colours need surface images, which the dataset does not have here"
_NO_MASK: Final = "the dataset does not have masks here"
_NO_ERROR: Final = (
    "the error map needs the true place of every pixel (surface images), which the dataset does "
    "not have here"
)


def missing(pair: RecordedPair) -> dict[str, str]:
    """Return what two frames lack: a layer or `scene` -> the reason, as text for the page."""
    frames = (pair.source, pair.target)
    found = {
        "depth": (_NO_DEPTH, all(_has(each, layout.camera_depth_name) for each in frames)),
        "index": (_NO_INDEX, all(each.has_surface for each in frames)),
        "mask": (_NO_MASK, all(_has(each, layout.mask_name) for each in frames)),
        "error": (_NO_ERROR, all(each.has_surface for each in frames)),
        "scene": (NO_SCENE, all(has_scene(each.sequence) for each in frames)),
    }
    return {name: reason for name, (reason, there) in found.items() if not there}


def has_scene(sequence: SequenceRecord) -> bool:
    """Return whether a sequence has what the 3D view shows."""
    tables = (layout.POINTS_TABLE, layout.CORRESPONDENCES_TABLE)
    return sequence.has_cameras and all(sequence.has(name) for name in tables)


def _has(frame: RecordedFrame, name: Callable[[int], str]) -> bool:
    return frame.has_surface or frame.sequence.has(name(frame.index))
