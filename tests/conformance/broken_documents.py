"""Mutations of JSON documents: syntax, schema, tiers, symmetries, cameras, identities."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.conformance.edits import (
    CLOTH_TRAIN,
    ROPE_TRAIN,
    Edit,
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

EDITS: dict[str, Edit] = {
    "json-is-no-json": change_bytes(_DATASET, lambda data: data[:200]),
    "json-utf16": change_bytes(_DATASET, lambda data: data.decode().encode("utf-16")),
    "json-duplicate-key": write(_DATASET, _DUPLICATE_KEY),
    "json-nan": change_bytes(_DATASET, lambda data: data.replace(b'"seed": 7', b'"seed": NaN')),
    "json-deep": change_json(_SEQUENCE, _nest),
    "version-2": _in_dataset("spec_version", value="2.0.0"),
    "version-2-in-sequence": change_json(_SEQUENCE, _set("spec_version", value="2.0.0")),
    "version-2-in-footer": change_footer(
        "sequences.parquet", lambda footer: footer.update(spec_version="2.0.0")
    ),
    "version-is-number": _in_dataset("spec_version", value=1),
    "field-missing": change_json(_DATASET, _delete("licence")),
    "field-unknown": _in_dataset("colour", value="red"),
    "pixel-centre-at-zero": _in_dataset("conventions", "first_pixel_centre", value=[0, 0]),
    "depth-along-ray": _in_dataset("conventions", "depth", value="ray_length"),
    "size-is-text": _in_dataset("image_size", "width", value="64"),
    "document-is-list": change_json(_DATASET, lambda document: [document]),
    "sequence-field-missing": change_json(_SEQUENCE, _delete("style")),
    "frame-info-too-short": change_json(_SEQUENCE, _set("frame_info", value=[{}])),
    "pose-3x4": listed(
        change_json(
            _CAMERAS, lambda document: document["frames"][0]["world_to_camera"].pop() and None
        )
    ),
    "tier-twice": change_json(_DATASET, _repeat_tier),
    "object-twice": change_json(_DATASET, _repeat_object),
    "queried-object-unknown": _in_dataset("tiers", 0, "queried_object", value=5),
    "material-range-empty": _in_dataset(*_HIGH, "max", value=0.0),
    "period-shorter-than-range": _in_dataset(*_HIGH, "period", value=0.5),
    "symmetry-scales": _in_dataset(
        "tiers", 0, "symmetries", 3, "matrix", value=[[-0.5, 0], [0, 1]]
    ),
    "symmetry-leaves-material": _in_dataset("tiers", 0, "symmetries", 3, "offset", value=[0, 0]),
    "symmetry-singular": _in_dataset(
        "tiers", 0, "symmetries", 3, "matrix", value=[[-1, 0], [-1, 0]]
    ),
    "symmetry-twice": _repeat_symmetry,
    "symmetry-is-identity": _add_identity,
    "symmetries-no-group": _drop_symmetry,
    "tier-unknown": change_rows("sequences.parquet", _unknown_tier),
    "split-undeclared": change_json(_DATASET, _drop_test_split),
    "sequence-id-differs": change_json(_SEQUENCE, _set("id", value="rope-train-000009")),
    "sequence-seed-differs": change_json(_SEQUENCE, _set("seed", value=8)),
    "sequence-shape-differs": change_rows("sequences.parquet", _other_row("shape", "knot")),
    "camera-size-differs": listed(
        change_json(_CAMERAS, lambda document: document.update(width=640, height=480))
    ),
    "footer-other-dataset": change_footer(
        "queries/test.parquet", lambda footer: footer["dataset"].update(id="another")
    ),
    "footer-other-split": change_footer(
        "truth/test.parquet", lambda footer: footer.update(split="train")
    ),
    "camera-focal-negative": _in_cameras(0, "K", 1, 1, value=-85.0),
    "camera-skew": _in_cameras(0, "K", 0, 1, value=0.5),
    "camera-mirrored": listed(change_json(_CAMERAS, _mirror_pose)),
    "camera-scaled": _in_cameras(1, "world_to_camera", 0, 0, value=2.0),
    "camera-last-row": _in_cameras(1, "world_to_camera", 3, 3, value=2.0),
    "cameras-reversed": listed(change_json(_CAMERAS, _swap_cameras)),
    "camera-missing": listed(change_json(_CAMERAS, _drop_camera)),
}
"""Every mutation of this kind."""
