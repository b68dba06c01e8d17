"""The METHOD argument: a method's name, a shipped model's name, or the folder of a run."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import TYPE_CHECKING

from pliant.spec.errors import CallError

if TYPE_CHECKING:
    from pliant.baselines import Matcher, SplitMatcher


def open_method(method: str) -> Matcher | SplitMatcher:
    """Return the method that a command was called with.

    Args:
        method: A key of `pliant.baselines.METHODS`, the name of a shipped model, or the folder
            of a training run.

    Raises:
        CallError: It is none of them, or both a shipped model and a run of that name.
        MissingExtraError: The method's libraries are not installed.
    """
    from pliant.baselines import METHODS
    from pliant.models import load_matcher
    from pliant.models.shipped import load_shipped, shipped_names

    if method in METHODS:
        return METHODS[method]()
    shipped = shipped_names()
    if method in shipped:
        if (Path(method) / "config.yaml").is_file():
            raise CallError(
                f"{method!r} is a shipped model, and a training run here",
                fix=f"Write ./{method} for the run, or call from another folder for the model.",
            )
        return load_shipped(method)
    if Path(method).is_dir():
        return load_matcher(Path(method))
    names = (*METHODS, *shipped)
    close = difflib.get_close_matches(method, names, n=1)
    raise CallError(
        f"there is no method {method!r}",
        required=f"one of {', '.join(names)}, or the folder of a training run",
        fix=f"Did you mean {close[0]}?" if close else None,
    )
