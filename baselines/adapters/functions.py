"""A matcher that calls a plain function for every image pair."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.baselines.adapters.images import to_array
from pliant.spec.answers import Answers
from pliant.spec.errors import CallError
from pliant.spec.frame import Frame, Pair

MatchFunction = Callable[[Frame, Frame, npt.NDArray[np.float32]], npt.ArrayLike]
"""(source, target, query pixels (N, 2)) -> their positions in the target (N, 2), pixels."""


class FunctionMatcher:
    """A matcher that calls a function for every image pair.

    Args:
        function: Returns one position (u, v) per query, with the centre of the first pixel at
            (0.5, 0.5).
        name: Name of the method; None takes the function's.
    """

    def __init__(self, function: MatchFunction, name: str | None = None) -> None:
        self._function = function
        self.name = name or function_name(function)

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return {"implementation": "a Python function"}

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels; see `Matcher.answer`."""
        positions = to_array(self._function(pair.source, pair.target, pair.uv_a_px))
        return Answers(uv_px=positions.astype(np.float32))


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


def function_name(function: Callable[..., Any]) -> str:
    """Return a function's own name, that of the function in a partial call, or its class's."""
    function = getattr(function, "func", function)
    return str(getattr(function, "__name__", type(function).__name__))
