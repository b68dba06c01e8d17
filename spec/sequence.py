"""One sequence of a dataset and its frames; files are read on first access."""

from __future__ import annotations

import hashlib
import operator
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.calls import check_whole
from pliant.spec.camera import Camera
from pliant.spec.decoded import Decoded, decoded_images
from pliant.spec.errors import SpecError
from pliant.spec.frame import Frame
from pliant.spec.io.exr import Surface, read_camera_depth, read_surface
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.io.parquet import open_table, read_table
from pliant.spec.io.parquet_columns import load_columns, load_rows, rows_in_order
from pliant.spec.io.png import read_mask, read_rgb
from pliant.spec.io.reading import AnyFile
from pliant.spec.lru_cache import LRUCache
from pliant.spec.model import DISTRACTOR, Tier
from pliant.spec.storage import layout
from pliant.spec.storage.files import Files
from pliant.spec.tables import CORRESPONDENCES


@dataclass(frozen=True, repr=False)
class SequenceRecord:
    """One sequence of a dataset; its files are read when they are asked for.

    Attributes:
        id: Its name, unique in the dataset.
        tier: Name of its tier.
        described: Its tier as the dataset describes it.
        split: The split it belongs to.
        shape: Named shape of the object, or None.
        frames: Number of frames.
        temporal: True for an episode.
        root: The folder of its dataset.
        size: (width, height) of its images.
        files: Where its files come from.
        decoded: The images that its frames keep, shared with the dataset's other sequences.
    """

    id: str
    tier: str
    described: Tier
    split: str
    shape: str | None
    frames: int
    temporal: bool
    root: Path
    size: tuple[int, int]
    files: Files = field(repr=False, compare=False)
    decoded: LRUCache[Decoded] = field(default_factory=decoded_images, repr=False, compare=False)

    made_whole: ClassVar[bool] = False
    """Whether all frames cost no more than one: a simulated sequence."""

    def __len__(self) -> int:
        return self.frames

    def __getitem__(self, frame: int) -> RecordedFrame:
        """Return a frame; negative indices count from the end.

        Raises:
            IndexError: The sequence has no such frame.
        """
        try:
            return RecordedFrame(self, range(self.frames)[operator.index(frame)])
        except IndexError:
            raise IndexError(f"{self.id} has {self.frames} frames, and no frame {frame}") from None

    def __iter__(self) -> Iterator[RecordedFrame]:
        return (RecordedFrame(self, frame) for frame in range(self.frames))

    def __repr__(self) -> str:
        kind = "episode" if self.temporal else "sequence"
        return f"SequenceRecord({self.id!r}, {kind} of {self.frames} frames, {self.split})"

    @property
    def dir(self) -> Path:
        """Its folder, or where it would be if the dataset were not packed."""
        return self.root / layout.sequence_name(self.tier, self.id)

    def has(self, name: str) -> bool:
        """Return whether the sequence has a file, such as `depth/000000.exr`."""
        return self.files.has(f"{layout.sequence_name(self.tier, self.id)}/{name}")

    def file(self, name: str) -> AnyFile:
        """Return a file of the sequence's folder, to be given to a reader."""
        return self.files.get(f"{layout.sequence_name(self.tier, self.id)}/{name}")

    @cached_property
    def info(self) -> dict[str, Any]:
        """The sequence's `sequence.json`."""
        document: dict[str, Any] = read_json(self.file(layout.SEQUENCE_JSON), "sequence")
        return document

    @cached_property
    def has_cameras(self) -> bool:
        """Whether the cameras are available; a withheld split has none."""
        return self.has(layout.CAMERAS_JSON)

    @cached_property
    def _cameras(self) -> list[Camera]:
        path = self.file(layout.CAMERAS_JSON)
        frames = read_json(path, "cameras")["frames"]
        if [camera["frame"] for camera in frames] != list(range(self.frames)):
            raise SpecError(
                "the cameras are not one per frame, in order", path=path, where="frames"
            )
        return [
            Camera(_constant(each["K"]), _constant(each["world_to_camera"]), self.size)
            for each in frames
        ]

    def camera(self, frame: int) -> Camera:
        """Return a frame's camera.

        Args:
            frame: 0 to frames - 1.
        """
        self._check(frame)
        return self._cameras[frame]

    def rgb(self, frame: int) -> npt.NDArray[np.uint8]:
        """Return a frame's colour image, uint8 (H, W, 3), sRGB."""
        self._check(frame)
        return read_rgb(self.file(layout.rgb_name(frame)), size=self.size)

    def surface(self, frame: int) -> Surface:
        """Return a frame's depth and surface image."""
        self._check(frame)
        return read_surface(self.file(layout.depth_name(frame)), size=self.size)

    def object_ids(self, frame: int) -> npt.NDArray[np.uint8]:
        """Return a frame's mask where no surface is known, uint8 (H, W), 0 for no object."""
        self._check(frame)
        return read_mask(self.file(layout.mask_name(frame)), size=self.size)

    def camera_depth(self, frame: int) -> npt.NDArray[np.float32]:
        """Return a frame's depth where no surface is known, float32 (H, W), metres."""
        self._check(frame)
        return read_camera_depth(self.file(layout.camera_depth_name(frame)), size=self.size)

    def points(self) -> pa.Table:
        """Return the table of material points."""
        return read_table(self.file(layout.POINTS_TABLE), "points")

    def correspondences(self, frame: int | None = None) -> pa.Table:
        """Return where the points are, of one frame or of all.

        Args:
            frame: 0 to frames - 1; None for the whole table.

        Returns:
            The correspondences table; of one frame, row i is point i.

        Raises:
            SpecError: A row is missing or in another place.
        """
        path = self.file(layout.CORRESPONDENCES_TABLE)
        file = open_table(path)
        rows, count = file.metadata.num_rows, self._point_count
        if rows != self.frames * count:
            raise SpecError(
                "the table does not contain every point of every frame",
                path=path,
                found=f"{rows} rows",
                required=f"{self.frames * count}: {self.frames} frames of {count} points",
            )
        if frame is None:
            return rows_in_order(
                load_columns(file, path, CORRESPONDENCES), range(self.frames), path
            )
        self._check(frame)
        rows_of_frame = frame * count, (frame + 1) * count
        table = load_rows(file, path, CORRESPONDENCES, *rows_of_frame)
        return rows_in_order(table, range(frame, frame + 1), path)

    @cached_property
    def _point_count(self) -> int:
        """The number of rows of the table of points."""
        count: int = open_table(self.file(layout.POINTS_TABLE)).metadata.num_rows
        return count

    def _check(self, frame: int) -> None:
        check_whole(f"{self.id}, frame", frame, 0, self.frames - 1)


