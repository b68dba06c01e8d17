"""Settings are frozen dataclasses; here they come from, and go to, plain JSON values."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from pliant.spec.errors import CallError

S = TypeVar("S")


def settings_from(cls: type[S], values: Mapping[str, Any], where: str) -> S:
    """Build a settings dataclass from JSON values, refusing keys that it does not know.

    Args:
        cls: A frozen dataclass that checks its values in `__post_init__`.
        values: Field name -> value; lists stand for tuples, mappings for nested settings.
        where: Dotted name of these settings in the whole config, for messages.

    Returns:
        The settings; fields that are not named keep their defaults.

    Raises:
        CallError: An unknown key, a value of the wrong type, or one the class refuses.
    """
    if not isinstance(values, Mapping):
        raise CallError("settings must be a mapping", where=where, found=repr(values))
    known = {field.name: field for field in dataclasses.fields(cls) if field.init}  # type: ignore[arg-type]
    hints = typing.get_type_hints(cls)
    arguments: dict[str, Any] = {}
    for key, value in values.items():
        if key not in known:
            raise CallError(
                "unknown setting",
                where=f"{where}.{key}" if where else str(key),
                required="one of " + ", ".join(sorted(known)),
            )
        arguments[key] = _coerced(value, hints[key], f"{where}.{key}" if where else key)
    try:
        return cls(**arguments)
    except (TypeError, ValueError) as error:
        raise CallError(str(error), where=where or None) from error


def settings_to_dict(settings: Any) -> Any:
    """Return settings as JSON values: nested mappings, lists and scalars."""
    if dataclasses.is_dataclass(settings) and not isinstance(settings, type):
        return {
            field.name: settings_to_dict(getattr(settings, field.name))
            for field in dataclasses.fields(settings)
            if field.init
        }
    if isinstance(settings, Mapping):
        return {str(key): settings_to_dict(value) for key, value in settings.items()}
    if isinstance(settings, list | tuple):
        return [settings_to_dict(value) for value in settings]
    return settings


def _coerced(value: Any, hint: Any, where: str) -> Any:
    """Return `value` as the annotation wants it: list -> tuple, int -> float, mapping -> class."""
    origin = typing.get_origin(hint)
    options = typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if value is None and type(None) in options:
            return None
        rest = [option for option in options if option is not type(None)]
        return _coerced(value, rest[0], where) if len(rest) == 1 else value
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return value if isinstance(value, hint) else settings_from(hint, value, where)
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise CallError("a list is required", where=where, found=repr(value))
        if len(options) == 2 and options[1] is Ellipsis:
            return tuple(_coerced(item, options[0], where) for item in value)
        if len(value) != len(options):
            raise CallError(
                "the list has the wrong length",
                where=where,
                found=len(value),
                required=len(options),
            )
        return tuple(
            _coerced(item, option, where) for item, option in zip(value, options, strict=True)
        )
    if origin is typing.Literal:
        if value not in options:
            raise CallError(
                "unknown value",
                where=where,
                found=repr(value),
                required="one of " + ", ".join(map(str, options)),
            )
        return value
    return _scalar(value, hint, where)


def _scalar(value: Any, hint: Any, where: str) -> Any:
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if hint in (int, float, str, bool) and (
        not isinstance(value, hint) or (hint is not bool and isinstance(value, bool))
    ):
        raise CallError(
            "the value has the wrong type",
            where=where,
            found=repr(value),
            required={int: "a whole number", float: "a number", str: "text"}.get(
                hint, "true or false"
            ),
        )
    return value


def check_range(
    where: str,
    values: tuple[float, float],
    low: float,
    high: float,
    sentence: str = "the range cannot be used",
) -> None:
    """Refuse a range of settings that is none, or leaves what is possible.

    Args:
        where: Dotted name of the setting.
        values: (low, high), of which a value is drawn.
        low: Lowest possible value.
        high: Highest.
        sentence: What the refusal says.

    Raises:
        CallError: It is not two numbers in order, within these.
    """
    if len(values) != 2 or not low <= values[0] <= values[1] <= high:
        raise CallError(
            sentence,
            where=where,
            found=tuple(values),
            required=f"[low, high] with {low:g} <= low <= high <= {high:g}",
        )
