"""Frames of a dataset by number, decoded once and then read from a memory-mapped file.

Decoding a PNG and an EXR costs more than a training step can hide on a small machine. The
store keeps each frame at the working size in one fixed-size record of a file, so a
second look costs a page read. Memory stays flat: the pages belong to the file, and the
system may evict them under memory pressure.
"""

from __future__ import annotations

import hashlib
import json
import operator
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.loaders.views import TrainingFrame, read_training_frame, working_key
from pliant.spec.calls import PATH, check_type, check_whole
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, PliantError, SpecError
from pliant.spec.io.limits import MAX_JSON_BYTES
from pliant.spec.io.parquet_columns import stacked
from pliant.spec.io.reading import read_bytes
from pliant.spec.model import Tier
from pliant.spec.point_mesh import surface_points
from pliant.spec.sequence import RecordedFrame, SequenceRecord
from pliant.spec.storage import layout

_STORED: Final = ("rgb", "mask", "objects", "depth_m", "uv_px", "visible")
"""What a record keeps of a `TrainingFrame`."""

_LOCKS: Final = 64


def named_tier(dataset: Dataset, name: str) -> Tier:
    """Return one of a dataset's tiers.

    Args:
        dataset: The dataset.
        name: The tier's name.

    Raises:
        CallError: The dataset has no such tier.
    """
    if name not in dataset.tiers:
        raise CallError(
            "the dataset has no such tier",
            path=dataset.root,
            found=repr(name),
            required="one of " + ", ".join(dataset.tiers),
        )
    return dataset.tiers[name]


class FrameStore:
    """All frames of one tier in one split, at one size.

    Args:
        dataset: The dataset.
        tier: Name of one of its tiers.
        split: Name of a split.
        size: (w, h) to bring frames to: the network's input.
        cache: A folder for decoded frames, or None to decode each time.
        limit: Use the first so many sequences only; None uses all.

    Raises:
        CallError: No such tier, or the split has no sequence of it, or withholds the truth.

    Examples:
        >>> store = pliant.loaders.FrameStore(pliant.load("sample"), "rope", "train", (80, 60))
        >>> len(store), store.view(0).rgb.shape
        (8, (60, 80, 3))
    """

    def __init__(
        self,
        dataset: Dataset,
        tier: str,
        split: str,
        size: tuple[int, int] = (160, 120),
        *,
        cache: Path | str | None = None,
        limit: int | None = None,
    ) -> None:
        fix = 'Open it: FrameStore(pliant.load("DATA"), tier, split)'
        check_type("dataset", dataset, Dataset, fix=fix)
        check_type("tier", tier, str)
        check_type("split", split, str)
        check_type("size", size, (tuple, list), required="(width, height), pixels")
        for side in size:
            check_whole("size", side, 1)
        if len(size) != 2:
            raise CallError("wrong size", found=size, required="(width, height), pixels")
        check_type("cache", cache, (*PATH, type(None)), required="a folder or None")
        check_type("limit", limit, (int, type(None)), required="a whole number or None")
        if limit is not None:
            check_whole("limit", limit, 1)
        self.tier = named_tier(dataset, tier)
        known = [s for s in dataset.sequences if s.tier == tier and s.split not in dataset.held_out]
        sequences = [s for s in known if s.split == split][:limit]
        if not sequences:
            splits = ", ".join(sorted({s.split for s in known}))
            raise CallError(
                f"tier {tier} has no sequence in split {split!r} with depth and dense truth",
                path=dataset.root,
                required=f"one of {splits}" if splits else "a dataset of pliant generate",
                fix="Settings of a training run: split, validation.split" if splits else None,
            )
        self.size = int(size[0]), int(size[1])
        self.where = f"tier {tier}, split {split}"
        self.root = dataset.root
        self.frames = [frame for sequence in sequences for frame in sequence]
        self._first = sequences[0]
        points = self._points = self._first.points()
        ids = self._surface_points = surface_points(points, self.tier.queried_object)
        if len(ids) == 0:
            raise SpecError(
                "the queried object has no surface points",
                path=self._first.dir / layout.POINTS_TABLE,
            )
        self.material = stacked(points, "m0", "m1")[ids]
        self.partners = _partners(self._first, points["partners"].to_pylist(), ids)
        self._alike = {self._first.id}  # sequences whose points are known to be the same
        self._path: Path | None = None
        self._records: npt.NDArray[np.void] | None = None
        if cache is not None:
            asked = [dataset.info, tier, split, self.size, limit, _STORED]
            digest = hashlib.sha256(
                dataset.fingerprint()
                + json.dumps(asked, sort_keys=True).encode()
                + _checksums(dataset, sequences)
            ).hexdigest()[:16]
            folder = Path(cache)
            if folder.exists() and not folder.is_dir():
                raise CallError("this is not a folder", path=folder, where="cache")
            folder.mkdir(parents=True, exist_ok=True)
            self._path = folder / f"{tier}-{split}-{self.size[0]}x{self.size[1]}-{digest}.frames"

    @property
    def points(self) -> int:
        """Number of surface points P; the same ids in every frame of the tier."""
        return len(self.material)

    def __len__(self) -> int:
        return len(self.frames)

    def view(self, index: int) -> TrainingFrame:
        """Return a frame.

        Args:
            index: Its number in `frames`.

        Raises:
            SpecError: A file of it is missing or damaged.
        """
        if not 0 <= operator.index(index) < len(self):
            raise IndexError(f"frame {index} of {len(self)} frames of {self.where}")
        if self._path is None:
            return self._decode(index)
        if self._records is None:  # opened on first use: each worker process maps the file itself
            self._records = self._open(self._path)
        record = self._records[index]
        if not record["done"]:
            if self.frames[index].sequence.made_whole:
                self._store_sequence(self.frames[index], self._records)
            else:
                self._store(index, self._records)
        # A frame just decoded may have other strides than a stored one, and sums then other digits.
        stored: dict[str, Any] = {name: np.array(record[name]) for name in _STORED}
        frame = self.frames[index]
        return TrainingFrame(**stored, key=frame.key).cached_as(working_key(frame, self.size))

    def _store(self, index: int, records: npt.NDArray[np.void]) -> None:
        view = self._decode(index)
        for name in _STORED:
            records[name][index] = getattr(view, name)
        records["done"][index] = 1  # last: a half-written record is decoded again

    def _store_sequence(self, frame: RecordedFrame, records: npt.NDArray[np.void]) -> None:
        """Store all frames of a simulated sequence; other processes wait for them."""
        from filelock import FileLock  # of the extra that simulates

        own = [n for n, each in enumerate(self.frames) if each.sequence is frame.sequence]
        with FileLock(f"{self._path}.{own[0] % _LOCKS}.lock"):
            for number in own:
                if not records["done"][number]:
                    self._store(number, records)

    def _decode(self, index: int) -> TrainingFrame:
        sequence = self.frames[index].sequence
        if not sequence.made_whole and sequence.id not in self._alike:
            if not sequence.points().equals(self._points):
                raise SpecError(
                    f"the points differ from those of {self._first.id}",
                    path=sequence.dir / layout.POINTS_TABLE,
                    required="the same points in all sequences of a tier",
                )
            self._alike.add(sequence.id)
        return read_training_frame(self.frames[index], self.size, self._surface_points)

    def _open(self, path: Path) -> npt.NDArray[np.void]:
        image, points = self.size[::-1], (self.points,)
        record = np.dtype(
            [
                ("done", np.uint8),
                ("rgb", np.uint8, (*image, 3)),
                ("mask", np.bool_, image),
                ("objects", np.bool_, image),
                ("depth_m", np.float32, image),
                ("uv_px", np.float32, (*points, 2)),
                ("visible", np.bool_, points),
            ]
        )
        _allocate(path, record.itemsize * len(self))
        return np.memmap(path, dtype=record, mode="r+", shape=(len(self),))

    def __getstate__(self) -> dict[str, Any]:
        """Leave the mapping out: a worker opens its own."""
        return {**self.__dict__, "_records": None}


