"""Cases of recorded data, whose surface nobody knows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pliant.spec.io.exr import write_camera_depth
from pliant.spec.io.png import write_mask, write_rgb
from tests.conformance.accepted import held_out
from tests.conformance.edits import (
    ROPE_TEST,
    ROPE_TRAIN,
    Edit,
    both,
    change_json,
    change_rows,
    listed,
)

_HEIGHT, _WIDTH = 48, 64
_MASK = f"{ROPE_TEST}/masks/000000.png"
_DEPTH = f"{ROPE_TEST}/camera_depth/000001.exr"


def _recorded(root: Path) -> None:
    """Hold the test split out, and add masks and camera depth to one of its sequences."""
    held_out(root)
    frames = json.loads((root / ROPE_TEST / "sequence.json").read_text())["frames"]
    for frame in range(frames):
        ids = np.zeros((_HEIGHT, _WIDTH), np.uint8)
        ids[20:30, 10:50] = 1
        depth_m = np.where(ids > 0, 1.25, np.inf).astype(np.float32)
        for folder in ("masks", "camera_depth"):
            (root / ROPE_TEST / folder).mkdir(exist_ok=True)
        write_mask(root / ROPE_TEST / f"masks/{frame:06d}.png", ids)
        write_camera_depth(root / ROPE_TEST / f"camera_depth/{frame:06d}.exr", depth_m)


def _but(edit: Edit) -> Edit:
    return listed(_recorded, edit)


def _mask_of(value: int) -> Edit:
    ids = np.full((_HEIGHT, _WIDTH), value, np.uint8)
    return lambda root: write_mask(root / _MASK, ids)


def _depth_of(value: float) -> Edit:
    depth_m = np.full((_HEIGHT, _WIDTH), value, np.float32)
    return lambda root: write_camera_depth(root / _DEPTH, depth_m)


def _kind(document: dict[str, Any]) -> None:
    document["tiers"][0]["kind"] = "bag"


def _styled(style: str) -> Edit:
    def style_of(document: dict[str, Any]) -> None:
        document["style"] = style

    def rows(table: list[dict[str, Any]]) -> None:
        for row in table:
            row["style"] = style if row["id"] == Path(ROPE_TRAIN).name else row["style"]

    return both(
        change_json(f"{ROPE_TRAIN}/sequence.json", style_of),
        listed(change_rows("sequences.parquet", rows)),
    )


EDITS: dict[str, Edit] = {
    "recorded": listed(_recorded),
    "recorded-mask-missing": _but(lambda root: (root / _MASK).unlink()),
    "recorded-mask-of-an-unknown-object": _but(_mask_of(77)),
    "recorded-mask-in-colour": _but(
        lambda root: write_rgb(root / _MASK, np.zeros((_HEIGHT, _WIDTH, 3), np.uint8))
    ),
    "recorded-depth-of-zero": _but(_depth_of(0.0)),
    "kind-open": change_json("dataset.json", _kind),
    "style-open": _styled("phone"),
    "style-no-name": _styled("a phone"),
}
