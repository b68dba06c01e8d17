"""Frames as WebDataset tar shards: `SEQUENCE/000000.rgb.png`, `.depth.exr`, `.json`."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pliant.spec.dataset import Dataset
from pliant.spec.io.limits import MAX_IMAGE_FILE_BYTES
from pliant.spec.io.reading import read_bytes
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
    (root / layout.WEBDATASET_DIR).mkdir(parents=True, exist_ok=True)
    done = 0
    for split in dataset.info["splits"]:
        waiting = [s for s in dataset.sequences if s.split == split][::-1]
        number = 0
        while waiting:
            path = root / layout.WEBDATASET_DIR / f"{split}-{number:05d}.tar"
            with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as tar:
                while waiting and tar.offset < shard_bytes:
                    _add(tar, waiting.pop())
                    done += 1
                    if progress is not None:
                        progress(done, len(dataset.sequences))
            number += 1


def _add(tar: tarfile.TarFile, sequence: SequenceRecord) -> None:
    """Append the samples of a sequence."""
    for frame in range(sequence.frames):
        for name, data in _sample(sequence, frame).items():
            member = tarfile.TarInfo(f"{sequence.id}/{frame:06d}.{name}")  # time 0, owner 0
            member.size = len(data)
            tar.addfile(member, io.BytesIO(data))


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
        camera = sequence.camera(frame)
        facts |= {"K": camera.K.tolist(), "world_to_camera": camera.world_to_camera.tolist()}
    parts = {"rgb.png": _bytes(sequence, layout.rgb_name(frame))}
    if sequence.has(layout.depth_name(frame)):
        parts["depth.exr"] = _bytes(sequence, layout.depth_name(frame))
    parts["json"] = json.dumps(facts, sort_keys=True).encode()
    return parts


def _bytes(sequence: SequenceRecord, name: str) -> bytes:
    return read_bytes(sequence.file(name), MAX_IMAGE_FILE_BYTES)
