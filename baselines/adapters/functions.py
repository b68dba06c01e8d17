"""A matcher that calls a plain function for every image pair."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.baselines.adapters.images import to_array
from pliant.baselines.matcher import Answers, View

MatchFunction = Callable[[View, View, npt.NDArray[np.float32]], npt.ArrayLike]
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

    def answer(self, source: View, target: View, uv_a_px: npt.NDArray[np.float32]) -> Answers:
        """Answer query pixels; see `Matcher.answer`."""
        positions = to_array(self._function(source, target, uv_a_px))
        return Answers(uv_px=positions.astype(np.float32))


def from_function(function: MatchFunction, name: str | None = None) -> FunctionMatcher:
    """Return a matcher that calls a function; see `FunctionMatcher`."""
    return FunctionMatcher(function, name)


def function_name(function: Callable[..., Any]) -> str:
    """Return a function's own name, that of the function in a partial call, or its class's."""
    function = getattr(function, "func", function)
    return str(getattr(function, "__name__", type(function).__name__))