def check_store(store: object) -> None:
    """Refuse what is not a `FrameStore`.

    Raises:
        CallError: It is something else.
    """
    fix = 'Make one: FrameStore(pliant.load("DATA"), "rope", "train")'
    check_type("store", store, FrameStore, fix=fix)


def _checksums(dataset: Dataset, sequences: Sequence[SequenceRecord]) -> bytes:
    """Return bytes that change with the sequences' files: pictures of the same ids may be redone.

    Of a packed dataset, the index of its shards, which has the size of each file.
    """
    if dataset.has(layout.INDEX_TABLE):
        return dataset.local(layout.INDEX_TABLE).read_bytes()
    return b"".join(
        read_bytes(each.file(layout.SEQUENCE_JSON), MAX_JSON_BYTES)
        for each in sequences
        if not each.made_whole and each.has(layout.SEQUENCE_JSON)
    )


def _partners(
    sequence: SequenceRecord, lists: list[list[int]], ids: npt.NDArray[np.intp]
) -> npt.NDArray[np.int32]:
    """Return the symmetry partners as rows of the surface points: int32 (P, S)."""
    symmetries = len(sequence.described.symmetries)
    row_of = {int(point): row for row, point in enumerate(ids)}
    try:
        rows = [[row_of[partner] for partner in lists[point]] for point in ids]
        return np.array(rows, dtype=np.int32).reshape(len(ids), symmetries)
    except (KeyError, TypeError, ValueError) as error:
        raise SpecError(
            "a surface point has other partners than its tier's symmetries give",
            path=sequence.dir / layout.POINTS_TABLE,
            where="partners",
            required=f"{symmetries}, surface points of the same object",
        ) from error


def _allocate(path: Path, size: int) -> None:
    """Make a file at least so long, all of it on the disk.

    Writing to a mapped part that the disk has no room for ends the process with SIGBUS.

    Args:
        path: The file; what it contains stays.
        size: Bytes.

    Raises:
        PliantError: The disk is full, or the file cannot be written.
    """
    new = not path.exists()
    try:
        with open(path, "ab") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)
            else:  # macOS
                file.write(bytes(max(0, size - path.stat().st_size)))
    except OSError as error:
        if new:
            path.unlink(missing_ok=True)
        raise PliantError(
            f"there is no room for the cache of decoded frames ({error.strerror})",
            path=path,
            required=f"{size:,} bytes",
            fix="Free disk space, or choose a folder on another disk.",
        ) from error
