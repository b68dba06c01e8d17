"""One sequence of a dataset and its frames; files are read when they are asked for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.errors import CallError, SpecError
from pliant.spec.frame import Frame
from pliant.spec.io.exr import Surface, read_camera_depth, read_surface
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.io.parquet import open_table, read_table
from pliant.spec.io.parquet_columns import load_columns, load_rows
from pliant.spec.io.png import read_mask, read_rgb
from pliant.spec.io.reading import AnyFile
from pliant.spec.model import Tier
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
        dir: Its folder, or where it would be if the dataset were not packed.
        size: (width, height) of its images.
        files: Where its files come from.
    """

    id: str
    tier: str
    described: Tier
    split: str
    shape: str | None
    frames: int
    temporal: bool
    dir: Path
    size: tuple[int, int]
    files: Files = field(repr=False, compare=False)

    def __len__(self) -> int:
        return self.frames

    def __getitem__(self, frame: int) -> Frame:
        """Return a frame; negative indices count from the end.

        Raises:
            IndexError: The sequence has no such frame.
        """
        return Frame(self, range(self.frames)[frame])

    def __iter__(self) -> Iterator[Frame]:
        return (Frame(self, frame) for frame in range(self.frames))

    def __repr__(self) -> str:
        kind = "episode" if self.temporal else "sequence"
        return f"SequenceRecord({self.id!r}, {kind} of {self.frames} frames, {self.split})"

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
    def _cameras(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        path = self.file(layout.CAMERAS_JSON)
        document = read_json(path, "cameras")
        frames = document["frames"]
        if [camera["frame"] for camera in frames] != list(range(self.frames)):
            raise SpecError(
                "the cameras are not one per frame, in order", path=path, where="frames"
            )
        K = np.array([camera["K"] for camera in frames], np.float64)
        poses = np.array([camera["world_to_camera"] for camera in frames], np.float64)
        return K, poses

    def camera(self, frame: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return a frame's camera.

        Args:
            frame: 0 to frames - 1.

        Returns:
            K float64 (3, 3), pixels; world_to_camera float64 (4, 4), metres.
        """
        self._check(frame)
        K, poses = self._cameras
        return K[frame].copy(), poses[frame].copy()

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
        """
        path = self.file(layout.CORRESPONDENCES_TABLE)
        file = open_table(path)
        if frame is None:
            return load_columns(file, path, CORRESPONDENCES)
        self._check(frame)
        rows = file.metadata.num_rows
        if rows % self.frames:
            raise SpecError(
                "the table does not hold every point of every frame", path=path, found=rows
            )
        count = rows // self.frames
        return load_rows(file, path, CORRESPONDENCES, frame * count, (frame + 1) * count)

    def _check(self, frame: int) -> None:
        if not 0 <= frame < self.frames:
            raise CallError(
                "the sequence has no such frame",
                where=self.id,
                found=frame,
                required=f"0 to {self.frames - 1}",
            )
