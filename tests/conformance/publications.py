"""Steps of a case that concern the whole dataset: held out, packed, published, copied."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pliant.spec.dataset import Dataset
from pliant.spec.io.exr import write_camera_depth
from pliant.spec.io.png import read_rgb, write_mask, write_rgb
from pliant.spec.storage import layout
from pliant.spec.storage.manifest import write_checksums, write_manifest
from pliant.spec.storage.packing import FolderToPack, Packer
from tests.conformance.base import (
    TIERS,
    cloth_points,
    cloth_shot,
    rope_points,
    rope_shot,
    write_dataset,
    write_sequence,
)
from tests.conformance.edits import (
    FOLDERS,
    ROPE_TEST,
    ROPE_TRAIN,
    change_exr,
    change_json,
    change_rows,
    listed,
    remove,
    whole,
    write,
)


def hold_out(root: Path, but: str | None = None) -> None:
    """Hold the test split out: take away all that tells its truth, but for one file if given."""
    left = None if but is None else (root / whole(but)).read_bytes()
    change_json("dataset.json", lambda document: document.update(held_out=["test"]))(root)
    remove("truth")(root)
    names = []
    for path in sorted(root.glob("sequences/*/*-test-*")):
        for name in ("points.parquet", "correspondences.parquet", "depth"):
            remove(f"{path.relative_to(root)}/{name}")(root)
        relative = f"{path.relative_to(root)}/sequence.json"
        change_json(relative, lambda document: document.update(seed=0, parameters={}))(root)
        names.append(path.name)

    def unseed(rows: list[dict[str, Any]]) -> None:
        for row in rows:
            row["seed"] = 0 if row["id"] in names else row["seed"]

    change_rows("sequences.parquet", unseed)(root)
    if but is not None and left is not None:
        write(whole(but), left)(root)
    listed()(root)


def record(root: Path) -> None:
    """Hold the test split out, and add masks and camera depth to one of its sequences."""
    hold_out(root)
    frames = json.loads((root / ROPE_TEST / "sequence.json").read_text())["frames"]
    for folder in ("masks", "camera_depth"):
        (root / ROPE_TEST / folder).mkdir()
    for frame in range(frames):
        ids = np.zeros((48, 64), np.uint8)
        ids[20:30, 10:50] = 1
        depth_m = np.where(ids > 0, 1.25, np.inf).astype(np.float32)
        write_mask(root / ROPE_TEST / layout.mask_name(frame), ids)
        write_camera_depth(root / ROPE_TEST / layout.camera_depth_name(frame), depth_m)


def pack(root: Path) -> None:
    """Replace the folder `sequences` by shards and an index."""
    dataset = Dataset.open(root)
    with Packer(root, {"id": dataset.id, "version": dataset.version}) as packer:
        for each in dataset:
            files = {
                path.relative_to(each.dir).as_posix(): path.read_bytes()
                for path in sorted(each.dir.rglob("*"))
                if path.is_file()
            }
            packer.add(FolderToPack(each.id, each.tier, each.split, each.shape, each.frames, files))
    shutil.rmtree(root / layout.SEQUENCES_DIR)


def publish(root: Path) -> None:
    """Pack the dataset, and add the checksums and the manifest of a publication."""
    pack(root)
    dataset = Dataset.open(root)
    write_manifest(
        root,
        "public",
        dataset={"id": dataset.id, "version": dataset.version},
        held_out=dataset.held_out,
        checksums_sha256=write_checksums(root),
        other_sha256=None,
        tools={},
    )


def shoot(root: Path, tier: str, eyes: Sequence[tuple[float, float, float]]) -> None:
    """Replace the dataset by one sequence: the flat cloth or the bare tube from some places."""
    remove("sequences")(root)
    cloth = tier == "cloth-1"
    points = cloth_points() if cloth else rope_points(ball=False)
    shots = [cloth_shot(eye, flat=True) if cloth else rope_shot(eye, ball=False) for eye in eyes]
    row = write_sequence(root, TIERS[tier], "train", 0, points, shots)
    write_dataset(root, "conformance-minimal", [row], [TIERS[tier]])


def encode_again(root: Path) -> None:
    """Write the colour images with every filter and the highest compression."""
    for path in sorted(root.rglob("*.png")):
        with Image.open(path) as image:
            image.load()
            image.save(path, "PNG", optimize=True)


def copy_to_train(root: Path) -> None:
    """Give a training sequence the very images and tables of a test sequence."""
    source = root / FOLDERS["BARE"]
    target = Path(str(source).replace("-test-", "-train-"))
    shutil.copytree(source, target)
    identity = {"id": target.name, "split": "train"}
    path = f"{target.relative_to(root)}/sequence.json"
    change_json(path, lambda document: document.update(identity))(root)


def share_content(root: Path, names: Sequence[str]) -> None:
    """Give the test rope files of the training rope, written again by another encoder."""
    for name in names:
        (root / ROPE_TEST / name).write_bytes((root / ROPE_TRAIN / name).read_bytes())
    for frame in (0, 1):
        exr = f"{ROPE_TEST}/{layout.depth_name(frame)}"
        change_exr(exr, lambda channels: None, "NO_COMPRESSION")(root)
        path = root / ROPE_TEST / layout.rgb_name(frame)
        write_rgb(path, read_rgb(path), level=9)
