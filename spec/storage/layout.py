"""Where each file of a dataset is (relative to its root)."""

from __future__ import annotations

import re
from typing import Final

DATASET_JSON: Final = "dataset.json"
SEQUENCES_TABLE: Final = "sequences.parquet"
SEQUENCES_DIR: Final = "sequences"
SEQUENCE_JSON: Final = "sequence.json"
CAMERAS_JSON: Final = "cameras.json"
POINTS_TABLE: Final = "points.parquet"
CORRESPONDENCES_TABLE: Final = "correspondences.parquet"
QUERIES_DIR: Final = "queries"
TRUTH_DIR: Final = "truth"

INDEX_TABLE: Final = "index.parquet"
"""Of a packed dataset: where in which shard each file of a sequence is."""

SHARD_DIRS: Final = ("frames", "folders", "correspondences")
"""Folders of a packed dataset's Parquet shards."""

PRIVATE_DIR: Final = ".private"
"""What its owner alone may read; never copied into a published dataset, never validated."""

WEBDATASET_DIR: Final = "webdataset"
PICTURES_DIR: Final = "pictures"
PAIRS_DIR: Final = "pairs"
MANIFEST_JSON: Final = "manifest.json"
CHECKSUMS: Final = "SHA256SUMS"

_SHARD = re.compile(r"(?:frames|folders|correspondences)/(?:train|val|test)-[0-9]{5}\.parquet")


def is_shard_name(name: str) -> bool:
    """Return whether a name is that of a Parquet shard, `FOLDER/SPLIT-NUMBER.parquet`."""
    return _SHARD.fullmatch(name) is not None


def shard_name(folder: str, split: str, number: int) -> str:
    """Return `FOLDER/SPLIT-NUMBER.parquet` with five digits."""
    return f"{folder}/{split}-{number:05d}.parquet"


def sequence_name(tier: str, sequence: str) -> str:
    """Return `sequences/TIER/ID`."""
    return f"{SEQUENCES_DIR}/{tier}/{sequence}"


def queries_name(split: str) -> str:
    """Return `queries/SPLIT.parquet`."""
    return f"{QUERIES_DIR}/{split}.parquet"


def truth_name(split: str) -> str:
    """Return `truth/SPLIT.parquet`."""
    return f"{TRUTH_DIR}/{split}.parquet"


def pairs_name(split: str) -> str:
    """Return `pairs/SPLIT.parquet`."""
    return f"{PAIRS_DIR}/{split}.parquet"


def rgb_name(frame: int) -> str:
    """Return the frame's colour image, relative to its sequence folder."""
    return f"rgb/{frame:06d}.png"


def depth_name(frame: int) -> str:
    """Return the frame's depth and surface image, relative to its sequence folder."""
    return f"depth/{frame:06d}.exr"


def mask_name(frame: int) -> str:
    """Return the frame's mask where no surface is known, relative to its sequence folder."""
    return f"masks/{frame:06d}.png"


def camera_depth_name(frame: int) -> str:
    """Return the frame's depth alone, as a camera gave it, relative to its sequence folder."""
    return f"camera_depth/{frame:06d}.exr"
