"""The frames of a dataset as methods see them."""

from __future__ import annotations

from pliant.baselines.lru_cache import LRUCache
from pliant.baselines.matcher import View
from pliant.spec.dataset import Dataset
from pliant.spec.storage.layout import depth_name


class ViewReader:
    """Reads frames as views, and remembers the last few.

    The mask is where the tier's queried object is seen, taken from the frame's surface
    layer; a frame published without one has neither mask nor depth.

    Args:
        dataset: The dataset.
        capacity: Frames remembered.
    """

    def __init__(self, dataset: Dataset, capacity: int = 4) -> None:
        self._dataset = dataset
        self._views: LRUCache[View] = LRUCache(capacity)

    def view(self, sequence_id: str, frame: int) -> View:
        """Return one frame.

        Args:
            sequence_id: Id of its sequence.
            frame: Its index.

        Raises:
            SpecError: There is no such sequence, or one of the frame's files is broken.
            CallError: The sequence has no such frame.
        """
        key = f"{sequence_id}/{frame}"
        return self._views.get(key, lambda: self._read(sequence_id, frame, key))

    def _read(self, sequence_id: str, frame: int, key: str) -> View:
        sequence = self._dataset.sequence(sequence_id)
        rgb = sequence.rgb(frame)
        if not sequence.has(depth_name(frame)):
            return View(rgb=rgb, key=key)
        surface = sequence.surface(frame)
        return View(
            rgb=rgb,
            mask=surface.object_id == sequence.described.queried_object,
            depth_m=surface.depth_m,
            key=key,
            objects=surface.object_id > 0,
        )
