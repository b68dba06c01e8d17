"""What a generated dataset is made from: the sections of `GenerateConfig`.

Nothing here imports numba, Blender or a sampler, so a config is read and checked in no time.
"""

from pliant.generator.settings.appearance import AppearanceSettings
from pliant.generator.settings.camera import CameraSettings
from pliant.generator.settings.cloth import ClothSettings
from pliant.generator.settings.faults import DepthCameraSettings, NoiseSettings
from pliant.generator.settings.rope import RopeSettings

__all__ = [
    "AppearanceSettings",
    "CameraSettings",
    "ClothSettings",
    "DepthCameraSettings",
    "NoiseSettings",
    "RopeSettings",
]
