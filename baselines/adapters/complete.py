"""Completes what users have to a matcher: a default name and description, answers of matches."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Mapping
from typing import Any, Final

from pliant.baselines.adapters.functions import from_function
from pliant.baselines.adapters.sparse import SparseMatcher
from pliant.baselines.matcher import Matcher, SplitMatcher, TrackMatcher
from pliant.spec.answers import Answers
from pliant.spec.errors import CallError
from pliant.spec.frame import Pair

ABILITIES: Final = ("answer", "answer_split", "match", "track")
"""An object with one of these methods is a matcher."""


def as_matcher(method: object, name: str | None = None) -> Matcher | SplitMatcher:
    """Return a matcher made of an object or a function.

    An object without `name` or `describe` receives defaults. One that only has `match` answers
    queries by interpolating its matches, one that only has `track` by tracking from one image to
    the other.

    Args:
        method: A matcher, an object with one of its methods, or a function
            (source, target, queries (N, 2)) -> positions (N, 2).
        name: Name for an object that has none; None takes its class's.

    Raises:
        CallError: It is none of these.
    """
    chosen: Any = method
    if isinstance(chosen, type):
        raise CallError(
            "this is a class, not a method",
            where="method",
            found=chosen.__name__,
            fix=f"Pass an instance: {chosen.__name__}()",
        )
    if not has_ability(chosen):
        if not callable(chosen):
            raise CallError(
                "this is not a method",
                where=name or "method",
                found=f"an object of class {type(chosen).__name__}",
                required="a name, an object with `answer`, `match` or `track`, or a function "
                "(source, target, queries) -> positions",
            )
        return from_function(chosen, name)
    kind = type(chosen)
    _check_answer(chosen)
    _fill(chosen, "name", name or kind.__name__)
    implementation = f"{kind.__module__}.{kind.__qualname__}"
    _fill(chosen, "describe", functools.partial(_description, implementation))
    if not (hasattr(chosen, "answer") or hasattr(chosen, "answer_split")):
        if not hasattr(chosen, "match"):
            _fill(chosen, "answer", functools.partial(_answer_by_track, chosen))
            return chosen
        return SparseMatcher(chosen.match, chosen.name, facts=chosen.describe())
    return chosen


def has_ability(method: object) -> bool:
    """Return whether an object or a class has a method of a matcher."""
    return any(callable(getattr(method, each, None)) for each in ABILITIES)


def _check_answer(method: Any) -> None:
    answer = getattr(method, "answer", None)
    if answer is None:
        return
    try:
        inspect.signature(answer).bind(object())
    except TypeError as error:
        raise CallError(
            "the method `answer` takes other arguments",
            where=type(method).__name__,
            found=f"answer{inspect.signature(answer)}",
            required="answer(self, pair)",
            fix="Read pair.source, pair.target and pair.uv_a_px",
        ) from error
    except ValueError:  # a compiled function without a signature
        return


def _description(implementation: str) -> Mapping[str, Any]:
    return {"implementation": implementation}


def _answer_by_track(tracker: TrackMatcher, pair: Pair) -> Answers:
    return next(iter(tracker.track([pair.source, pair.target], pair.uv_a_px)))


def _fill(method: Any, attribute: str, value: object) -> None:
    if hasattr(method, attribute):
        return
    try:
        setattr(method, attribute, value)
    except AttributeError as error:  # slots, or a frozen dataclass
        raise CallError(
            f"this method has no {attribute!r}, and none can be set",
            where=type(method).__name__,
            fix=f"Give the class an attribute {attribute!r}",
        ) from error
