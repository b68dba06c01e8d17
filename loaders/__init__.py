"""PyTorch datasets over Pliant files: pairs and clips."""

from pliant.loaders.augment import AugmentSettings
from pliant.loaders.clips import ClipDataset
from pliant.loaders.frame_store import FrameStore
from pliant.loaders.inputs import NetworkInput
from pliant.loaders.order import StepOrder
from pliant.loaders.pairs import MixedPairs, PairDataset, PairSettings

__all__ = [
    "AugmentSettings",
    "ClipDataset",
    "FrameStore",
    "MixedPairs",
    "NetworkInput",
    "PairDataset",
    "PairSettings",
    "StepOrder",
]
