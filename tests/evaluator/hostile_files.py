"""Submissions that somebody might send: footers that are right or wrong, and other files."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from tests.evaluator.hostile_tables import Build, case


def footer_case(name: str, text: Callable[[dict[str, Any]], bytes | None], *codes: str) -> None:
    @case(name, *codes)
    def _(scene: Any, path: Path) -> None:
        content = {"spec_version": "1.0.0", "table": "answers", **scene.footer()}
        data = text(content)
        metadata = {} if data is None else {b"pliant": data}
        pq.write_table(scene.table().replace_schema_metadata(metadata), path)


def dumped(**changes: Any) -> Callable[[dict[str, Any]], bytes]:
    return lambda content: json.dumps({**content, **changes}).encode()


def without(*names: str) -> Callable[[dict[str, Any]], bytes]:
    return lambda content: json.dumps(
        {key: value for key, value in content.items() if key not in names}
    ).encode()


def constant(data: bytes) -> Callable[[dict[str, Any]], bytes]:
    return lambda _: data


footer_case("no footer", lambda _: None, "FOOTER_MISSING")
for _name, _data in {
    "empty": b"",
    "text": b"hello",
    "a list": b"[]",
    "a number": b"1",
    "null": b"null",
    "no UTF-8": b"\xff\xfe",
    "cut short": b'{"spec_version": "1.0.0"',
    "with a key twice": b'{"table": "answers", "table": "answers"}',
    "with NaN": b'{"spec_version": NaN}',
    "very deep": b"[" * 100_000,
    "very deep and closed": b'{"a":' * 5000 + b"1" + b"}" * 5000,
}.items():
    footer_case(f"footer {_name}", constant(_data), "FOOTER_INVALID")
footer_case("footer of 2 MB", dumped(method={"name": "x" * 2**21}), "FILE_TOO_LARGE")
for _version in ("2.0.0", "0.9.0", "1", "one", "", None, 1, [1]):
    footer_case(f"version {_version!r}", dumped(spec_version=_version), "SPEC_VERSION_UNSUPPORTED")
footer_case("no version", without("spec_version"), "SPEC_VERSION_UNSUPPORTED")
for _name in ("table", "dataset", "split", "queries_sha256", "method"):
    footer_case(f"footer without {_name}", without(_name), "FOOTER_INVALID")
    values: tuple[Any, ...] = (1, None, [], "§")
    for _value in values:
        footer_case(f"footer {_name} {_value!r}", dumped(**{_name: _value}), "FOOTER_INVALID")
footer_case("footer of a truth", dumped(table="truth"), "FOOTER_INVALID")
footer_case("footer with another field", dumped(extra=1), "FOOTER_INVALID")
footer_case("a method without a name", dumped(method={}), "FOOTER_INVALID")
footer_case("a method with an empty name", dumped(method={"name": ""}), "FOOTER_INVALID")
footer_case("a method with fields of its own", dumped(method={"name": "m", "x": [1, {"y": 2}]}))
footer_case("a method named in code", dumped(method={"name": "<script>alert(1)</script>"}))
footer_case(
    "another dataset", dumped(dataset={"id": "other", "version": "1.0.0"}), "DATASET_MISMATCH"
)
footer_case(
    "another version", dumped(dataset={"id": "analytic", "version": "2.0.0"}), "DATASET_MISMATCH"
)
footer_case("another split", dumped(split="val"), "SPLIT_MISMATCH")
footer_case("other queries", dumped(queries_sha256="0" * 64), "QUERIES_MISMATCH")
footer_case(
    "all of it another's",
    dumped(dataset={"id": "x", "version": "9.0.0"}, queries_sha256="0" * 64),
    "DATASET_MISMATCH",
    "QUERIES_MISMATCH",
)
footer_case("answers called matches", dumped(table="matches"), "COLUMN_MISSING")

# Files -------------------------------------------------------------------------------------


def file_of(data: bytes) -> Build:
    def build(scene: Any, path: Path) -> None:
        path.write_bytes(data)

    return build


for _name, _data in {
    "an empty file": b"",
    "four bytes": b"PAR1",
    "magic numbers alone": b"PAR1" + b"\0" * 100 + b"PAR1",
    "a footer longer than the file": b"PAR1" + b"\0" * 50 + b"\xff\xff\xff\x7fPAR1",
    "a pickle": b"\x80\x04\x95\x10\x00\x00\x00",
    "an encrypted Parquet": b"PARE" + b"\0" * 100 + b"PARE",
}.items():
    case(_name, "FILE_UNREADABLE")(file_of(_data))
case("no file", "FILE_MISSING")(lambda _, path: None)
case("a folder", "FILE_UNREADABLE")(lambda _, path: path.mkdir())
case("a link to nowhere", "FILE_MISSING")(lambda _, path: path.symlink_to("nowhere"))
case("a link to itself", "FILE_MISSING")(lambda _, path: path.symlink_to(path))


@case("a link to a good file")
def _(scene: Any, path: Path) -> None:
    path.symlink_to(scene.submit(path.with_name("real.parquet")))


for _share in range(1, 20):

    @case(f"cut to {_share * 5} %", "FILE_UNREADABLE")
    def _(scene: Any, path: Path, share: float = _share / 20) -> None:
        data = scene.submit(path).read_bytes()
        path.write_bytes(data[: int(len(data) * share)])
