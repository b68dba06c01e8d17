"""YAML files of settings: the core schema of YAML 1.2, bounded in size, depth and aliases.

PyYAML's own safe loader follows YAML 1.1: `no` is false, `010` is eight, `12:30` is 750, `1e-3` is
text, and the second of two equal keys wins. This is the only loader in the package.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any, ClassVar

import yaml

from pliant.spec.errors import CallError, SpecError
from pliant.spec.io import limits
from pliant.spec.io.jsonfiles import parse_json
from pliant.spec.io.reading import FileRefusedError

_NULL = re.compile(r"~|null|Null|NULL|")
_BOOL = re.compile(r"true|True|TRUE|false|False|FALSE")
_INT = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(
    r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
)
_TAG = "tag:yaml.org,2002:"


class SettingsFileError(SpecError, CallError):
    """A file or a value of settings cannot be read: the call that names it is wrong."""


def read_yaml(path: Path | str) -> Any:
    """Read a YAML file, or a JSON file where the name ends in `.json`.

    Args:
        path: The file: UTF-8, one document, within the limits.

    Returns:
        Mappings, lists, text, numbers, booleans and None; None for an empty file.

    Raises:
        SettingsFileError: The file cannot be read, or as `parse_yaml`.
    """
    try:
        with open(path, "rb") as stream:
            data = stream.read(limits.MAX_YAML_BYTES + 1)
        text = data[: limits.MAX_YAML_BYTES].decode("utf-8-sig")
    except OSError as error:
        raise SettingsFileError("cannot read the file", path=path, found=error.strerror) from error
    except UnicodeDecodeError as error:
        raise SettingsFileError("the file is not YAML", path=path, found=str(error)) from error
    if len(data) > limits.MAX_YAML_BYTES:
        raise SettingsFileError(
            "the YAML file is too large",
            path=path,
            required=f"at most {limits.MAX_YAML_BYTES} bytes",
        )
    if not str(path).endswith(".json"):
        return parse_yaml(text, path)
    try:
        return parse_json(text.encode(), path)
    except FileRefusedError as error:
        raise SettingsFileError(error.message, path=path, found=error.found) from error


def parse_yaml(text: str, path: Path | str | None = None, where: str | None = None) -> Any:
    """Parse one YAML document by the core schema of YAML 1.2, plus merge keys (`<<`).

    `yes`, `no`, `on`, `off` and dates are text; `1e-3` is a number; `010` is ten.

    Args:
        text: The document.
        path: The file it comes from, for messages.
        where: The option or field it comes from, for messages.

    Returns:
        As `read_yaml`.

    Raises:
        SettingsFileError: It is not YAML, has a key twice, a tag, a number that is not finite, an
            alias inside its own anchor, or exceeds the limits on depth and values.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError) as error:
        raise SettingsFileError(
            "this is not YAML that can be read", path=path, where=where, found=_reason(error)
        ) from error


def yaml_text(document: Any) -> str:
    """Return YAML text that this loader and one for YAML 1.1 read the same; keys keep their order.

    Args:
        document: Mappings, lists, text, finite numbers, booleans and None.
    """
    return str(yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True))


def _reason(error: Exception) -> str:
    """Return an error of PyYAML in one line: the problem, its line and its column."""
    if not isinstance(error, yaml.MarkedYAMLError):
        return " ".join(str(error).split())[:200]
    mark = error.problem_mark or error.context_mark
    place = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
    return f"{error.problem or error.context}{place}"


class _Loader(yaml.SafeLoader):
    """Composes within the limits and builds the types of the core schema."""

    yaml_implicit_resolvers: dict[Any, list[Any]] = {}  # noqa: RUF012
    yaml_constructors: ClassVar[dict[Any, Any]] = {}

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0
        self._values = 0
        self._sizes: dict[int, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose one node; an alias counts as many values as its anchor."""
        mark = self.peek_event().start_mark
        alias = self.check_event(yaml.AliasEvent)
        before = self._values
        self._depth += 1
        if self._depth > limits.MAX_YAML_DEPTH:
            raise yaml.composer.ComposerError(
                None, None, f"nested deeper than {limits.MAX_YAML_DEPTH} levels", mark
            )
        node = super().compose_node(parent, index)
        self._depth -= 1
        if not alias and isinstance(node, yaml.MappingNode):
            _check_keys(node)
        if alias and id(node) not in self._sizes:
            raise yaml.composer.ComposerError(None, None, "an alias inside its own anchor", mark)
        self._values += self._sizes[id(node)] if alias else 1
        if self._values > limits.MAX_YAML_VALUES:
            raise yaml.composer.ComposerError(
                None, None, f"more than {limits.MAX_YAML_VALUES} values, aliases expanded", mark
            )
        self._sizes[id(node)] = self._values - before
        return node


def _check_keys(node: yaml.MappingNode) -> None:
    seen = set()
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode) and (key.tag, key.value) in seen:
            raise yaml.composer.ComposerError(
                None, None, f"the key {key.value[:80]!r} twice", key.start_mark
            )
        seen.add((key.tag, str(key.value)))


def _number(loader: _Loader, node: Any) -> float | int:
    text = node.value
    try:
        if node.tag == _TAG + "float":
            value = float(text)
            if math.isfinite(value):
                return value
        elif text.startswith(("0x", "0o")):
            return int(text[2:], 16 if text[1] == "x" else 8)
        else:
            return int(text)
    except ValueError:
        pass
    raise yaml.constructor.ConstructorError(
        None, None, f"{text:.40} is not a finite number", node.start_mark
    )


def _refuse(loader: _Loader, node: Any) -> Any:
    tag = str(node.tag).replace(_TAG, "!!")
    raise yaml.constructor.ConstructorError(
        None, None, f"the tag {tag:.80} is not allowed", node.start_mark
    )


class _Dumper(yaml.SafeDumper):
    """Quotes text that YAML 1.1 or 1.2 would read as something else, and writes no aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


for _name, _pattern, _first in (
    ("null", _NULL, ["~", "n", "N", ""]),
    ("bool", _BOOL, list("tTfF")),
    ("int", _INT, list("-+0123456789")),
    ("float", _FLOAT, list("-+.0123456789")),
    ("merge", re.compile("<<"), ["<"]),
):
    _whole = re.compile(rf"(?:{_pattern.pattern})\Z")
    _Loader.add_implicit_resolver(_TAG + _name, _whole, _first)
    _Dumper.add_implicit_resolver(_TAG + _name, _whole, _first)
for _name, _build in (
    ("null", yaml.SafeLoader.construct_yaml_null),
    ("bool", yaml.SafeLoader.construct_yaml_bool),
    ("int", _number),
    ("float", _number),
    ("str", yaml.SafeLoader.construct_yaml_str),
    ("seq", yaml.SafeLoader.construct_yaml_seq),
    ("map", yaml.SafeLoader.construct_yaml_map),
):
    _Loader.add_constructor(_TAG + _name, _build)
_Loader.add_constructor(None, _refuse)
