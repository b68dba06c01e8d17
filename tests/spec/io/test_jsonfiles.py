"""JSON: strict in reading, canonical in writing."""

from __future__ import annotations

from pathlib import Path

import pytest

from pliant.spec.errors import CallError
from pliant.spec.io.jsonfiles import (
    is_newer_minor,
    parse_json,
    read_json,
    schema_errors,
    write_json,
)
from pliant.spec.io.reading import FileRefusedError


@pytest.mark.parametrize(
    ("text", "code", "says"),
    [
        (b'{"a": 1, "a": 2}', "FILE_UNREADABLE", "'a' twice"),
        (b'{"a": NaN}', "FILE_UNREADABLE", "NaN"),
        (b'{"a": 1e999}', "FILE_UNREADABLE", "1e999"),
        (b'{"a": -1%s}' % (b"0" * 309), "FILE_UNREADABLE", "000 is beyond the range"),
        (b"\xff\xfe{\x00}\x00", "FILE_UNREADABLE", "utf-8"),
        (b"\xef\xbb\xbf{}", "FILE_UNREADABLE", "found a byte order mark. Save the file as UTF-8"),
        (b"", "FILE_UNREADABLE", "Expecting value"),
        (b"9" * 5000, "FILE_UNREADABLE", "digits"),
        (b"[" * 65 + b"]" * 65, "FILE_TOO_LARGE", "deeply"),
        (b"[" * 200_000, "FILE_TOO_LARGE", "deeply"),
    ],
)
def test_what_is_no_strict_json(text: bytes, code: str, says: str) -> None:
    with pytest.raises(FileRefusedError) as caught:
        parse_json(text, "x.json")
    assert caught.value.code == code
    assert says in str(caught.value)


def test_depth_at_the_limit_is_read() -> None:
    assert parse_json(b"[" * 64 + b"]" * 64, "x.json")


def test_written_text_is_canonical_and_exact(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_json(path, {"b": [0.1, 1 / 3, 5e-324], "a": "θ"})
    assert path.read_text(encoding="utf-8") == (
        '{\n "a": "θ",\n "b": [\n  0.1,\n  0.3333333333333333,\n  5e-324\n ]\n}\n'
    )
    assert read_json(path)["b"] == [0.1, 1 / 3, 5e-324]


def test_writer_refuses_what_readers_would(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="Out of range float"):
        write_json(tmp_path / "a.json", {"a": float("nan")})
    with pytest.raises(ValueError, match=r"cameras\.schema\.json"):
        write_json(tmp_path / "a.json", {"spec_version": "1.0.0"}, "cameras")
    footer = {"spec_version": "1.0.0", "table": "points", "tier": "t" * 2**24}
    with pytest.raises(CallError, match="at most 16,777,216"):
        write_json(tmp_path / "a.json", footer, "footer-points")
    assert not list(tmp_path.iterdir())


def test_a_schema_error_names_its_place(tmp_path: Path) -> None:
    frame = {"frame": 0, "K": [[1, 0, 0]] * 3, "world_to_camera": [[0] * 4] * 3}
    write_json(
        tmp_path / "a.json", {"spec_version": "1.0.0", "width": 1, "height": 1, "frames": [frame]}
    )
    with pytest.raises(FileRefusedError) as caught:
        read_json(tmp_path / "a.json", "cameras")
    assert caught.value.code == "SCHEMA_INVALID"
    assert caught.value.where == "frames[0].world_to_camera"


def test_newer_minor_versions() -> None:
    for version in ("1.1.7", "1.2.0", "1.10.3"):
        assert is_newer_minor(version), version
    for other in ("1.0.0", "1.0.9", "2.1.0", "1.1", "", None, 1.1):
        assert not is_newer_minor(other), other


@pytest.mark.parametrize("width", [64.0, True, "64"])
def test_an_integer_is_written_as_one(width: object) -> None:
    document = {"spec_version": "1.0.0", "width": width, "height": 48, "frames": [{}]}
    places = [where for where, _ in schema_errors(document, "cameras")]
    assert "width" in places
    assert "height" not in places
