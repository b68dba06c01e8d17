"""The frames of a dataset as methods see them."""

from __future__ import annotations

from pliant.baselines.lru_cache import LRUCache
from pliant.baselines.matcher import View
from pliant.spec.frame import Frame


class ViewReader:
    """Reads frames as views and keeps the last few.

    A frame that was published without its surface image has neither masks nor depth.

    Args:
        capacity: Number of frames kept.
    """

    def __init__(self, capacity: int = 4) -> None:
        self._views: LRUCache[View] = LRUCache(capacity)

    def view(self, frame: Frame) -> View:
        """Return a frame's view.

        Raises:
            SpecError: One of the frame's files is damaged.
            CallError: The sequence has no such frame.
        """
        return self._views.get(frame.key, lambda: read_view_of(frame))


def read_view_of(frame: Frame) -> View:
    """Return a frame as a method sees it; see `ViewReader`."""
    rgb, surface = frame.rgb, frame.surface
    if surface is None:
        return View(rgb=rgb, key=frame.key)
    return View(
        rgb=rgb,
        mask=frame.queried_in(surface),
        depth_m=surface.depth_m,
        key=frame.key,
        objects=surface.object_id > 0,
    )
