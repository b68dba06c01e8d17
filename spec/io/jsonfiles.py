"""JSON files: strict in reading, canonical in writing."""

from __future__ import annotations

import json
import math
import re
from codecs import BOM_UTF8
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, NoReturn

from jsonschema import Draft202012Validator
from jsonschema.validators import extend

from pliant.spec.conventions import SPEC_VERSION
from pliant.spec.errors import CallError
from pliant.spec.io import limits
from pliant.spec.io.reading import AnyFile, FileRefusedError, read_bytes
from pliant.spec.io.writing import write_file
from pliant.spec.text import escape, shortened, texts_of, unsafe_character

SCHEMAS = files("pliant.spec") / "schemas"


def read_json(path: AnyFile, schema: str | None = None) -> Any:
    """Read a JSON file.

    Args:
        path: The file: UTF-8, no duplicate keys, no NaN or infinity, within the limits.
        schema: Name of a schema of the current version (`dataset`, `sequence`, `cameras` …) it
            must satisfy, or None.

    Raises:
        FileRefusedError: It cannot be read or parsed, or breaks the schema.
    """
    data = parse_json(read_bytes(path, limits.MAX_JSON_BYTES), path)
    if schema is not None:
        for where, message in schema_errors(data, schema):
            raise FileRefusedError(
                "SCHEMA_INVALID", f"breaks {schema}.schema.json: {message}", path=path, where=where
            )
    return data


def parse_json(data: bytes, path: AnyFile) -> Any:
    """Parse JSON strictly: UTF-8, unique keys, finite numbers, bounded depth, safe texts.

    A text with a lone surrogate, a control character (except line feed and tab) or a
    bidirectional control is refused: what a terminal or page shows of it is not what it says.

    Args:
        data: The bytes.
        path: The file they come from, for messages.

    Raises:
        FileRefusedError: With the place and the reason.
    """
    try:
        text = data.decode("utf-8")
        parsed = json.loads(
            text,
            object_pairs_hook=_unique,
            parse_constant=_refuse_constant,
            parse_float=_finite,
            parse_int=_whole,
        )
    except RecursionError as error:
        raise _too_deep(path) from error
    except ValueError as error:
        marked = data.startswith(BOM_UTF8)
        raise FileRefusedError(
            "FILE_UNREADABLE",
            "this is not strict JSON",
            path=path,
            found="a byte order mark" if marked else str(error),
            fix="Save the file as UTF-8 without it." if marked else None,
        ) from error
    level: list[Any] = [parsed]
    for _ in range(limits.MAX_JSON_DEPTH):
        level = [
            child
            for node in level
            if isinstance(node, dict | list)
            for child in (node.values() if isinstance(node, dict) else node)
            if isinstance(child, dict | list)
        ]
        if not level:
            # Without an escape, a text of the document is a part of the file's text.
            if "\\" in text or unsafe_character(text, lines=True) is not None:
                _refuse_unsafe(parsed, path)
            return parsed
    raise _too_deep(path)


def write_json(path: Path | str, document: Any, schema: str | None = None) -> None:
    """Write a JSON file: keys sorted, indent 1, shortest exact floats, a newline at the end.

    Args:
        path: Where to; replaced if it exists.
        document: JSON-able; no NaN or infinity.
        schema: Name of a schema it must satisfy, or None.

    Raises:
        ValueError: The document is not JSON-able or breaks the schema: the caller's mistake.
        CallError: The file cannot be written, or no reader would accept its size; an earlier one is
            unchanged.
    """
    data = json_bytes(document, schema, path)
    if schema is not None and len(data) > limits.MAX_JSON_BYTES:
        raise CallError(
            "the file is larger than the specification allows",
            path=path,
            found=f"{len(data):,} bytes",
            required=f"at most {limits.MAX_JSON_BYTES:,}",
            fix="Divide what it describes, such as a sequence of very many frames.",
        )
    write_file(path, data)


def json_bytes(document: Any, schema: str | None = None, name: Path | str = "document") -> bytes:
    """Return the bytes that `write_json` writes; arguments and errors as there."""
    text = json.dumps(document, indent=1, sort_keys=True, allow_nan=False, ensure_ascii=False)
    if schema is not None:
        for where, message in schema_errors(json.loads(text), schema):
            raise ValueError(f"{name}, {where}: breaks {schema}.schema.json: {message}")
    return (text + "\n").encode("utf-8")


@cache
def read_shipped(name: str) -> dict[str, Any]:
    """Return a JSON file of the specification itself, such as `tables.json`."""
    text = (SCHEMAS / SPEC_VERSION / name).read_text(encoding="utf-8")
    document: dict[str, Any] = json.loads(text)
    return document


def load_schema(name: str) -> dict[str, Any]:
    """Return a JSON Schema of the specification: `dataset`, `sequence`, `footer-TABLE` …."""
    return read_shipped(f"{name}.schema.json")


def _is_integer(_: object, value: object) -> bool:
    """An integer is written without a fraction: 3, not 3.0."""
    return isinstance(value, int) and not isinstance(value, bool)


_Validator = extend(
    Draft202012Validator,
    type_checker=Draft202012Validator.TYPE_CHECKER.redefine("integer", _is_integer),
)


@cache
def _validator(name: str) -> Any:
    return _Validator(load_schema(name))


def schema_errors(document: Any, name: str) -> Iterator[tuple[str, str]]:
    """Yield (place, message) for everything in which a document breaks a schema.

    Unknown fields are not an error in a document whose minor version is newer than this code's.

    Args:
        document: Parsed JSON.
        name: Name of the schema.
    """
    newer = isinstance(document, dict) and is_newer_minor(document.get("spec_version"))
    for error in _validator(name).iter_errors(document):
        if not (newer and error.validator == "additionalProperties"):
            yield error.json_path[1:].removeprefix("."), shortened(error.message, 300)


def is_newer_minor(version: object) -> bool:
    """Return whether a version is of this code's major and of a newer minor version.

    Args:
        version: A `spec_version`, of any type.
    """
    found = re.fullmatch(r"(\d{1,6})\.(\d{1,6})\.\d{1,6}", str(version))
    major, minor, _ = SPEC_VERSION.split(".")
    return found is not None and found[1] == major and int(found[2]) > int(minor)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"the key {key[:80]!r} twice in one object")
        found[key] = value
    return found


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text:.40} is beyond the range of a double")
    return value


def _whole(text: str) -> int:
    value = int(text)
    _finite(text)  # where a number is meant, it becomes a double
    return value


def _refuse_unsafe(document: Any, path: AnyFile) -> None:
    for where, text in texts_of(document):
        found = unsafe_character(text, lines=True)
        if found is not None:
            raise FileRefusedError(
                "FILE_UNREADABLE",
                "the text has a control, bidirectional or surrogate character",
                path=path,
                where=where,
                found=escape(found),
                fix="Remove it.",
            )


def _too_deep(path: AnyFile) -> FileRefusedError:
    return FileRefusedError(
        "FILE_TOO_LARGE",
        "the JSON is nested too deeply",
        path=path,
        required=f"at most {limits.MAX_JSON_DEPTH} levels",
    )
