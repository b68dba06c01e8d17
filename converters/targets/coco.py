"""COCO keypoints: one JSON file and the pictures; a category per tier, a keypoint per point."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.converters.targets.recording import Options, Recording
from pliant.spec.conventions import OUT_OF_FRAME
from pliant.spec.io.png import write_rgb
from pliant.spec.mask_box import mask_box
from pliant.spec.sequence import SequenceRecord

DEFAULT_POINTS: Final = 64
"""Keypoints of a category where none are asked for; tools for COCO show every one."""

ANNOTATIONS: Final = "annotations.json"


def write(sequences: Iterable[SequenceRecord], folder: Path, options: Options) -> Iterator[None]:
    """Write `annotations.json` and `images/`.

    Keypoints are x and y from the corner of the picture, v 2 for visible, 1 for hidden and 0 out
    of the frame; a point is the same material point in all pictures of its tier. The segmentation
    is the mask of the queried object as run lengths, the box that of the mask.
    """
    (folder / "images").mkdir()
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    categories: dict[str, dict[str, Any]] = {}
    for sequence in sequences:
        recording = Recording.of(sequence, options.points or DEFAULT_POINTS)
        category = categories.setdefault(
            sequence.tier,
            {
                "id": len(categories) + 1,
                "name": sequence.tier,
                "supercategory": sequence.described.kind,
                # By their rows in points.parquet.
                "keypoints": [f"point_{row}" for row in recording.mesh.rows[recording.chosen]],
                "skeleton": [],
            },
        )
        for frame in sequence:
            name = f"{sequence.id}-{frame.index:06d}.png"
            write_rgb(folder / "images" / name, frame.rgb)
            number = len(images) + 1
            width, height = sequence.size
            images.append({"id": number, "file_name": name, "width": width, "height": height})
            annotations.append(
                {
                    "id": number,
                    "image_id": number,
                    "category_id": category["id"],
                    "iscrowd": 0,
                    **_keypoints(recording, frame.index),
                    **_region(frame.mask),
                }
            )
        yield
    document = {
        "images": images,
        "annotations": annotations,
        "categories": list(categories.values()),
    }
    (folder / ANNOTATIONS).write_text(json.dumps(document))


def _keypoints(recording: Recording, frame: int) -> dict[str, Any]:
    outside = recording.state[frame] == OUT_OF_FRAME
    marks = np.where(outside, 0, np.where(recording.visible[frame], 2, 1))
    uv = np.where(outside[:, None], 0, recording.uv_px[frame]).astype(np.float64)
    triples = np.column_stack([uv, marks]).round(4)
    return {
        "keypoints": [float(each) for each in triples.ravel()],
        "num_keypoints": int((marks > 0).sum()),
    }


def _region(mask: npt.NDArray[np.bool_] | None) -> dict[str, Any]:
    """Return segmentation, area and box of a mask, as COCO counts them: column by column."""
    if mask is None or not mask.any():
        return {"segmentation": [], "area": 0, "bbox": [0, 0, 0, 0]}
    flat = mask.ravel(order="F")
    changes = np.flatnonzero(np.diff(flat, prepend=False))
    counts = np.diff(np.concatenate([[0], changes, [flat.size]]))
    rows, columns = mask_box(mask)
    return {
        "segmentation": {"size": list(mask.shape), "counts": [int(each) for each in counts]},
        "area": int(mask.sum()),
        "bbox": [columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start],
    }
