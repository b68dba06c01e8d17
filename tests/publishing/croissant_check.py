"""What `mlcroissant` accepts and a user would stumble over: columns that no file has, no `name`."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from jsonschema import Draft202012Validator

from pliant.publishing.croissant import FILE
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.io.reading import sha256_file


def croissant_problems(root: Path) -> Iterator[str]:
    """Yield, in words, everything in which `croissant.json` is incomplete or untrue.

    Args:
        root: The dataset.
    """
    document = read_json(root / FILE)
    for error in _validator().iter_errors(document):
        yield f"{'/'.join(map(str, error.absolute_path)) or 'the document'}: {error.message[:200]}"
    objects = {}
    for entry in document.get("distribution", []):
        name = str(entry.get("contentUrl", ""))
        objects[entry.get("@id")] = path = root / name
        if ".." in Path(name).parts or Path(name).is_absolute() or not path.is_file():
            yield f"{name}: the file is not there"
        elif sha256_file(path) != entry.get("sha256"):
            yield f"{name}: the sha256 is not the file's"
    sets = document.get("recordSet", [])
    fields = {field.get("@id") for records in sets for field in records.get("field", [])}
    for records in sets:
        for field in records.get("field", []):
            yield from _field_problems(field, objects, fields)
        for key in records.get("key", []):
            if key.get("@id") not in fields:
                yield f"{records.get('@id')}: the key {key.get('@id')} is not a field"


def _field_problems(
    field: dict[str, Any], objects: Mapping[Any, Path], fields: Collection[Any]
) -> Iterator[str]:
    for part in field.get("subField", []):
        yield from _field_problems(part, objects, fields)
    if "subField" in field:
        return
    own, source = field.get("@id"), field.get("source", {})
    path = objects.get(source.get("fileObject", {}).get("@id"))
    column = source.get("extract", {}).get("column")
    if path is None:
        yield f"{own}: its source is none of the files"
    elif path.is_file() and path.suffix == ".parquet" and column not in _columns(str(path)):
        yield f"{own}: {path.name} has no column {column!r}"
    target = field.get("references", {}).get("field", {}).get("@id")
    if target is not None and target not in fields:
        yield f"{own}: it refers to {target}, which is not a field"


@cache
def _columns(path: str) -> frozenset[str]:
    return frozenset(pq.ParquetFile(path).schema_arrow.names)


@cache
def _validator() -> Draft202012Validator:
    path = Path(__file__).with_name("croissant.schema.json")
    return Draft202012Validator(json.loads(path.read_text()))
