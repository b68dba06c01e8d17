"""Checks of the arguments of the Python API, so that errors name the argument."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from pliant.spec.errors import CallError

PATH = (str, Path)
"""What a file or a folder may be given as."""


def check_type(
    where: str,
    value: object,
    kinds: type | tuple[type, ...],
    *,
    required: str = "",
    fix: str | None = None,
) -> None:
    """Refuse an argument of another type.

    Args:
        where: Name of the argument.
        value: The argument.
        kinds: Its types; True and False are not numbers.
        required: The types in words; empty names the classes.
        fix: What the caller can do.

    Raises:
        CallError: It has another type.
    """
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    if isinstance(value, kinds) and (not isinstance(value, bool) or bool in kinds):
        return
    found = f"the class {value.__name__}" if isinstance(value, type) else repr(value)
    raise CallError(
        "the argument has the wrong type",
        where=where,
        found=f"{found:.80} ({type(value).__name__})",
        required=required or " or ".join(kind.__name__ for kind in kinds),
        fix=fix,
    )


def check_whole(where: str, value: object, least: int = 0, most: int | None = None) -> None:
    """Refuse an argument that is not a whole number within bounds.

    Args:
        where: Name of the argument.
        value: The argument.
        least: Smallest value.
        most: Largest value, None for any.

    Raises:
        CallError: It is not.
    """
    whole = hasattr(value, "__index__") and not isinstance(value, bool)
    if whole and least <= int(value) and (most is None or int(value) <= most):  # type: ignore[call-overload]
        return
    required = f">= {least}" if most is None else f"{least} to {most}"
    raise CallError(
        "the argument must be a whole number",
        where=where,
        found=f"{value!r:.80}",
        required=required,
    )


def check_numbers(
    where: str,
    value: object,
    required: str,
    *,
    count: int | None = None,
    low: float = -math.inf,
    high: float = math.inf,
    strict: bool = False,
) -> None:
    """Refuse an argument that is not a finite number, or a list of them, within bounds.

    Args:
        where: Name of the argument.
        value: The argument.
        required: What it must be, in words.
        count: How many numbers; None for one alone.
        low: Smallest value.
        high: Largest value.
        strict: The bounds themselves are refused.

    Raises:
        CallError: It is not.
    """
    try:
        numbers = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        numbers = np.array(math.nan)
    within = (low < numbers) & (numbers < high) if strict else (low <= numbers) & (numbers <= high)
    if (
        numbers.shape == (() if count is None else (count,))
        and (within & np.isfinite(numbers)).all()
    ):
        return
    raise CallError("invalid argument", where=where, found=f"{value!r:.80}", required=required)
