"""PyTorch datasets over Pliant files: pairs, clips and frames."""

from pliant.loaders.augment import AugmentSettings
from pliant.loaders.clips import ClipDataset
from pliant.loaders.order import StepOrder
from pliant.loaders.pairs import PairDataset, PairSettings
from pliant.loaders.single_frames import FrameDataset

__all__ = [
    "AugmentSettings",
    "ClipDataset",
    "FrameDataset",
    "PairDataset",
    "PairSettings",
    "StepOrder",
]
