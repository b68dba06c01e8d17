"""Completes a user's object to a matcher: default name, description, and answers from matches."""

from __future__ import annotations

import functools
import inspect
import json
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import numpy.typing as npt

from pliant.baselines.adapters.images import function_name
from pliant.baselines.adapters.sparse import SparseMatcher
from pliant.baselines.matcher import Matcher, SplitMatcher, TrackMatcher
from pliant.spec.answers import Answers
from pliant.spec.arrays import Float32Array
from pliant.spec.errors import CallError
from pliant.spec.frame import Frame, Pair

ABILITIES: Final = ("answer", "answer_split", "match", "track")
"""An object with one of these methods is a matcher."""


def as_matcher(
    method: object, name: str | None = None, options: Mapping[str, Any] = {}
) -> Matcher | SplitMatcher:
    """Return a matcher made of an object or a function.

    An object without `name` or `describe` receives defaults. One that only has `match` answers
    queries by interpolating its matches, one that only has `track` by tracking from one image to
    the other.

    Args:
        method: A matcher, an object with one of its methods, or a function
            (source, target, queries (N, 2)) -> positions (N, 2) or `Answers`.
        name: Name for an object that has none; None takes its class's.
        options: What it was made with, for the default description.

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
        check_takes_queries(chosen)
        return FunctionMatcher(chosen, name, options)
    kind = type(chosen)
    _check_answer(chosen)
    _fill(chosen, "name", name or kind.__name__)
    implementation = f"{kind.__module__}.{kind.__qualname__}"
    _fill(chosen, "describe", functools.partial(dict, _facts(implementation, options)))
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


def _facts(implementation: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what describes a method without `describe`; of values that JSON lacks, their text."""
    facts: dict[str, Any] = {"implementation": implementation}
    if options:
        text = json.dumps(dict(options), default=lambda value: f"{value!r:.80}")
        facts["options"] = json.loads(text)
    return facts


def _answer_by_track(tracker: TrackMatcher, pair: Pair) -> Answers | None:
    tracks = tracker.track([pair.source, pair.target], pair.uv_a_px)
    return next(iter(tracks), None) if isinstance(tracks, Iterable) else None


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


MatchFunction = Callable[[Frame, Frame, Float32Array], npt.ArrayLike | Answers]
"""(source, target, query pixels (N, 2)) -> their positions in the target (N, 2), pixels, or
`Answers` with more than positions."""


class FunctionMatcher:
    """A matcher that calls a function for every image pair.

    Args:
        function: Returns one position (u, v) per query, with the centre of the first pixel at
            (0.5, 0.5), or `Answers`.
        name: Name of the method; None takes the function's.
        options: What it is called with besides, for the submission's footer.
    """

    def __init__(
        self, function: MatchFunction, name: str | None = None, options: Mapping[str, Any] = {}
    ) -> None:
        self._function, self._facts = function, _facts("a Python function", options)
        self.name = name or function_name(function)

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return self._facts

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels; see `Matcher.answer`."""
        found: Any = self._function(pair.source, pair.target, pair.uv_a_px)
        # The loop checks and converts it, and names the pair.
        return found if isinstance(found, Answers) else Answers(uv_px=found)


def from_function(function: MatchFunction, name: str | None = None) -> FunctionMatcher:
    """Return a matcher that calls a function; see `FunctionMatcher`.

    Raises:
        CallError: It is a function of two images.
    """
    check_takes_queries(function)
    return FunctionMatcher(function, name)


def check_takes_queries(function: Callable[..., Any]) -> None:
    """Refuse a function of two images, which an adapter makes a method of.

    Raises:
        CallError: The function requires two arguments instead of source, target and queries.
    """
    if required_parameters(function) == 2:
        name = function_name(function)
        raise CallError(
            "a function of two images needs an adapter",
            where=name,
            found=f"{name}{inspect.signature(function)}",
            required="(source, target, queries) -> positions",
            fix=f"Wrap it: from_flow({name}) for optical flow, from_warp({name}) for a position of "
            f"each pixel, from_sparse({name}) for matches, all of pliant.baselines.adapters",
        )


def required_parameters(function: Callable[..., Any]) -> int:
    """Return the number of positional parameters without a default, 0 where it is unknown."""
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    try:
        parameters = inspect.signature(function).parameters.values()
    except ValueError:  # a built-in without a signature
        return 0
    return sum(each.kind in kinds and each.default is each.empty for each in parameters)
