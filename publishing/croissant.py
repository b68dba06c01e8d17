"""`croissant.json`: the dataset for catalogues and loaders (Croissant 1.1)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from pliant.publishing import pairs
from pliant.publishing.card import is_recorded
from pliant.publishing.papers import licence_url, web_page
from pliant.spec.dataset import Dataset
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage import layout
from pliant.spec.storage.packing import FRAMES, ROWS
from pliant.spec.tables import QUERIES, SEQUENCES, TRUTH

FILE: Final = "croissant.json"

CONFORMS_TO: Final = "http://mlcommons.org/croissant/1.1"

_ENCODINGS: Final = {
    ".parquet": "application/x-parquet",
    ".json": "application/json",
    ".tar": "application/x-tar",
    ".jpg": "image/jpeg",
    ".md": "text/markdown",
}


def write_croissant(
    dataset: Dataset, root: Path, *, authors: Sequence[str], url: str | None, date: str | None
) -> None:
    """Write `croissant.json` of a packed dataset.

    Args:
        dataset: The dataset.
        root: Its folder, every file of which but this one, the checksums and the manifest is there.
        authors: Who publishes it.
        url: Where it will be hosted, or None.
        date: Day of the release, YYYY-MM-DD, or None.
    """
    info = dataset.info
    document = {
        "@context": _resource("croissant.context.json"),
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": dataset.id,
        "alternateName": info["title"],
        "description": info["description"] or info["title"],
        "version": dataset.version,
        "license": licence_url(info["licence"]) or info["licence"],
        "creator": [{"@type": "sc:Organization", "name": author} for author in authors],
        "citeAs": f"{', '.join(authors)}: {info['title']}, version {dataset.version}",
        "keywords": ["dense correspondence", "deformable objects", *dataset.tiers],
        "isLiveDataset": False,
        **_responsible(dataset),
        "distribution": _distribution(root),
        "recordSet": _record_sets(dataset, root),
        "url": web_page(url),
        "datePublished": date,
    }
    write_json(root / FILE, {key: value for key, value in document.items() if value is not None})


def _responsible(dataset: Dataset) -> dict[str, Any]:
    """Return the RAI fields: how the data came about and what it should not be taken for."""
    provenance = dataset.info["provenance"]
    rendered = provenance["config"] != {} and not is_recorded(dataset)
    fields = dict(_resource("croissant.rai.json")["rendered" if rendered else "recorded"])
    fields["rai:dataCollection"] += f" Made with {provenance['generator']}."
    if dataset.held_out:
        fields["rai:dataCollectionMissingData"] = (
            f"The answers of {', '.join(dataset.held_out)} are held out for evaluation."
        )
    return fields


def _distribution(root: Path) -> list[dict[str, Any]]:
    """Return a FileObject for every file that is described."""
    left_out = {FILE, layout.CHECKSUMS, layout.MANIFEST_JSON}
    names = {p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file()}
    return [
        {
            "@type": "cr:FileObject",
            "@id": name,
            "name": name,
            "contentUrl": name,
            "contentSize": f"{(root / name).stat().st_size} B",
            "encodingFormat": _ENCODINGS.get(Path(name).suffix, "text/plain"),
            "sha256": sha256_file(root / name),
        }
        for name in sorted(names - left_out)
    ]


def _record_sets(dataset: Dataset, root: Path) -> list[dict[str, Any]]:
    """Return a RecordSet for every table."""
    joins = dict.fromkeys(("sequence", "sequence_a", "sequence_b"), "sequences/id")
    pair = ["pair_id", "query_id"]
    sets = [_of_table("sequences", layout.SEQUENCES_TABLE, SEQUENCES, ["id"], {})]
    for split in dataset.splits_with_queries():
        asked = f"queries_{split}"
        sets.append(_of_table(asked, layout.queries_name(split), QUERIES, pair, joins))
        truth = layout.truth_name(split)
        if dataset.has(truth):
            # No references to the queries: mlcroissant joins by one column, and gives each answer
            # once for every query of its pair.
            sets.append(_of_table(f"truth_{split}", truth, TRUTH, pair, {}))
    for folder, schema, key in (
        ("frames", FRAMES, ["sequence", "frame"]),
        ("correspondences", ROWS, ["sequence", "frame", "point"]),
        (layout.PAIRS_DIR, pairs.SCHEMA, ["pair_id"]),
    ):
        for path in sorted((root / folder).glob("*.parquet")):
            name = f"{folder}_{path.stem.replace('-', '_')}"
            sets.append(_of_table(name, path.relative_to(root).as_posix(), schema, key, joins))
    return sets


def _of_table(
    name: str, file: str, schema: pa.Schema, key: Sequence[str], joins: dict[str, str]
) -> dict[str, Any]:
    """Return the record set of one Parquet file."""
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": f"The rows of {file}.",
        "key": [{"@id": f"{name}/{column}"} for column in key],
        "field": [_field(name, file, column, joins) for column in schema],
    }


def _field(name: str, file: str, column: pa.Field, joins: dict[str, str]) -> dict[str, Any]:
    own = f"{name}/{column.name}"
    text = (column.metadata or {}).get(b"doc", b"").decode()
    field: dict[str, Any] = {
        "@type": "cr:Field",
        "@id": own,
        "name": column.name,
        "description": text or column.name.replace("_", " "),
        "dataType": _data_type(column),
        "source": {"fileObject": {"@id": file}, "extract": {"column": column.name}},
    }
    if pa.types.is_struct(column.type):  # an image
        field["source"]["transform"] = {"jsonPath": "bytes"}
    if pa.types.is_list(column.type):
        field |= {"isArray": True, "arrayShape": "-1"}
        if pa.types.is_struct(column.type.value_type):
            source = field.pop("source")
            del field["dataType"]
            field["subField"] = [
                {
                    **_field(own, file, part, {}),
                    "source": source | {"transform": {"jsonPath": part.name}},
                }
                for part in column.type.value_type
            ]
    if column.name in joins:
        field["references"] = {"field": {"@id": joins[column.name]}}
    return field


def _data_type(column: pa.Field) -> str:
    kind = column.type.value_type if pa.types.is_list(column.type) else column.type
    if pa.types.is_struct(column.type):
        return "sc:ImageObject"
    if pa.types.is_boolean(kind):
        return "sc:Boolean"
    if pa.types.is_integer(kind):
        return f"cr:Int{kind.bit_width}"
    if pa.types.is_floating(kind):
        return f"cr:Float{kind.bit_width}"
    return "sc:Text"


def _resource(name: str) -> Any:
    return json.loads((files("pliant.publishing") / name).read_text("utf-8"))
