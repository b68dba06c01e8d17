"""The cloth: a mass-and-spring simulator and its tiers."""

from __future__ import annotations

try:
    import numba as _numba  # noqa: F401
    import scipy as _scipy  # noqa: F401
except ImportError as error:  # pragma: no cover - the extra is installed where this is tested
    from pliant.spec.errors import MissingExtraError

    raise MissingExtraError("simulating cloth", "generate") from error

from pliant.generator.objects.cloth.sampling import cloth_tier, sample_cloth
from pliant.generator.settings.cloth import ClothSettings

__all__ = ["ClothSettings", "cloth_tier", "sample_cloth"]