class RecordedFrame(Frame):
    """A frame of a dataset, its images read when asked for, and its ground truth.

    Decoded images are kept, up to `DECODED_BYTES` in all frames of the dataset, and cannot be
    written to. Tables are read again each time.

    Args:
        sequence: The sequence it belongs to.
        index: Its number in the sequence, from 0.

    Examples:
        >>> frame = pliant.load("sample").frame("rope-test-000000", 1)
        >>> frame.key, frame.surface.depth_m.shape
        ('rope-test-000000/1', (192, 256))
    """

    def __init__(self, sequence: SequenceRecord, index: int) -> None:
        self.__dict__.update(sequence=sequence, index=index)

    sequence: SequenceRecord
    index: int

    @property
    def key(self) -> str:
        """`SEQUENCE/INDEX`: a name that is unique in the dataset."""
        return f"{self.sequence.id}/{self.index}"

    @property
    def cache_key(self) -> str:
        """A digest of its folder, and its key: frames of two datasets may have one key."""
        folder = hashlib.blake2b(str(self.sequence.dir).encode(), digest_size=8).hexdigest()
        return f"{folder}/{self.key}"

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return self.sequence.size

    @property
    def rgb(self) -> npt.NDArray[np.uint8]:
        """Colour image, uint8 (H, W, 3), sRGB."""
        name = layout.rgb_name(self.index)
        kept = self._kept(name, lambda: (self.sequence.rgb(self.index),))
        return kept[0] if kept else self.sequence.rgb(self.index)  # which says what is missing

    @property
    def has_surface(self) -> bool:
        """Whether the surface image is available; a withheld split has none."""
        return self.sequence.has(layout.depth_name(self.index))

    @property
    def surface(self) -> Surface | None:
        """Depth, object ids and material coordinates per pixel, or None if withheld."""

        def decode() -> Decoded:
            read = self.sequence.surface(self.index)
            return read.depth_m, read.m0, read.m1, read.object_id

        kept = self._kept(layout.depth_name(self.index), decode)
        return Surface(*kept) if kept else None

    @property
    def object_ids(self) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint32] | None:
        """Which object each pixel shows, (H, W), 0 for none; None if not known."""
        surface = self.surface
        if surface is not None:
            return surface.object_id
        name = layout.mask_name(self.index)
        kept = self._kept(name, lambda: (self.sequence.object_ids(self.index),))
        return kept[0] if kept else None

    @property
    def mask(self) -> npt.NDArray[np.bool_] | None:
        """Where the queried object is visible, bool (H, W), or None if not known."""
        ids = self.object_ids
        return None if ids is None else self.queried_in(ids)

    @property
    def objects(self) -> npt.NDArray[np.bool_] | None:
        """Where any object but a distractor is visible, bool (H, W), or None if not known."""
        ids = self.object_ids
        return None if ids is None else self.objects_in(ids)

    @property
    def depth_m(self) -> npt.NDArray[np.float32] | None:
        """Planar depth, float32 (H, W), metres, +inf is background, or None if not known."""
        surface = self.surface
        if surface is not None:
            return surface.depth_m
        name = layout.camera_depth_name(self.index)
        kept = self._kept(name, lambda: (self.sequence.camera_depth(self.index),))
        return kept[0] if kept else None

    @property
    def camera(self) -> Camera | None:
        """Intrinsics and pose, or None if withheld."""
        return self.sequence.camera(self.index) if self.sequence.has_cameras else None

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

    def objects_in(
        self, object_ids: npt.NDArray[np.uint8] | npt.NDArray[np.uint32]
    ) -> npt.NDArray[np.bool_]:
        """Return where object ids are those of any object but a distractor, bool (H, W)."""
        shown: npt.NDArray[np.bool_] = object_ids > 0
        for each in self.sequence.described.objects:
            if each.name.startswith(DISTRACTOR):
                shown &= object_ids != each.id
        return shown

    def _kept(self, name: str, decode: Callable[[], Decoded]) -> Decoded:
        """Return the images of one of the sequence's files; none where it is withheld."""

        def constant() -> Decoded:
            arrays = decode() if self.sequence.has(name) else ()
            for array in arrays:
                array.flags.writeable = False
            return arrays

        return self.sequence.decoded.get(f"{self.sequence.id}/{name}", constant)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RecordedFrame) and (self.sequence, self.index) == (
            other.sequence,
            other.index,
        )

    def __hash__(self) -> int:
        return hash((self.sequence.id, self.index))


def _constant(values: Any) -> npt.NDArray[np.float64]:
    array = np.array(values, np.float64)
    array.flags.writeable = False
    return array
