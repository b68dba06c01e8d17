"""Mutations of JSON documents: syntax, schema, tiers, symmetries, cameras, identities."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.conformance.edits import (
    CLOTH_TRAIN,
    ROPE_TRAIN,
    Case,
    change_bytes,
    change_footer,
    change_json,
    change_rows,
    listed,
    write,
)

_DATASET = "dataset.json"
_SEQUENCE = f"{ROPE_TRAIN}/sequence.json"
_CAMERAS = f"{ROPE_TRAIN}/cameras.json"

Change = Callable[[Any], Any]


def _set(*path: str | int, value: Any) -> Change:
    """Return a change that sets one value, by its place."""

    def change(document: Any) -> None:
        node = document
        for part in path[:-1]:
            node = node[part]
        node[path[-1]] = value

    return change


def _delete(name: str) -> Change:
    def change(document: dict[str, Any]) -> None:
        del document[name]

    return change


def _in_dataset(*path: str | int, value: Any) -> Any:
    return change_json(_DATASET, _set(*path, value=value))


def _in_cameras(*path: str | int, value: Any) -> Any:
    return listed(change_json(_CAMERAS, _set("frames", *path, value=value)))


def _repeat_tier(document: dict[str, Any]) -> None:
    document["tiers"].append(document["tiers"][0])


def _repeat_object(document: dict[str, Any]) -> None:
    document["tiers"][0]["objects"].append(document["tiers"][0]["objects"][0])


def _drop_symmetry(root: Path) -> None:
    """Drop rotate-180 from the tier and from the partners: the rest is no group."""

    def change(document: dict[str, Any]) -> None:
        del document["tiers"][0]["symmetries"][1]

    def partners(rows: list[dict[str, Any]]) -> None:
        for row in rows:
            del row["partners"][1]

    change_json(_DATASET, change)(root)
    listed(change_rows(f"{CLOTH_TRAIN}/points.parquet", partners))(root)


def _repeat_symmetry(root: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        symmetries = document["tiers"][0]["symmetries"]
        symmetries.append({**symmetries[0], "name": "again"})

    def partners(rows: list[dict[str, Any]]) -> None:
        for row in rows:
            row["partners"].append(row["partners"][0])

    change_json(_DATASET, change)(root)
    listed(change_rows(f"{CLOTH_TRAIN}/points.parquet", partners))(root)


def _add_identity(root: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        entry = {"name": "identity", "matrix": [[1, 0], [0, 1]], "offset": [0, 0]}
        document["tiers"][0]["symmetries"].append(entry)

    def partners(rows: list[dict[str, Any]]) -> None:
        for row in rows:
            row["partners"].append(row["point"])

    change_json(_DATASET, change)(root)
    listed(change_rows(f"{CLOTH_TRAIN}/points.parquet", partners))(root)


def _drop_test_split(document: dict[str, Any]) -> None:
    document["splits"] = ["train"]


def _mirror_pose(document: dict[str, Any]) -> None:
    pose = document["frames"][0]["world_to_camera"]
    pose[0] = [-value for value in pose[0]]


def _swap_cameras(document: dict[str, Any]) -> None:
    document["frames"].reverse()


def _drop_camera(document: dict[str, Any]) -> None:
    del document["frames"][1]


def _nest(document: dict[str, Any]) -> None:
    deep: Any = {}
    for _ in range(100):
        deep = {"a": deep}
    document["parameters"] = deep


def _unknown_tier(rows: list[dict[str, Any]]) -> None:
    rows[0]["tier"] = "cable"


def _other_row(name: str, value: Any) -> Change:
    def change(rows: list[dict[str, Any]]) -> None:
        rows[0][name] = value

    return change


_HIGH = ("tiers", 0, "objects", 0, "material", 0)
_DUPLICATE_KEY = b'{"spec_version": "1.0.0", "spec_version": "1.0.0"}'

CASES = [
    Case(
        "json-is-no-json",
        "minimal",
        "dataset.json ends in the middle",
        ("FILE_UNREADABLE",),
        change_bytes(_DATASET, lambda data: data[:200]),
    ),
    Case(
        "json-utf16",
        "minimal",
        "dataset.json is UTF-16",
        ("FILE_UNREADABLE",),
        change_bytes(_DATASET, lambda data: data.decode().encode("utf-16")),
    ),
    Case(
        "json-duplicate-key",
        "minimal",
        "dataset.json has a key twice",
        ("FILE_UNREADABLE",),
        write(_DATASET, _DUPLICATE_KEY),
    ),
    Case(
        "json-nan",
        "minimal",
        "the seed in dataset.json is NaN",
        ("FILE_UNREADABLE",),
        change_bytes(_DATASET, lambda data: data.replace(b'"seed": 7', b'"seed": NaN')),
    ),
    Case(
        "json-deep",
        "full",
        "the parameters of a sequence.json are nested 100 levels deep",
        ("FILE_TOO_LARGE",),
        change_json(_SEQUENCE, _nest),
    ),
    Case(
        "version-2",
        "minimal",
        "spec_version of dataset.json is 2.0.0",
        ("SPEC_VERSION_UNSUPPORTED",),
        _in_dataset("spec_version", value="2.0.0"),
    ),
    Case(
        "version-2-in-sequence",
        "full",
        "spec_version of a sequence.json is 2.0.0",
        ("SPEC_VERSION_UNSUPPORTED",),
        change_json(_SEQUENCE, _set("spec_version", value="2.0.0")),
    ),
    Case(
        "version-2-in-footer",
        "full",
        "spec_version in the footer of sequences.parquet is 2.0.0",
        ("SPEC_VERSION_UNSUPPORTED",),
        change_footer("sequences.parquet", lambda footer: footer.update(spec_version="2.0.0")),
    ),
    Case(
        "version-is-number",
        "minimal",
        "spec_version of dataset.json is the number 1",
        ("SCHEMA_INVALID",),
        _in_dataset("spec_version", value=1),
    ),
    Case(
        "field-missing",
        "minimal",
        "dataset.json lacks its licence",
        ("SCHEMA_INVALID",),
        change_json(_DATASET, _delete("licence")),
    ),
    Case(
        "field-unknown",
        "minimal",
        "dataset.json has a field `colour`",
        ("SCHEMA_INVALID",),
        _in_dataset("colour", value="red"),
    ),
    Case(
        "pixel-centre-at-zero",
        "minimal",
        "the conventions put the first pixel's centre at (0, 0)",
        ("SCHEMA_INVALID",),
        _in_dataset("conventions", "first_pixel_centre", value=[0, 0]),
    ),
    Case(
        "depth-along-ray",
        "minimal",
        "the conventions call depth the length of the ray",
        ("SCHEMA_INVALID",),
        _in_dataset("conventions", "depth", value="ray_length"),
    ),
    Case(
        "size-is-text",
        "minimal",
        'the image\'s width is the text "64"',
        ("SCHEMA_INVALID",),
        _in_dataset("image_size", "width", value="64"),
    ),
    Case(
        "document-is-list",
        "minimal",
        "dataset.json is a list",
        ("SCHEMA_INVALID",),
        change_json(_DATASET, lambda document: [document]),
    ),
    Case(
        "sequence-field-missing",
        "full",
        "a sequence.json lacks its style",
        ("SCHEMA_INVALID",),
        change_json(_SEQUENCE, _delete("style")),
    ),
    Case(
        "frame-info-too-short",
        "full",
        "frame_info has one entry for two frames",
        ("SCHEMA_INVALID",),
        change_json(_SEQUENCE, _set("frame_info", value=[{}])),
    ),
    Case(
        "pose-3x4",
        "full",
        "a pose has three rows",
        ("SCHEMA_INVALID",),
        listed(
            change_json(
                _CAMERAS, lambda document: document["frames"][0]["world_to_camera"].pop() and None
            )
        ),
    ),
    Case(
        "tier-twice",
        "minimal",
        "a tier is declared twice",
        ("TIER_INVALID",),
        change_json(_DATASET, _repeat_tier),
    ),
    Case(
        "object-twice",
        "minimal",
        "a tier has two objects of one id",
        ("TIER_INVALID",),
        change_json(_DATASET, _repeat_object),
    ),
    Case(
        "queried-object-unknown",
        "minimal",
        "queried_object is 5",
        ("TIER_INVALID",),
        _in_dataset("tiers", 0, "queried_object", value=5),
    ),
    Case(
        "material-range-empty",
        "minimal",
        "max of a material coordinate equals min",
        ("TIER_INVALID",),
        _in_dataset(*_HIGH, "max", value=0.0),
    ),
    Case(
        "period-shorter-than-range",
        "minimal",
        "a material coordinate of range 1 has period 0.5",
        ("TIER_INVALID",),
        _in_dataset(*_HIGH, "period", value=0.5),
    ),
    Case(
        "symmetry-scales",
        "minimal",
        "a symmetry maps the cloth onto half of itself",
        ("SYMMETRY_INVALID", "PARTNER_DISAGREES"),
        _in_dataset("tiers", 0, "symmetries", 3, "matrix", value=[[-0.5, 0], [0, 1]]),
    ),
    Case(
        "symmetry-leaves-material",
        "minimal",
        "a symmetry lacks its offset",
        ("SYMMETRY_INVALID", "PARTNER_DISAGREES"),
        _in_dataset("tiers", 0, "symmetries", 3, "offset", value=[0, 0]),
    ),
    Case(
        "symmetry-singular",
        "minimal",
        "a symmetry maps the cloth to a line",
        ("SYMMETRY_INVALID", "PARTNER_DISAGREES"),
        _in_dataset("tiers", 0, "symmetries", 3, "matrix", value=[[-1, 0], [-1, 0]]),
    ),
    Case(
        "symmetry-twice",
        "minimal",
        "a symmetry is listed under two names",
        ("SYMMETRY_INVALID",),
        _repeat_symmetry,
    ),
    Case(
        "symmetry-is-identity",
        "minimal",
        "the identity is listed",
        ("SYMMETRY_INVALID",),
        _add_identity,
    ),
    Case(
        "symmetries-no-group",
        "minimal",
        "two turns by 90 degrees are listed, the one by 180 is not",
        ("SYMMETRY_INVALID",),
        _drop_symmetry,
    ),
    Case(
        "tier-unknown",
        "full",
        "a row of sequences.parquet names the tier `cable`",
        ("TIER_UNKNOWN", "ROW_MISSING"),
        change_rows("sequences.parquet", _unknown_tier),
    ),
    Case(
        "split-undeclared",
        "full",
        "dataset.json does not declare the split test",
        ("SPLIT_UNKNOWN",),
        change_json(_DATASET, _drop_test_split),
    ),
    Case(
        "sequence-id-differs",
        "full",
        "a sequence.json names another id than its folder",
        ("IDENTITY_DIFFERS",),
        change_json(_SEQUENCE, _set("id", value="rope-train-000009")),
    ),
    Case(
        "sequence-seed-differs",
        "full",
        "a sequence.json has another seed than sequences.parquet",
        ("IDENTITY_DIFFERS",),
        change_json(_SEQUENCE, _set("seed", value=8)),
    ),
    Case(
        "sequence-shape-differs",
        "full",
        "sequences.parquet has another shape than a sequence.json",
        ("IDENTITY_DIFFERS",),
        change_rows("sequences.parquet", _other_row("shape", "knot")),
    ),
    Case(
        "camera-size-differs",
        "full",
        "a cameras.json says 640 x 480",
        ("IDENTITY_DIFFERS",),
        listed(change_json(_CAMERAS, lambda document: document.update(width=640, height=480))),
    ),
    Case(
        "footer-other-dataset",
        "full",
        "the footer of the queries names another dataset",
        ("IDENTITY_DIFFERS", "QUERIES_MISMATCH"),
        change_footer(
            "queries/test.parquet", lambda footer: footer["dataset"].update(id="another")
        ),
    ),
    Case(
        "footer-other-split",
        "full",
        "the footer of the truth names another split",
        ("IDENTITY_DIFFERS",),
        change_footer("truth/test.parquet", lambda footer: footer.update(split="train")),
    ),
    Case(
        "camera-focal-negative",
        "full",
        "fy is negative",
        ("CAMERA_INVALID",),
        _in_cameras(0, "K", 1, 1, value=-85.0),
    ),
    Case(
        "camera-skew",
        "full",
        "K has a skew",
        ("CAMERA_INVALID",),
        _in_cameras(0, "K", 0, 1, value=0.5),
    ),
    Case(
        "camera-mirrored",
        "full",
        "the first row of a pose is negated: no rotation",
        ("CAMERA_INVALID",),
        listed(change_json(_CAMERAS, _mirror_pose)),
    ),
    Case(
        "camera-scaled",
        "full",
        "an element of a rotation is 2",
        ("CAMERA_INVALID",),
        _in_cameras(1, "world_to_camera", 0, 0, value=2.0),
    ),
    Case(
        "camera-last-row",
        "full",
        "the last row of a pose is 0 0 0 2",
        ("CAMERA_INVALID",),
        _in_cameras(1, "world_to_camera", 3, 3, value=2.0),
    ),
    Case(
        "cameras-reversed",
        "full",
        "the frames of cameras.json are in descending order",
        ("CAMERA_INVALID",),
        listed(change_json(_CAMERAS, _swap_cameras)),
    ),
    Case(
        "camera-missing",
        "full",
        "cameras.json lacks the last frame",
        ("CAMERA_INVALID",),
        listed(change_json(_CAMERAS, _drop_camera)),
    ),
]
"""Every mutation of this kind."""
