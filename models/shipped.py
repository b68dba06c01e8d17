"""Trained models that come with the package: small runs, by name.

`models/shipped/NAME/` is a run's folder with what answering needs (`pliant.models.export`
makes it). Listing the names needs no torch.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pliant.models import CARD, load_matcher
from pliant.spec.errors import CallError

if TYPE_CHECKING:
    from pliant.models.don.matcher import DonMatcher
    from pliant.models.timecycle.matcher import TimeCycleMatcher

FOLDER: Final = Path(__file__).parent / "shipped"
"""Folder of the models."""


def shipped_names() -> tuple[str, ...]:
    """Return the names of the shipped models, sorted."""
    return tuple(sorted(path.parent.name for path in FOLDER.glob(f"*/{CARD}")))


def load_shipped(name: str, /, **options: Any) -> DonMatcher | TimeCycleMatcher:
    """Return the matcher of a shipped model.

    Args:
        name: One of `shipped_names`.
        options: How it answers; see `load_matcher`.

    Raises:
        CallError: The model is not found, or has no such option.
        MissingExtraError: torch is not installed.
        TrainingError: Its folder is damaged.
    """
    names = shipped_names()
    if name not in names:
        raise CallError(f"no model {name!r} is shipped", required=", ".join(names) or None)
    return load_matcher(FOLDER / name, **options)
