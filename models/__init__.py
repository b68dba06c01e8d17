"""Learned methods: networks, losses, trainers, and their matchers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from pliant.models.don.matcher import DonMatcher
    from pliant.models.timecycle.matcher import TimeCycleMatcher

__all__ = ["CARD", "load_matcher"]

CARD: Final = "CARD.md"
"""The card of an exported model; other runs have none."""


def load_matcher(run: Path | str, /, **options: Any) -> DonMatcher | TimeCycleMatcher:
    """Return the matcher of a training run, of whatever kind its config says.

    That of an exported model has the model's name, its folder's.

    Args:
        run: The run's folder.
        options: How it answers, instead of what the run's config says: fields of `answer` for Dense
            Object Nets, such as `blank_square="any"`, and of `propagation` for TimeCycle.

    Raises:
        CallError: It is not a run's folder, or has no such option.
        MissingExtraError: torch is not installed.
        TrainingError: The run has no validated weights yet, or is damaged.

    Examples:
        >>> run = Path(pliant.models.__file__).parent / "shipped" / "don-rope"
        >>> pliant.models.load_matcher(run).name
        'don-rope'
    """
    from pliant.spec.errors import MissingExtraError

    try:
        from pliant.models.don.loading import load_matcher as load_don
        from pliant.models.timecycle.matcher import load_timecycle
        from pliant.models.training.run_folder import CONFIG
    except ImportError as error:
        raise MissingExtraError("answering with a trained network", "train") from error
    run = Path(run)
    load = load_timecycle if _kind(run / CONFIG) == "timecycle" else load_don
    matcher: DonMatcher | TimeCycleMatcher = load(run, **options)
    if (run / CARD).is_file():
        matcher.name = run.resolve().name
    return matcher


def _kind(config: Path) -> str:
    """Return the kind that a run's config names; runs of Dense Object Nets name none."""
    from pliant.spec.errors import CallError
    from pliant.spec.io.yamlfiles import read_yaml

    try:
        if b"timecycle" not in config.read_bytes():
            return "don"  # without parsing the config, which its loader does again
        values = read_yaml(config)
    except (CallError, OSError):
        return "don"  # its loader says what is wrong
    return str(values.get("kind", "don")) if isinstance(values, dict) else "don"
