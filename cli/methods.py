"""The METHOD argument: a method's name, or the folder of a training run."""

from __future__ import annotations

import difflib
import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pliant.spec.errors import CallError, MissingExtraError

if TYPE_CHECKING:
    from pliant.baselines import Matcher, SplitMatcher


def open_method(method: str) -> Matcher | SplitMatcher:
    """Return the method that a command was called with.

    Args:
        method: A key of `pliant.baselines.METHODS`, or the folder of a training run.

    Raises:
        CallError: It is neither.
        MissingExtraError: The method's libraries are not installed.
    """
    from pliant.baselines import METHODS

    if method in METHODS:
        return METHODS[method]()
    if Path(method).is_dir():
        try:
            models: Any = importlib.import_module("pliant.models")
        except ImportError as error:
            raise MissingExtraError("A learned method", "train") from error
        matcher: Matcher = models.load_matcher(Path(method))
        return matcher
    close = difflib.get_close_matches(method, METHODS, n=1)
    raise CallError(
        f"there is no method {method!r}",
        required=f"one of {', '.join(METHODS)}, or the folder of a training run",
        fix=f"Did you mean {close[0]}?" if close else None,
    )
