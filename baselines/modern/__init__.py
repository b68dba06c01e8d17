"""Wrappers of published networks. Their libraries are optional, their weights the user's own.

Each module imports its library when its method is made.
"""

from __future__ import annotations

from typing import Final

from pliant.baselines.modern.cotracker import CoTracker
from pliant.baselines.modern.dino import Dino
from pliant.baselines.modern.keypoints import KeypointMatching
from pliant.baselines.modern.raft import Raft
from pliant.baselines.modern.roma import Roma
from pliant.baselines.modern.tapir import Tapir

Network = type[KeypointMatching | Dino | Raft | Roma | CoTracker | Tapir]

MODERN: Final[dict[str, Network]] = {
    "keypoint-matching": KeypointMatching,
    "dino": Dino,
    "raft": Raft,
    "roma": Roma,
    "cotracker": CoTracker,
    "tapir": Tapir,
}
"""Name -> class. All take `weights`; `library` is what each imports."""
