"""Matchers made of what users have: so far, a plain function."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

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
        self.name = name or getattr(function, "__name__", "function")

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return {"implementation": "a Python function"}

    def answer(self, source: View, target: View, uv_a_px: npt.NDArray[np.float32]) -> Answers:
        """Answer query pixels; see `Matcher.answer`."""
        positions = self._function(source, target, uv_a_px)
        return Answers(uv_px=np.asarray(positions, dtype=np.float32))


def from_function(function: MatchFunction, name: str | None = None) -> FunctionMatcher:
    """Return a matcher that calls a function; see `FunctionMatcher`."""
    return FunctionMatcher(function, name)
