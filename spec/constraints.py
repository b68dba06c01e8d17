"""Constraints of settings: bounds with a unit, choices, ranges, weights.

Each is metadata of an annotation in a class of settings (`spec/configuration.py`), such as
`length_m: Annotated[float, Bounds(0.05, 20)]`. It checks the value.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import AfterValidator
from pydantic_core import core_schema

from pliant.spec.conventions import NAME, VERSION
from pliant.spec.text import unsafe_character

UNITS = {
    "m": "m", "px": "px", "deg": "degrees", "rad": "radians", "s": "s", "hz": "Hz",
    "m_s": "m/s", "percent": "percent",
}  # fmt: skip
"""The last part of a setting's name -> its unit."""


class Refused(ValueError):  # noqa: N818
    """A value that a setting cannot have.

    Args:
        required: What is possible.
        field: The setting, below the object that raises; empty for the value itself.
        fix: What the user can do.
    """

    def __init__(self, required: str, field: str = "", fix: str | None = None) -> None:
        super().__init__(f"{field}: {required}" if field else required)
        self.required, self.field, self.fix = required, field, fix


def did_you_mean(name: object, known: Iterable[str]) -> str | None:
    """Return a sentence that names the most similar known name, None where none is similar."""
    close = difflib.get_close_matches(str(name), list(known), n=1)
    return f"Did you mean {close[0]!r}?" if close else None


def unit_of(name: str) -> str:
    """Return the unit that a setting's name ends in, empty where it has none."""
    parts = name.rsplit("_", 2)
    return UNITS.get("_".join(parts[-2:]), "") or UNITS.get(parts[-1] if parts[1:] else "", "")


class _Constraint:
    """Checks a value after its type; subclasses say what is allowed."""

    def check(self, value: Any) -> Any:
        """Return the value to store, or raise `Refused`."""
        raise NotImplementedError

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return core_schema.no_info_after_validator_function(self.check, handler(source))


@dataclass(frozen=True)
class Bounds(_Constraint):
    """A number, every number of a list, or every value of a mapping is within bounds.

    Attributes:
        low: Lowest value.
        high: Highest value.
        unit: Unit, where the setting's name does not end in it.
        above: `low` itself is refused.
        below: `high` itself is refused.
        multiple_of: Whole numbers: what divides them.
    """

    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    above: bool = False
    below: bool = False
    multiple_of: int = 1

    def check(self, value: Any) -> Any:
        """Return the value; None passes.

        Raises:
            Refused: A number is outside.
        """
        for number in _numbers(value):
            if (
                not self.low <= number <= self.high
                or (self.above and number == self.low)
                or (self.below and number == self.high)
                or (self.multiple_of > 1 and number % self.multiple_of)
            ):
                raise Refused(str(self))
        return value

    def __str__(self) -> str:
        if self.high == math.inf:
            text = f"{'>' if self.above else '>='} {self.low:.10g}"
        else:
            low = f"above {self.low:.10g}" if self.above else f"{self.low:.10g}"
            text = f"{low} to {'below ' if self.below else ''}{self.high:.10g}"
        if self.multiple_of > 1:
            text += ", even" if self.multiple_of == 2 else f", a multiple of {self.multiple_of}"
        return f"{text} {self.unit}".rstrip()


@dataclass(frozen=True)
class OneOf(_Constraint):
    """A name is one of some names.

    Attributes:
        names: The possible names.
    """

    names: Collection[str]

    def check(self, value: Any) -> Any:
        """Return the name.

        Raises:
            Refused: It is another; the most similar name is suggested.
        """
        if value not in self.names:
            raise Refused("one of " + ", ".join(self.names), fix=did_you_mean(value, self.names))
        return value


@dataclass(frozen=True)
class Weights(_Constraint):
    """A mapping gives some names weights >= 0, of which one is above 0.

    Attributes:
        names: The possible names.
    """

    names: Collection[str]

    def check(self, value: Mapping[str, float]) -> Mapping[str, float]:
        """Return the weights.

        Raises:
            Refused: An unknown name, a negative weight, or no weight above 0.
        """
        for name, weight in value.items():
            try:
                OneOf(self.names).check(name)
                Bounds(0.0).check(weight)
            except Refused as refused:
                raise Refused(refused.required, name, refused.fix) from None
        if sum(value.values()) <= 0:
            raise Refused("at least one weight above 0")
        return value


@dataclass(frozen=True)
class NotEmpty(_Constraint):
    """A list or a text has something in it."""

    def check(self, value: Any) -> Any:
        """Return the value.

        Raises:
            Refused: It is empty.
        """
        if not value:
            raise Refused("not empty")
        return value


@dataclass(frozen=True)
class Pattern(_Constraint):
    """A text has a form.

    Attributes:
        pattern: Regular expression of the whole text.
        words: The form in words.
    """

    pattern: str
    words: str

    def check(self, value: str) -> str:
        """Return the text.

        Raises:
            Refused: It has another form.
        """
        if not re.fullmatch(self.pattern, value):
            raise Refused(self.words)
        return value


def _shown(value: str) -> str:
    if unsafe_character(value, lines=True) is not None:
        raise Refused("a text without control and bidirectional characters")
    return value


def _ordered(value: Any) -> Any:
    if value[0] > value[1]:
        raise Refused("[low, high] with low <= high")
    return value


@dataclass(frozen=True)
class DrawnFrom:
    """A value may also be given as the range [low, high] that it is drawn from.

    Attributes:
        source: Type of the range.
    """

    source: Any

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return core_schema.tagged_union_schema(
            {"[value]": handler(source), "[source]": handler.generate_schema(self.source)},
            lambda value: "[source]" if isinstance(value, list | tuple) else "[value]",
        )


Name = Annotated[
    str,
    Pattern(
        NAME,
        "1 to 128 of A-Z, a-z, 0-9, '.', '_', '-', without '..', a letter or digit at both ends",
    ),
]
"""A name that a dataset, a tier or a folder can have."""

Version = Annotated[str, Pattern(VERSION, "three numbers, such as 1.0.0")]
"""A version of a dataset."""

Shown = Annotated[str, AfterValidator(_shown)]
"""A text for people, of one or more lines."""

Range = Annotated[tuple[float, float], AfterValidator(_ordered)]
"""(low, high) with low <= high."""

WholeRange = Annotated[tuple[int, int], AfterValidator(_ordered)]
"""(low, high), whole numbers with low <= high."""

Count = Annotated[int, Bounds(1)]
"""A whole number >= 1."""

Natural = Annotated[int, Bounds(0)]
"""A whole number >= 0."""

Positive = Annotated[float, Bounds(0, above=True)]
"""A number > 0."""

NonNegative = Annotated[float, Bounds(0)]
"""A number >= 0."""

Share = Annotated[float, Bounds(0, 1)]
"""A number from 0 to 1."""


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, tuple | list):
        for each in value:
            yield from _numbers(each)
    elif value is not None:
        yield value
