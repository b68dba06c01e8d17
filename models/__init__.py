"""Learned methods: networks, losses, trainers, and their matchers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pliant.models.matching import DonMatcher

__all__ = ["load_matcher"]


def load_matcher(run: Path | str) -> DonMatcher:
    """Return the matcher of a training run.

    Args:
        run: The run's folder.

    Raises:
        CallError: It is no run's folder.
        MissingExtraError: torch is not installed.
        TrainingError: The run has no validated weights yet, or is damaged.
    """
    from pliant.spec.errors import MissingExtraError

    try:
        from pliant.models import matching
    except ImportError as error:
        raise MissingExtraError("answering with a trained network", "train") from error
    return matching.load_matcher(run)
