"""What a generated dataset is made from: the sections of `GenerateConfig`.

Nothing here imports numba, Blender or a sampler, so a config is read and checked in no time.
"""

from pliant.generator.settings.camera import CameraSettings
from pliant.generator.settings.cloth import ClothSettings
from pliant.generator.settings.faults import DepthCameraSettings, NoiseSettings
from pliant.generator.settings.look import LookSettings
from pliant.generator.settings.rope import RopeSettings

__all__ = [
    "CameraSettings",
    "ClothSettings",
    "DepthCameraSettings",
    "LookSettings",
    "NoiseSettings",
    "RopeSettings",
]
