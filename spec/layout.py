"""Where each file of a dataset lies (relative to its root)."""

from __future__ import annotations

from pathlib import Path
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


def sequence_dir(root: Path, tier: str, sequence: str) -> Path:
    """Return `ROOT/sequences/TIER/ID`."""
    return root / SEQUENCES_DIR / tier / sequence


def rgb_name(frame: int) -> str:
    """Return the frame's colour image, relative to its sequence folder."""
    return f"rgb/{frame:06d}.png"


def depth_name(frame: int) -> str:
    """Return the frame's depth and surface image, relative to its sequence folder."""
    return f"depth/{frame:06d}.exr"


def queries_path(root: Path, split: str) -> Path:
    """Return `ROOT/queries/SPLIT.parquet`."""
    return root / QUERIES_DIR / f"{split}.parquet"


def truth_path(root: Path, split: str) -> Path:
    """Return `ROOT/truth/SPLIT.parquet`."""
    return root / TRUTH_DIR / f"{split}.parquet"
