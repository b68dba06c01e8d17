"""One frame of a sequence: its images, camera and ground truth, read when asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.io.exr import Surface
from pliant.spec.storage.layout import camera_depth_name, depth_name, mask_name

if TYPE_CHECKING:
    from pliant.spec.sequence import SequenceRecord


@dataclass(frozen=True)
class Frame:
    """One frame of a sequence. Every attribute reads its file again and keeps nothing.

    Attributes:
        sequence: The sequence it belongs to.
        index: Its number in the sequence, from 0.
    """

    sequence: SequenceRecord
    index: int

    @property
    def key(self) -> str:
        """`SEQUENCE/INDEX`: a name that is unique in the dataset."""
        return f"{self.sequence.id}/{self.index}"

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return self.sequence.size

    @property
    def has_surface(self) -> bool:
        """Whether depth and masks are available; a withheld split has colour images only."""
        return self.sequence.has(depth_name(self.index))

    @property
    def rgb(self) -> npt.NDArray[np.uint8]:
        """Colour image, uint8 (H, W, 3), sRGB."""
        return self.sequence.rgb(self.index)

    @property
    def surface(self) -> Surface | None:
        """Depth, object ids and material coordinates per pixel, or None if withheld."""
        return self.sequence.surface(self.index) if self.has_surface else None

    @property
    def mask(self) -> npt.NDArray[np.bool_] | None:
        """Where the queried object is visible, bool (H, W), or None if not known."""
        ids = self.object_ids
        return None if ids is None else self.queried_in(ids)

    @property
    def object_ids(self) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint32] | None:
        """Which object each pixel shows, (H, W), 0 for none; None if not known."""
        if self.has_surface:
            return self.sequence.surface(self.index).object_id
        masked = self.sequence.has(mask_name(self.index))
        return self.sequence.object_ids(self.index) if masked else None

    @property
    def depth_m(self) -> npt.NDArray[np.float32] | None:
        """Planar depth, float32 (H, W), metres, +inf is background, or None if not known."""
        if self.has_surface:
            return self.sequence.surface(self.index).depth_m
        measured = self.sequence.has(camera_depth_name(self.index))
        return self.sequence.camera_depth(self.index) if measured else None

    @property
    def camera(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """K float64 (3, 3), pixels; world_to_camera float64 (4, 4), metres."""
        return self.sequence.camera(self.index)

    @property
    def correspondences(self) -> pa.Table:
        """Where every material point is in this frame; row i is point i."""
        return self.sequence.correspondences(self.index)

    def queried_in(
        self, object_ids: npt.NDArray[np.uint8] | npt.NDArray[np.uint32]
    ) -> npt.NDArray[np.bool_]:
        """Return where object ids are those of the queried object, bool (H, W)."""
        mask: npt.NDArray[np.bool_] = object_ids == self.sequence.described.queried_object
        return mask

    def __repr__(self) -> str:
        return f"Frame({self.key!r}, {self.size[0]}x{self.size[1]})"
