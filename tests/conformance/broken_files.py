"""Mutations of files: missing, extra, linked, damaged, or of another kind."""

from __future__ import annotations

import io
import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

from tests.conformance.edits import (
    BARE_TEST,
    CLOTH_TRAIN,
    ROPE_TRAIN,
    Edit,
    change_bytes,
    change_exr,
    change_json,
    change_rows,
    link,
    listed,
    remove,
    write,
)

_RGB = f"{ROPE_TRAIN}/rgb/000000.png"
_EXR = f"{ROPE_TRAIN}/depth/000001.exr"
_SEQUENCE = f"{ROPE_TRAIN}/sequence.json"


def _flip(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


def _png(image: Image.Image) -> bytes:
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


def _bomb(data: bytes) -> bytes:
    """Let the header of a PNG claim 100,000 x 100,000 pixels, with a good checksum."""
    header = struct.pack(">II", 100_000, 100_000) + data[24:29]
    checksum = struct.pack(">I", zlib.crc32(b"IHDR" + header))
    return data[:16] + header + checksum + data[33:]


def _vast(data: bytes) -> bytes:
    """Let the windows of an EXR header claim 100,000 x 100,000 pixels."""
    window = struct.pack("<4i", 0, 0, 63, 47)
    return data.replace(window, struct.pack("<4i", 0, 0, 99_999, 99_999))


def _add_frame(root: Path) -> None:
    source = root / _RGB
    (source.parent / "000009.png").write_bytes(source.read_bytes())


def _unlist(document: dict[str, Any]) -> None:
    document["files"] = [f for f in document["files"] if f["path"] != "cameras.json"]


def _rename_path(name: str) -> Any:
    def change(document: dict[str, Any]) -> None:
        document["files"].append({"path": name, "sha256": "0" * 64, "bytes": 1})

    return change


def _swap_images(root: Path) -> None:
    folder = root / ROPE_TRAIN / "rgb"
    first, second = folder / "000000.png", folder / "000001.png"
    data = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(data)


def _many_points(root: Path) -> None:
    """Write more points than the limit; every column repeats one value."""
    path = root / CLOTH_TRAIN / "points.parquet"
    schema = pq.read_schema(path)
    count = 1_000_001
    zeros = np.zeros(count, np.int32)
    columns = [
        pa.array(zeros),
        pa.array(zeros + 1),
        pa.array(["surface"] * count),
        pa.array(zeros.astype(np.float32)),
        pa.array(zeros.astype(np.float32)),
        pa.ListArray.from_arrays(np.zeros(count + 1, np.int32), pa.array([], pa.int32())).cast(
            schema.field("partners").type
        ),
    ]
    table = pa.Table.from_arrays(columns, schema=schema)
    pq.write_table(table, path, compression="zstd", row_group_size=count)


def _half_floats(channels: dict[str, Any]) -> None:
    channels["surface.m0"] = channels["surface.m0"].astype(np.float16)


def _rename_channel(channels: dict[str, Any]) -> None:
    channels["depth"] = channels.pop("Z")


def _crop(channels: dict[str, Any]) -> dict[str, Any]:
    return {name: np.ascontiguousarray(part[:, :-1]) for name, part in channels.items()}


def _nothing(_: Any) -> None:
    return None


def _unlisted_sequence(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [row for row in rows if row["id"] != "rope-train-000000"]


def _invented_sequence(rows: list[dict[str, Any]]) -> None:
    rows.append({**rows[0], "id": "rope-train-000001"})


def _repeated_sequence(rows: list[dict[str, Any]]) -> None:
    rows.append(dict(rows[0]))


def _shared_sequence(rows: list[dict[str, Any]]) -> None:
    rows.append({**rows[0], "split": "test"})


def _climbing_id(rows: list[dict[str, Any]]) -> None:
    rows.append({**rows[0], "id": "../rope-train-000000"})


def _copy_to_train(root: Path) -> None:
    """Give a training sequence the very images and tables of a test sequence."""
    source, target = root / BARE_TEST, root / BARE_TEST.replace("-test-", "-train-")
    for path in sorted(source.rglob("*")):
        if path.is_file():
            copy = target / path.relative_to(source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())
    info = target / "sequence.json"
    document = json.loads(info.read_text())
    document |= {"id": target.name, "split": "train"}
    info.write_text(json.dumps(document))


def _list_copy(rows: list[dict[str, Any]]) -> None:
    row = next(row for row in rows if row["id"] == "rope-bare-test-000000")
    rows.append({**row, "id": "rope-bare-train-000000", "split": "train"})


_SEQUENCES = "sequences.parquet"
_CSV = b"frame,point,u_px,v_px\n0,0,1.5,2.5\n"

EDITS: dict[str, Edit] = {
    "no-dataset-json": remove("dataset.json"),
    "no-sequences-table": remove(_SEQUENCES),
    "no-sequences-folder": remove("sequences"),
    "no-sequence-json": remove(_SEQUENCE),
    "no-cameras": remove(f"{ROPE_TRAIN}/cameras.json"),
    "no-points": remove(f"{ROPE_TRAIN}/points.parquet"),
    "no-colour-image": remove(_RGB),
    "no-depth-image-unlisted": listed(remove(_EXR)),
    "extra-file-in-root": write("notes.txt", b"hello\n"),
    "extra-file-in-sequence": listed(write(f"{CLOTH_TRAIN}/preview.jpg", b"\xff\xd8\xff")),
    "extra-folder": write(f"{CLOTH_TRAIN}/masks/000000.png", b""),
    "extra-frame": listed(_add_frame),
    "queries-of-unknown-split": write("queries/dev.parquet", b"PAR1"),
    "linked-image": link(_RGB, "000001.png"),
    "linked-out-of-dataset": link(f"{ROPE_TRAIN}/cameras.json", "/etc/hostname"),
    "listed-path-climbs": change_json(_SEQUENCE, _rename_path("../../../dataset.json")),
    "listed-path-absolute": change_json(_SEQUENCE, _rename_path("/etc/hostname")),
    "sequence-id-climbs": change_rows(_SEQUENCES, _climbing_id),
    "flipped-bit": change_bytes(_RGB, _flip),
    "truncated-file": change_bytes(
        f"{ROPE_TRAIN}/correspondences.parquet", lambda data: data[:-100]
    ),
    "swapped-images": _swap_images,
    "unlisted-file": change_json(_SEQUENCE, _unlist),
    "file-listed-twice": change_json(
        _SEQUENCE, lambda document: document["files"].append(document["files"][0])
    ),
    "listed-file-not-there": change_json(_SEQUENCE, _rename_path("rgb/000002.png")),
    "unlisted-sequence": change_rows(_SEQUENCES, _unlisted_sequence),
    "sequence-without-folder": change_rows(_SEQUENCES, _invented_sequence),
    "sequence-listed-twice": change_rows(_SEQUENCES, _repeated_sequence),
    "sequence-in-two-splits": change_rows(_SEQUENCES, _shared_sequence),
    "test-images-in-train": listed(_copy_to_train, change_rows(_SEQUENCES, _list_copy)),
    "png-truncated": listed(change_bytes(_RGB, lambda data: data[: len(data) // 2])),
    "png-is-text": listed(write(_RGB, b"not an image")),
    "png-grey": listed(write(_RGB, _png(Image.new("L", (64, 48))))),
    "png-alpha": listed(write(_RGB, _png(Image.new("RGBA", (64, 48))))),
    "png-palette": listed(write(_RGB, _png(Image.new("P", (64, 48))))),
    "png-other-size": listed(write(_RGB, _png(Image.new("RGB", (48, 64))))),
    "png-bomb": listed(change_bytes(_RGB, _bomb)),
    "exr-truncated": listed(change_bytes(_EXR, lambda data: data[: len(data) // 2])),
    "exr-is-png": listed(write(_EXR, _png(Image.new("RGB", (64, 48))))),
    "exr-vast": listed(change_bytes(_EXR, _vast)),
    "exr-channel-renamed": listed(change_exr(_EXR, _rename_channel)),
    "exr-half-floats": listed(change_exr(_EXR, _half_floats)),
    "exr-lossy": listed(change_exr(_EXR, _nothing, "DWAA_COMPRESSION")),
    "exr-piz": listed(change_exr(_EXR, _nothing, "PIZ_COMPRESSION")),
    "exr-rle": listed(change_exr(_EXR, _nothing, "RLE_COMPRESSION")),
    "exr-other-size": listed(change_exr(_EXR, _crop)),
    "parquet-is-csv": listed(write(f"{ROPE_TRAIN}/correspondences.parquet", _CSV)),
    "parquet-truncated": listed(
        change_bytes(f"{ROPE_TRAIN}/points.parquet", lambda data: data[:-100])
    ),
    "parquet-too-many-rows": listed(_many_points),
}
"""Every mutation of this kind."""
