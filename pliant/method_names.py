"""Opens a method by its name; what it needs is imported when it is opened."""

from __future__ import annotations

import difflib
import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pliant.spec.calls import check_type
from pliant.spec.errors import CallError

if TYPE_CHECKING:
    from pliant.baselines import Matcher, SplitMatcher


def open_method(method: str, /, **options: Any) -> Matcher | SplitMatcher:
    """Return a method by its name.

    Args:
        method: A key of `pliant.baselines.METHODS`, the name of a shipped model, the name that an
            installed package gives in the entry-point group `pliant.matchers`, `vismatch:NAME`,
            `fused:METHOD` (optical flow, corrected by that method), `carried:MODEL` (points
            carried by the descriptors of Dense Object Nets), `path/to/my.py:Matcher`,
            `package.module:Matcher`, or the folder of a training run.
        options: Keyword arguments of the method's class or function; for a trained model, settings
            of `answer`, see `load_matcher`.

    Raises:
        CallError: The method is unknown, the name is that of a shipped model and of a run here, or
            the method does not take these options.
        MissingExtraError: The method's libraries are not installed.

    Examples:
        >>> pliant.open_method("random", seed=3).name
        'random'
    """
    from pliant.baselines import METHODS
    from pliant.baselines.adapters.vismatch import PREFIX, open_vismatch
    from pliant.baselines.fused_tracker import PREFIX as FUSED
    from pliant.baselines.fused_tracker import FusedTracker
    from pliant.baselines.plugins import is_reference, make, open_plugin, plugged_in
    from pliant.models import load_matcher
    from pliant.models.shipped import load_shipped, shipped_names
    from pliant.models.timecycle import CARRIED

    check_type("method", method, str, required="the name of a method")
    built_in: Any = METHODS.get(method)
    if method.startswith(PREFIX):
        built_in = partial(open_vismatch, method.removeprefix(PREFIX))
    elif method.startswith(FUSED):
        built_in = partial(FusedTracker, open_method(method.removeprefix(FUSED)))
    elif method.startswith(CARRIED):
        built_in = partial(_carried, method.removeprefix(CARRIED))
    if built_in is not None:
        made: Matcher | SplitMatcher = make(built_in, method, options)
        return made
    shipped, plugged = shipped_names(), plugged_in()
    if method not in shipped and (method in plugged or is_reference(method)):
        return open_plugin(method, options)
    if method in shipped:
        if (Path(method) / "config.yaml").is_file():
            raise CallError(
                f"{method!r} is a shipped model, and a training run here",
                fix=f"Write ./{method} for the run, or call from another folder for the model.",
            )
        return load_shipped(method, **options)
    if method.strip() and os.path.isdir(method):
        return load_matcher(Path(method), **options)
    names = (*METHODS, *shipped, *plugged)
    close = difflib.get_close_matches(method, names, n=1)
    raise CallError(
        f"there is no method {method!r}",
        required=f"one of {', '.join(names)}, vismatch:NAME, fused:METHOD, carried:MODEL, the "
        "folder of a training run, or FILE.py:CLASS",
        fix=f"Did you mean {close[0]}?" if close else None,
    )


def _carried(model: str, /, **options: Any) -> Matcher:
    """Return the tracker that carries points by the descriptors of a trained network.

    Raises:
        CallError: The method is not a Dense Object Net, or an option is unknown.
    """
    matcher = open_method(model)
    from pliant.models.don.matcher import DonMatcher
    from pliant.models.timecycle.carried import CarriedPoints

    if not isinstance(matcher, DonMatcher):
        raise CallError(
            "this method has no descriptors and cannot carry points",
            found=repr(model),
            required="a shipped model, or the folder of a run of Dense Object Nets",
        )
    return CarriedPoints(matcher, **options)
