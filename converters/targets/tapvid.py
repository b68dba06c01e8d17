"""Point tracks as TAP-Vid stores them: `video`, `points`, `occluded` in an npz per sequence."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from pliant.converters.targets.recording import Options, Recording
from pliant.spec.sequence import SequenceRecord


def write(sequences: Iterable[SequenceRecord], folder: Path, options: Options) -> Iterator[None]:
    """Write a file per sequence.

    `video` uint8 (T, H, W, 3); `points` float32 (N, T, 2), shares of width and height from the
    corner of the picture; `occluded` bool (N, T), which is true out of the frame too.
    """
    for sequence in sequences:
        recording = Recording.of(sequence, options.points)
        packed = io.BytesIO()  # a ZipFile on a full disk prints a traceback when it is deleted
        np.savez_compressed(
            packed,
            video=np.stack([frame.rgb for frame in sequence]),
            points=(recording.uv_px / np.array(sequence.size, np.float32)).transpose(1, 0, 2),
            occluded=~recording.visible.T,
        )
        (folder / f"{sequence.id}.npz").write_bytes(packed.getvalue())
        yield
