"""Frames of a dataset by their address, and the files of the last few, kept in memory."""

from __future__ import annotations

import re
from typing import Final

from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.lru_cache import LRUCache
from pliant.spec.point_mesh import PosedMesh, PosedPoints
from pliant.spec.sequence import RecordedFrame
from pliant.spec.surface_search import SurfaceSearch

_NUMBER: Final = re.compile("[0-9]{1,9}")
_KEPT_FRAMES: Final = 8
_KEPT_POSES: Final = 64


class FrameCache:
    """Reads frames and keeps the last few; safe to use from several threads.

    Args:
        dataset: The dataset.
    """

    def __init__(self, dataset: Dataset) -> None:
        self.dataset = dataset
        self._sequences = {each.id: each for each in dataset.sequences}
        self._searches: LRUCache[SurfaceSearch | None] = LRUCache(_KEPT_FRAMES)
        self._meshes: LRUCache[PosedMesh] = LRUCache(_KEPT_FRAMES)
        self._poses: LRUCache[PosedPoints] = LRUCache(_KEPT_POSES)

    def frame(self, key: str) -> RecordedFrame:
        """Return a frame by its key, `SEQUENCE/INDEX`.

        Raises:
            CallError: The dataset has no such frame. A key is looked up and never becomes a path.
        """
        name, _, index = key.rpartition("/")
        sequence = self._sequences.get(name)
        known = sequence is not None and _NUMBER.fullmatch(index) is not None
        if sequence is None or not known or int(index) >= sequence.frames:
            raise CallError("the dataset has no such frame", found=repr(key)[:100])
        return RecordedFrame(sequence, int(index))

    def search(self, frame: RecordedFrame) -> SurfaceSearch | None:
        """Return what finds material points in a frame, or None without a surface image."""

        def make() -> SurfaceSearch | None:
            surface = frame.surface
            queried = frame.sequence.described.queried
            return None if surface is None else SurfaceSearch(queried, surface)

        return self._searches.get(frame.cache_key, make)

    def mesh(self, frame: RecordedFrame) -> PosedMesh:
        """Return the mesh of the tracked points of a frame's sequence."""
        return self._meshes.get(frame.sequence.id, lambda: PosedMesh.of(frame.sequence))

    def points(self, frame: RecordedFrame) -> PosedPoints:
        """Return where the tracked points of a frame are."""
        return self._poses.get(frame.cache_key, lambda: PosedPoints.of(frame, self.mesh(frame)))
