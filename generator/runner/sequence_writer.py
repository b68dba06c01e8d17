"""Writing one sequence: whole, or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa

from pliant.spec.arrays import Rgb
from pliant.spec.conventions import POINT_KINDS, SPEC_VERSION
from pliant.spec.io.exr import Surface, write_surface
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.parquet import TableWriter, write_table
from pliant.spec.io.png import write_rgb
from pliant.spec.io.reading import file_entry
from pliant.spec.io.staging import staged
from pliant.spec.io.writing import synced
from pliant.spec.storage.layout import (
    CAMERAS_JSON,
    CORRESPONDENCES_TABLE,
    POINTS_TABLE,
    SEQUENCE_JSON,
    depth_name,
    rgb_name,
)
from pliant.spec.tables import CORRESPONDENCES, POINTS

if TYPE_CHECKING:
    from pliant.generator.scene.scene_object import Points
    from pliant.generator.truth.frame_truth import FrameTruth
    from pliant.spec.camera import Camera

PNG_LEVEL: Final = 1
_FRAMES_IN_FLIGHT: Final = 4
_ROWS_IN_MEMORY: Final = 32768


class SequenceWriter:
    """Collects the frames of a sequence.

    Images are encoded on a thread of their own, at most four frames behind, so that the next
    frame renders meanwhile.

    Args:
        folder: Where its files are written.
        sequence: Id of the sequence.
        encoder: The thread.
        table: Takes the rows of `correspondences.parquet`.

    Attributes:
        encode_cpu_s: CPU seconds of the encoder.
    """

    def __init__(
        self, folder: Path, sequence: str, encoder: ThreadPoolExecutor, table: TableWriter
    ) -> None:
        self.encode_cpu_s = 0.0
        self._folder, self._sequence = folder, sequence
        self._encoder, self._table = encoder, table
        self._pending: deque[Future[float]] = deque()
        self._images: list[dict[str, Any]] = []
        self._cameras: list[dict[str, Any]] = []
        self._size = (0, 0)
        self._rows: list[pa.Table] = []

    def add_frame(self, rgb: Rgb, truth: FrameTruth, camera: Camera) -> None:
        """Take the next frame; the arrays must not be changed afterwards.

        Args:
            rgb: uint8 (H, W, 3), sRGB.
            truth: What the camera sees and where the points are.
            camera: The frame's camera.
        """
        frame = len(self._cameras)
        self._wait(_FRAMES_IN_FLIGHT - 1)
        self._pending.append(self._encoder.submit(self._encode, frame, rgb, truth.surface))
        self._cameras.append(
            {
                "frame": frame,
                "K": camera.K.tolist(),
                "world_to_camera": camera.world_to_camera.tolist(),
            }
        )
        self._size = camera.size
        self._rows.append(correspondence_rows(frame, truth))
        if sum(map(len, self._rows)) >= _ROWS_IN_MEMORY:
            self._write_rows()

    def finish(self, info: Mapping[str, Any], points: Points) -> int:
        """Write the tables and `sequence.json`.

        Args:
            info: Fields of `sequence.json` except `spec_version` and `files`.
            points: The sequence's material points.

        Returns:
            Bytes of the sequence.
        """
        self._wait(0)
        self._write_rows()
        self._table.close()
        footer = {"sequence": self._sequence}
        write_table(self._folder / POINTS_TABLE, point_rows(points), "points", footer)
        width, height = self._size
        cameras = {"width": width, "height": height, "frames": self._cameras}
        write_json(
            self._folder / CAMERAS_JSON, {"spec_version": SPEC_VERSION, **cameras}, "cameras"
        )
        names = (CAMERAS_JSON, CORRESPONDENCES_TABLE, POINTS_TABLE)
        files = [*(file_entry(self._folder, name) for name in names), *self._images]
        files.sort(key=lambda file: str(file["path"]))
        document = {"spec_version": SPEC_VERSION, **info, "files": files}
        write_json(self._folder / SEQUENCE_JSON, document, "sequence")
        json_bytes = (self._folder / SEQUENCE_JSON).stat().st_size
        total: int = json_bytes + sum(file["bytes"] for file in files)
        return total

    def _wait(self, pending: int) -> None:
        """Wait until at most so many frames are being encoded."""
        while len(self._pending) > pending:
            self.encode_cpu_s += self._pending.popleft().result()

    def _write_rows(self) -> None:
        if self._rows:
            self._table.write(pa.concat_tables(self._rows))
            self._rows.clear()

    def _encode(self, frame: int, rgb: Rgb, surface: Surface) -> float:
        start = time.thread_time()
        write_rgb(self._folder / rgb_name(frame), rgb, level=PNG_LEVEL)
        try:
            write_surface(self._folder / depth_name(frame), surface)
        except RuntimeError as error:  # all that OpenEXR says is that the output failed
            if _free_bytes(self._folder) < surface.depth_m.nbytes:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from error
            raise
        for name in (rgb_name(frame), depth_name(frame)):
            synced(self._folder / name)  # here, next to the rendering, and not all at the end
            self._images.append(file_entry(self._folder, name))
        return time.thread_time() - start


@contextmanager
def writing_sequence(folder: Path) -> Iterator[SequenceWriter]:
    """Yield the writer of a sequence, and put its files into place, all or none.

    Args:
        folder: The sequence's folder in the dataset. An existing one, such as that of a lost
            worker that was not lost, is replaced.

    Raises:
        CallError: The disk is full or cannot be written.
    """
    with (
        staged(folder) as partial,
        TableWriter(
            partial / CORRESPONDENCES_TABLE, "correspondences", {"sequence": folder.name}
        ) as table,
        ThreadPoolExecutor(1, thread_name_prefix="encode") as encoder,
    ):
        for name in (rgb_name(0), depth_name(0)):
            (partial / name).parent.mkdir()
        yield SequenceWriter(partial, folder.name, encoder, table)


def point_rows(points: Points) -> pa.Table:
    """Return the rows of `points.parquet`."""
    count, symmetries = points.partners.shape
    offsets = np.arange(count + 1, dtype=np.int32) * np.int32(symmetries)
    kinds = np.array(POINT_KINDS)[points.centreline.astype(np.intp)]
    columns: Sequence[Any] = [
        np.arange(count, dtype=np.int32),
        points.object_id,
        pa.array(kinds.tolist(), pa.string()),
        np.ascontiguousarray(points.material[:, 0], np.float32),
        np.ascontiguousarray(points.material[:, 1], np.float32),
        pa.ListArray.from_arrays(offsets, points.partners.reshape(-1)).cast(
            POINTS.field("partners").type
        ),
    ]
    return pa.Table.from_arrays([pa.array(c) for c in columns], schema=POINTS)


def correspondence_rows(frame: int, truth: FrameTruth) -> pa.Table:
    """Return one frame's rows of `correspondences.parquet`."""
    count = len(truth.depth_m)
    columns: Sequence[Any] = [
        np.full(count, frame, np.int32),
        np.arange(count, dtype=np.int32),
        truth.uv_px[:, 0].astype(np.float32),
        truth.uv_px[:, 1].astype(np.float32),
        np.asarray(truth.depth_m, np.float32),
        pa.array(truth.visibility, pa.string()),
        *(truth.xyz_m[:, axis].astype(np.float32) for axis in range(3)),
    ]
    return pa.Table.from_arrays([pa.array(c) for c in columns], schema=CORRESPONDENCES)


def _free_bytes(folder: Path) -> int:
    return shutil.disk_usage(folder).free
