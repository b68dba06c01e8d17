"""Frames as WebDataset tar shards: `SEQUENCE/000000.rgb.png`, `.depth.exr`, `.json`."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pliant.spec.dataset import Dataset
from pliant.spec.sequence import SequenceRecord
from pliant.spec.storage import layout


def write_webdataset(
    dataset: Dataset,
    root: Path,
    *,
    shard_bytes: int,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write the frames of a dataset as tar files, `webdataset/SPLIT-00000.tar`.

    A sample is a frame: its colour image, its depth image where the dataset has one, and a JSON
    object with its sequence, tier, split, shape, frame number and camera. Equal data gives equal
    bytes: no times, owners or modes of this machine get in.

    Args:
        dataset: The dataset, loose or packed.
        root: Where the folder goes.
        shard_bytes: About how large a tar becomes; a sequence is not divided unless it is larger.
        progress: Called with (sequences done, sequences in all).
    """
    done = 0
    for split in dataset.info["splits"]:
        shards = _Tars(root / layout.WEBDATASET_DIR, split, shard_bytes)
        for sequence in [s for s in dataset.sequences if s.split == split]:
            shards.begin_sequence()
            for frame in range(sequence.frames):
                for name, data in _sample(sequence, frame).items():
                    shards.add(f"{sequence.id}/{frame:06d}.{name}", data)
            done += 1
            if progress is not None:
                progress(done, len(dataset.sequences))
        shards.close()


def _sample(sequence: SequenceRecord, frame: int) -> dict[str, bytes]:
    """Return the parts of a frame's sample by extension."""
    facts: dict[str, Any] = {
        "sequence": sequence.id,
        "tier": sequence.tier,
        "split": sequence.split,
        "shape": sequence.shape,
        "frame": frame,
    }
    if sequence.has(layout.CAMERAS_JSON):
        K, pose = sequence.camera(frame)
        facts |= {"K": K.tolist(), "world_to_camera": pose.tolist()}
    parts = {"rgb.png": _bytes(sequence, layout.rgb_name(frame))}
    if sequence.has(layout.depth_name(frame)):
        parts["depth.exr"] = _bytes(sequence, layout.depth_name(frame))
    parts["json"] = json.dumps(facts, sort_keys=True).encode()
    return parts


def _bytes(sequence: SequenceRecord, name: str) -> bytes:
    from pliant.spec.io.limits import MAX_IMAGE_FILE_BYTES
    from pliant.spec.io.reading import read_bytes

    return read_bytes(sequence.file(name), MAX_IMAGE_FILE_BYTES)


class _Tars:
    """The tar files of one split, one after another."""

    def __init__(self, folder: Path, split: str, shard_bytes: int) -> None:
        self._folder, self._split, self._shard_bytes = folder, split, shard_bytes
        self._tar: tarfile.TarFile | None = None
        self._number = 0

    def begin_sequence(self) -> None:
        """Close the present file if it is full."""
        if self._tar is not None and self._tar.offset >= self._shard_bytes:
            self.close()
            self._number += 1

    def add(self, name: str, data: bytes) -> None:
        """Append a member."""
        if self._tar is None:
            self._folder.mkdir(parents=True, exist_ok=True)
            path = self._folder / f"{self._split}-{self._number:05d}.tar"
            self._tar = tarfile.open(path, "w", format=tarfile.PAX_FORMAT)  # noqa: SIM115
        member = tarfile.TarInfo(name)  # time 0, owner 0, mode 0644
        member.size = len(data)
        self._tar.addfile(member, io.BytesIO(data))

    def close(self) -> None:
        """Finish the present file."""
        if self._tar is not None:
            self._tar.close()
            self._tar = None
