"""WebDataset: a tar per split and thousand frames, a sample per frame, for streams of pictures."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import numpy as np

from pliant.converters.targets.recording import Options, Recording
from pliant.spec.io.limits import MAX_IMAGE_FILE_BYTES
from pliant.spec.io.reading import read_bytes
from pliant.spec.sequence import SequenceRecord
from pliant.spec.storage import layout

FRAMES_PER_TAR: Final = 1000


def write(sequences: Iterable[SequenceRecord], folder: Path, options: Options) -> Iterator[None]:
    """Write `SPLIT-000000.tar` and so on.

    A sample has `rgb.png` and `depth.exr` (the dataset's own bytes), `camera.json` (K,
    world_to_camera, sequence, frame, tier) and `points.npz` (material, uv_px, xyz_m, state). Its
    key is `SEQUENCE-FRAME`, a dot in it written as %2E: readers end the key at the first dot.
    """
    written: dict[str, int] = {}
    with ExitStack() as stack:
        tars: dict[str, tarfile.TarFile] = {}
        for sequence in sequences:
            recording = Recording.of(sequence, options.points)
            for frame in range(sequence.frames):
                count = written.get(sequence.split, 0)
                if count % FRAMES_PER_TAR == 0:
                    name = f"{sequence.split}-{count // FRAMES_PER_TAR:06d}.tar"
                    tars[sequence.split] = stack.enter_context(tarfile.open(folder / name, "w"))
                written[sequence.split] = count + 1
                key = f"{sequence.id}-{frame:06d}".replace(".", "%2E")
                _add(tars[sequence.split], key, _files(recording, frame))
            yield


def _files(recording: Recording, frame: int) -> Mapping[str, bytes]:
    sequence = recording.sequence
    sequence.rgb(frame)  # a damaged picture is not handed on
    sequence.surface(frame)
    camera = sequence.camera(frame)
    document = {
        "sequence": sequence.id,
        "frame": frame,
        "tier": sequence.tier,
        "K": camera.K.tolist(),
        "world_to_camera": camera.world_to_camera.tolist(),
    }
    points = io.BytesIO()
    np.savez(
        points,
        material=recording.material,
        uv_px=recording.uv_px[frame],
        xyz_m=recording.xyz_m[frame],
        state=recording.state[frame],
    )
    return {
        "rgb.png": read_bytes(sequence.file(layout.rgb_name(frame)), MAX_IMAGE_FILE_BYTES),
        "depth.exr": read_bytes(sequence.file(layout.depth_name(frame)), MAX_IMAGE_FILE_BYTES),
        "camera.json": json.dumps(document).encode(),
        "points.npz": points.getvalue(),
    }


def _add(tar: tarfile.TarFile, key: str, files: Mapping[str, bytes]) -> None:
    for ending, data in files.items():
        entry = tarfile.TarInfo(f"{key}.{ending}")
        entry.size = len(data)
        tar.addfile(entry, io.BytesIO(data))
