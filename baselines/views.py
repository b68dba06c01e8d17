"""The frames of a dataset as methods see them."""

from __future__ import annotations

from dataclasses import replace

from pliant.baselines.lru_cache import LRUCache
from pliant.baselines.matcher import View
from pliant.spec.frame import Frame


class ViewReader:
    """Reads frames as views and keeps the last few.

    A frame without a surface image has the mask and the depth that were recorded with it, if any.

    Args:
        capacity: Number of frames kept.
        masks: Whether the views have masks; without, a method sees the image and the depth alone.
    """

    def __init__(self, capacity: int = 4, *, masks: bool = True) -> None:
        self._views: LRUCache[View] = LRUCache(capacity)
        self._masks = masks

    def view(self, frame: Frame) -> View:
        """Return a frame's view.

        Raises:
            SpecError: One of the frame's files is damaged.
            CallError: The sequence has no such frame.
        """
        return self._views.get(frame.key, lambda: self._read(frame))

    def _read(self, frame: Frame) -> View:
        view = read_view_of(frame)
        return view if self._masks else replace(view, mask=None, objects=None)


def read_view_of(frame: Frame) -> View:
    """Return a frame as a method sees it; see `ViewReader`."""
    surface = frame.surface
    ids = frame.object_ids if surface is None else surface.object_id
    return View(
        rgb=frame.rgb,
        mask=None if ids is None else frame.queried_in(ids),
        depth_m=frame.depth_m if surface is None else surface.depth_m,
        key=frame.key,
        objects=None if ids is None else ids > 0,
    )
