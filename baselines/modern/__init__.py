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

Network = type[KeypointMatching | Dino | Raft | Roma | CoTracker]

MODERN: Final[dict[str, Network]] = {
    "keypoint-matching": KeypointMatching,
    "dino": Dino,
    "raft": Raft,
    "roma": Roma,
    "cotracker": CoTracker,
}
"""Name -> class. All take `weights`; `library` is what each imports."""
