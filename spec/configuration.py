"""Settings: frozen models that check themselves, from YAML or JSON files and `--set a.b=c`.

A class of settings is a pydantic model, a subclass of `Settings`. Types, bounds and units are in
its annotations (`spec/constraints.py`); a `model_validator` checks one field against another and
raises `Refused`. Everything else follows from the class: reading, `--set`, messages with
suggestions, and the plain values that a dataset or a run stores.
"""

from __future__ import annotations

import json
import re
import typing
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Self, TypeVar

import pydantic
from pydantic_core import to_jsonable_python

from pliant.spec.constraints import Refused, did_you_mean, unit_of
from pliant.spec.errors import CallError
from pliant.spec.io.yamlfiles import parse_yaml, read_yaml
from pliant.spec.text import shortened

__all__ = [
    "Settings", "SettingsError", "merged", "read_mapping", "read_settings",
    "settings_from", "settings_to_dict", "with_overrides",
]  # fmt: skip


_TYPES: Final = {
    "int": "a whole number",
    "float": "a number",
    "finite": "a finite number",
    "string": "text",
    "bool": "true or false",
    "tuple": "a list",
    "list": "a list",
    "dict": "a mapping of names to values",
    "model": "a mapping of settings",
    "datetime": "a time, such as 2027-03-01T00:00:00Z",
    "none": "null",
}
"""First word of a type error of pydantic -> what is required."""


class SettingsError(CallError):
    """Settings are refused; the text has one sentence per problem."""

    def __init__(self, problems: Sequence[CallError]) -> None:
        super().__init__(**vars(problems[0]))
        self.problems = tuple(problems)
        self.args = ("\n".join(map(str, problems)),)


class Settings(pydantic.BaseModel):
    """Base of every class of settings: frozen, without conversions, and without unknown keys.

    Its `SettingsError` has one sentence per problem, whether it is made from keyword arguments or
    by `settings_from`, which takes the plain values of a file.
    """

    model_config = pydantic.ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
    )

    if not typing.TYPE_CHECKING:  # type checkers know the fields as keyword arguments

        def __init__(self, **values: Any) -> None:
            try:
                super().__init__(**values)
            except pydantic.ValidationError as error:
                raise SettingsError(_problems(type(self), error)) from None

        # Else pydantic calls it for each nested settings, whose problems would lack their place.
        __init__.__pydantic_base_init__ = True

    def replace(self, **changes: Any) -> Self:
        """Return settings with some values changed, checked like the whole.

        Raises:
            SettingsError: The class refuses the new values.
        """
        return settings_from(type(self), {**_values(self), **changes})


S = TypeVar("S", bound=Settings)


def settings_from(
    cls: type[S],
    values: Mapping[str, Any],
    where: str = "",
    *,
    path: Path | None = None,
    overrides: Sequence[str] = (),
) -> S:
    """Build settings from plain values.

    Args:
        cls: A class of settings.
        values: Field name -> value.
        where: Dotted name of these settings, for messages.
        path: File that the values come from, for messages.
        overrides: `dotted.key=value` texts, as `with_overrides` takes them.

    Returns:
        The settings; fields that are not named keep their defaults.

    Raises:
        SettingsError: An unknown key, a wrong type, or a value that the class refuses.
    """
    if not isinstance(values, Mapping):
        raise CallError(
            "settings must be a mapping", path=path, where=where or None, found=_shown(values)
        )
    # Strict JSON takes lists for tuples, mappings for settings, and no other conversion.
    document = json.dumps(with_overrides(values, overrides), default=_jsonable)
    try:
        return cls.model_validate_json(document)
    except pydantic.ValidationError as error:
        raise SettingsError(_problems(cls, error, where, path, overrides)) from None


def read_settings(
    cls: type[S],
    path: Path | None,
    overrides: Sequence[str] = (),
) -> S:
    """Build settings from a YAML or JSON file and `--set` overrides.

    Args:
        cls: A class of settings.
        path: The file, or None for the defaults.
        overrides: As for `with_overrides`.

    Raises:
        CallError: The file cannot be read.
        SettingsError: As `settings_from`.
    """
    values = read_mapping(path) if path is not None else {}
    return settings_from(cls, values, path=path, overrides=overrides)


def read_mapping(path: Path) -> dict[str, Any]:
    """Read the mapping of a YAML or JSON file of settings; an empty file has none.

    Raises:
        CallError: The file cannot be read or is not a mapping.
    """
    values = read_yaml(path)
    if values is not None and not isinstance(values, dict):
        raise CallError(
            "the file must be a mapping of settings", path=path, found=type(values).__name__
        )
    return values or {}


def with_overrides(values: Mapping[str, Any], overrides: Iterable[str]) -> dict[str, Any]:
    """Return plain values with `--set` overrides applied; the given ones stay as they are.

    Args:
        values: Plain values.
        overrides: `dotted.key=value`, the value in YAML: `1e-3`, `[8, 16]`, `{kind: muon}`.

    Raises:
        CallError: An override has no `=`, its value is not YAML, or a part of its key names a
            value that has no settings inside.
    """
    result = dict(values)
    for text in overrides:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise CallError(
                "--set needs KEY=VALUE", found=repr(text), fix="For example: --set seed=1"
            )
        parts = key.strip().split(".")
        inner: Any = result
        for depth, part in enumerate(parts[:-1]):
            inner = inner.get(part) or {}
            if not isinstance(inner, Mapping):
                raise CallError(
                    "this setting has no settings inside",
                    where=f"--set {key.strip()}",
                    found=f"{'.'.join(parts[: depth + 1])} = {_shown(inner)}",
                )
        nested = parse_yaml(value, where=f"--set {key.strip()}")
        for part in parts[:0:-1]:
            nested = {part: nested}
        result = merged(result, {parts[0]: nested})
    return result


def merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return plain values of which `over` replaces those of `base`, mapping by mapping."""
    result = dict(base)
    for key, value in over.items():
        inner: Any = result.get(key)
        both = isinstance(value, Mapping) and isinstance(inner, Mapping)
        result[key] = merged(inner, value) if both else value
    return result


def settings_to_dict(settings: Any) -> Any:
    """Return settings, or any dataclass, as JSON values: nested mappings, lists and scalars."""
    return to_jsonable_python(settings, serialize_as_any=True)


def _values(settings: pydantic.BaseModel) -> dict[str, Any]:
    """Return the values of the fields; a model's own iterator gives cached properties too."""
    return {name: getattr(settings, name) for name in type(settings).model_fields}


def _jsonable(value: Any) -> Any:
    if isinstance(value, pydantic.BaseModel):
        return _values(value)
    if isinstance(value, Mapping):
        return dict(value)
    return value.item() if hasattr(value, "item") else str(value)


def _problems(
    cls: type[Settings],
    error: pydantic.ValidationError,
    where: str = "",
    path: Path | None = None,
    overrides: Sequence[str] = (),
) -> list[CallError]:
    """Return every error of pydantic as a sentence of ours."""
    overridden = [text.partition("=")[0].strip() for text in overrides]
    return [
        _problem(cls, each, where, path, overridden) for each in error.errors(include_url=False)
    ]


def _problem(
    cls: type[Settings], raw: Any, where: str, path: Path | None, overridden: Sequence[str]
) -> CallError:
    """Return one error of pydantic as a sentence of ours."""
    place = [part for part in raw["loc"] if str(part) not in ("[key]", "[value]", "[source]")]
    kind, value, context = raw["type"], raw["input"], raw.get("ctx", {})
    found: str | None = _shown(value)
    message, required, fix = "invalid setting", raw["msg"], None
    refused = context.get("error")
    if isinstance(refused, Refused):
        required, fix = refused.required, refused.fix
        for part in filter(None, refused.field.split(".")):
            place.append(part)
            value = value.get(part, _default(cls, place)) if isinstance(value, Mapping) else value
        found = _shown(value)
        unit = unit_of(next((part for part in place[::-1] if isinstance(part, str)), ""))
        if unit and required[-1:].isdigit():
            required += f" {unit}"
    elif kind == "extra_forbidden":
        known = list(_hint_at(cls, place[:-1]).model_fields)
        name, colon, text = str(place[-1]).partition(":")  # in YAML, {a:1} is a name without value
        message, found, fix = "unknown setting", None, did_you_mean(name, known)
        required = None if fix or name in known else "one of " + ", ".join(known)
        if colon and (name in known or not fix):
            fix = f"Write a space after the colon: {name}: {text}"
    elif kind == "too_long" or (kind == "missing" and isinstance(place[-1], int)):
        place = [*place[:-1]] if kind == "missing" else place
        message = "the list has the wrong length"
        required = f"{len(typing.get_args(_hint_at(cls, place))) or 2} values"
    elif kind == "missing":
        message, found, required = "a setting is missing", None, None
        fix = f"Add {place[-1]}"
    elif kind == "literal_error":
        names = re.findall(r"'([^']*)'", context["expected"]) or [context["expected"]]
        message, required = "unknown value", "one of " + ", ".join(names)
        fix = did_you_mean(value, names)
    elif kind.rpartition("_")[0] in _TYPES or kind.startswith(("datetime_", "finite_")):
        message, required = "the value has the wrong type", _TYPES[kind.partition("_")[0]]
    dotted = ".".join(str(part) for part in (where, *place) if part != "")
    from_call = any(
        f"{dotted}.".startswith(f"{key}.")
        or (message == "unknown setting" and key.startswith(f"{dotted}."))
        for key in overridden
    )
    return CallError(
        message, path="--set" if from_call else path, where=dotted or None,
        found=found, required=required, fix=fix,
    )  # fmt: skip


def _shown(value: Any) -> str:
    return shortened(json.dumps(value, default=str), 80)


def _hint_at(cls: type[Settings], place: Sequence[Any]) -> Any:
    """Return the type of a place in the settings, without None."""
    hint: Any = cls
    for part in place:
        if isinstance(hint, type) and issubclass(hint, Settings):
            field = hint.model_fields.get(str(part))
            hint = None if field is None else field.annotation
        else:
            hint = next((each for each in typing.get_args(hint)[::-1] if each is not ...), None)
        options = [each for each in typing.get_args(hint) if each is not type(None)]
        if len(options) == 1 and type(None) in typing.get_args(hint):
            hint = options[0]
    return hint


def _default(cls: type[Settings], place: Sequence[Any]) -> Any:
    """Return the default of the field at a place, None where it has none."""
    field = getattr(_hint_at(cls, place[:-1]), "model_fields", {}).get(str(place[-1]))
    if field is None or field.is_required():
        return None
    return settings_to_dict(field.get_default(call_default_factory=True))
