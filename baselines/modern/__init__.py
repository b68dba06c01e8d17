"""Wrappers of published networks. Their libraries are optional, their weights the user's own.

Each module imports its library when its method is made.
"""

from __future__ import annotations

from typing import Final

from pliant.baselines.modern.cotracker import CoTracker
from pliant.baselines.modern.dift import Dift
from pliant.baselines.modern.dino import Dino
from pliant.baselines.modern.keypoints import KeypointMatching
from pliant.baselines.modern.mast3r import Mast3r
from pliant.baselines.modern.optical_flow import PtlFlow, Raft
from pliant.baselines.modern.roma import Roma, RomaV2
from pliant.baselines.modern.tapnet import Tapir, TapNext

Network = type[
    KeypointMatching | Dino | Dift | Raft | PtlFlow | Roma | RomaV2 | Mast3r | CoTracker | Tapir
    | TapNext
]  # fmt: skip

MODERN: Final[dict[str, Network]] = {
    "keypoint-matching": KeypointMatching,
    "dino": Dino,
    "dift": Dift,
    "raft": Raft,
    "flow": PtlFlow,
    "roma": Roma,
    "roma-v2": RomaV2,
    "mast3r": Mast3r,
    "cotracker": CoTracker,
    "tapir": Tapir,
    "tapnext": TapNext,
}
"""Name -> class. All take `weights`; `library` is what each imports."""
