"""YAML: the core schema of version 1.2, within limits."""

from __future__ import annotations

import datetime
from pathlib import Path

import pytest
import yaml

from pliant.spec.errors import CallError, SpecError
from pliant.spec.io import limits
from pliant.spec.io.yamlfiles import SettingsFileError, parse_yaml, read_yaml, yaml_text


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("-2E+4", -2e4),
        ("5.", 5.0),
        (".5", 0.5),
        ("010", 10),
        ("0o10", 8),
        ("0x1F", 31),
        ("-7", -7),
        ("true", True),
        ("False", False),
        ("yes", "yes"),
        ("on", "on"),
        ("12:30", "12:30"),
        ("1_000", "1_000"),
        ("0b11", "0b11"),
        ("2024-01-02", "2024-01-02"),
        ("=", "="),
        ("~", None),
        ("", None),
        ("Null", None),
        ("'1e-3'", "1e-3"),
        ("!!str 12", "12"),
        ("{a: [1, 2.5], b: }", {"a": [1, 2.5], "b": None}),
    ],
)
def test_values_follow_the_core_schema_of_yaml_1_2(text: str, value: object) -> None:
    found = parse_yaml(text)
    assert found == value
    assert type(found) is type(value)


def test_merge_keys_and_aliases_are_read() -> None:
    text = "a: &a {x: 1, y: 1}\nb: &b {<<: *a, y: 2}\nc: {<<: *b, z: 3}\nd: *a\n"
    found = parse_yaml(text)
    assert found["b"] == {"x": 1, "y": 2}
    assert found["c"] == {"x": 1, "y": 2, "z": 3}
    assert found["d"] == {"x": 1, "y": 1}


def _laughs(levels: int) -> str:
    """Return the "billion laughs": each level is nine aliases of the one before."""
    lines = ["a0: &a0 [lol]"]
    for k in range(1, levels):
        lines.append(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]")
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: 1\nb: 2\na: 3", r"the key 'a' twice \(line 3, column 1\)"),
        ("x: {a: 1, a: 1}", "the key 'a' twice"),
        ("a: [", "line 1"),
        ("a: b: c", "mapping values are not allowed"),
        ("a: 1\n---\nb: 2", "another document"),
        ("!!python/object:os.system x", "python/object:os.system is not allowed"),
        ("!!timestamp 2024-01-02", "!!timestamp is not allowed"),
        ("!mine x", "!mine is not allowed"),
        ("&a [*a]", "alias inside its own anchor"),
        ("*missing", "undefined alias"),
        ("1e999", "1e999 is not a finite number"),
        (".nan", "not a finite number"),
        ("9" * 5000, "not a finite number"),
        ("!!int x", "x is not a finite number"),
        ("[a]: 1\n? [b]\n: 2", "unhashable"),
        ("a: \x07", "special characters"),
        ("[" * 65 + "]" * 65, "nested deeper than 64 levels"),
        ("[" * 200_000, "nested deeper than 64 levels"),
        ("{a: " * 50_000, "nested deeper than 64 levels"),
        ("- " * 100_000, "nested deeper than 64 levels"),
        (_laughs(9), "more than 50000 values, aliases expanded"),
        ("a: &a {x: 1}\nb: {<<: [" + "*a, " * 30_000 + "]}", "more than 50000 values"),
    ],
)
@pytest.mark.timeout(60)  # none may expand
def test_what_is_refused(text: str, says: str) -> None:
    with pytest.raises(SettingsFileError, match=says) as caught:
        parse_yaml(text, "x.yaml", "field")
    assert str(caught.value).startswith("x.yaml, field: ")
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2
    assert isinstance(caught.value, SpecError)
    assert isinstance(caught.value, CallError)


def test_depth_at_the_limit_is_read() -> None:
    assert parse_yaml("[" * 64 + "]" * 64)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    with pytest.raises(SettingsFileError, match="No such file"):
        read_yaml(path)
    with pytest.raises(SettingsFileError, match="Is a directory"):
        read_yaml(tmp_path)
    path.write_bytes(b"a: \xff")
    with pytest.raises(SettingsFileError, match=r"not YAML.*utf-8"):
        read_yaml(path)
    path.write_bytes(b"#" * (limits.MAX_YAML_BYTES + 1))
    with pytest.raises(SettingsFileError, match="too large"):
        read_yaml(path)
    path.write_bytes(b"")
    assert read_yaml(path) is None
    path.write_bytes(b"\xef\xbb\xbfa: 1")
    assert read_yaml(path) == {"a": 1}


def test_json_is_read_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(b'\xef\xbb\xbf{\n\t"a": 1e-3}')
    assert read_yaml(path) == {"a": 1e-3}
    path.write_text('{"a": 1, "a": 2}')
    with pytest.raises(SettingsFileError, match="'a' twice"):
        read_yaml(path)


def test_what_is_written_reads_the_same_in_both_versions() -> None:
    shared = [1, 2]
    texts = ["1e-3", "yes", "no", "on", "y", "010", "0o10", "12:30", "1_0", "", "~", "<<", "null"]
    document = {
        "texts": [*texts, "2024-01-02", "a: b", "größe", "0x1F", "=", ".inf", "5.", "!x", "- a"],
        "numbers": [1e-5, 1e22, 0.1, -3, 10**20, 1e16],
        "others": [True, False, None, {}, []],
        "shared": [shared, shared],
    }
    text = yaml_text(document)
    assert parse_yaml(text) == document
    assert yaml.safe_load(text) == document
    assert "&" not in text
    assert not any(isinstance(v, datetime.date) for v in parse_yaml(text)["texts"])
