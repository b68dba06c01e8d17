"""What a generated dataset is made from: the sections of `GenerateConfig`.

Nothing here imports numba, Blender or a sampler, so a config is read and checked in no time.
"""

from pliant.generator.settings.cloth import ClothSettings
from pliant.generator.settings.rope import RopeSettings
from pliant.generator.settings.scene import (
    AppearanceSettings,
    CameraSettings,
    DepthCameraSettings,
    NoiseSettings,
    SceneSettings,
)

__all__ = [
    "AppearanceSettings",
    "CameraSettings",
    "ClothSettings",
    "DepthCameraSettings",
    "NoiseSettings",
    "RopeSettings",
    "SceneSettings",
]
