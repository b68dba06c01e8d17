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
    Case,
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

CASES = [
    Case(
        "no-dataset-json",
        "minimal",
        "dataset.json is removed",
        ("FILE_MISSING",),
        remove("dataset.json"),
    ),
    Case(
        "no-sequences-table",
        "minimal",
        "sequences.parquet is removed",
        ("FILE_MISSING",),
        remove(_SEQUENCES),
    ),
    Case(
        "no-sequences-folder",
        "minimal",
        "sequences/ is removed",
        ("FILE_MISSING",),
        remove("sequences"),
    ),
    Case(
        "no-sequence-json",
        "full",
        "a sequence.json is removed: an unfinished sequence",
        ("FILE_MISSING",),
        remove(_SEQUENCE),
    ),
    Case(
        "no-cameras",
        "full",
        "a cameras.json is removed",
        ("FILE_MISSING",),
        remove(f"{ROPE_TRAIN}/cameras.json"),
    ),
    Case(
        "no-points",
        "full",
        "a points.parquet is removed",
        ("FILE_MISSING",),
        remove(f"{ROPE_TRAIN}/points.parquet"),
    ),
    Case("no-colour-image", "full", "a colour image is removed", ("FILE_MISSING",), remove(_RGB)),
    Case(
        "no-depth-image-unlisted",
        "full",
        "a depth image is removed from folder and list",
        ("FILE_MISSING",),
        listed(remove(_EXR)),
    ),
    Case(
        "extra-file-in-root",
        "minimal",
        "notes.txt is added to the root",
        ("FILE_EXTRA",),
        write("notes.txt", b"hello\n"),
    ),
    Case(
        "extra-file-in-sequence",
        "minimal",
        "preview.jpg is added to a sequence, and listed",
        ("FILE_EXTRA",),
        listed(write(f"{CLOTH_TRAIN}/preview.jpg", b"\xff\xd8\xff")),
    ),
    Case(
        "extra-folder",
        "minimal",
        "a folder masks/ is added to a sequence",
        ("FILE_EXTRA",),
        write(f"{CLOTH_TRAIN}/masks/000000.png", b""),
    ),
    Case(
        "extra-frame",
        "full",
        "an image of a frame that does not exist is added, and listed",
        ("FILE_EXTRA",),
        listed(_add_frame),
    ),
    Case(
        "queries-of-unknown-split",
        "full",
        "queries/dev.parquet is added",
        ("FILE_EXTRA",),
        write("queries/dev.parquet", b"PAR1"),
    ),
    Case(
        "linked-image",
        "full",
        "a colour image becomes a link to another",
        ("PATH_UNSAFE",),
        link(_RGB, "000001.png"),
    ),
    Case(
        "linked-out-of-dataset",
        "full",
        "a cameras.json becomes a link out of the dataset",
        ("PATH_UNSAFE",),
        link(f"{ROPE_TRAIN}/cameras.json", "/etc/hostname"),
    ),
    Case(
        "listed-path-climbs",
        "full",
        "sequence.json lists ../../../dataset.json",
        ("PATH_UNSAFE",),
        change_json(_SEQUENCE, _rename_path("../../../dataset.json")),
    ),
    Case(
        "listed-path-absolute",
        "full",
        "sequence.json lists /etc/hostname",
        ("PATH_UNSAFE",),
        change_json(_SEQUENCE, _rename_path("/etc/hostname")),
    ),
    Case(
        "sequence-id-climbs",
        "full",
        "sequences.parquet lists the id ../rope-train-000000",
        ("PATH_UNSAFE",),
        change_rows(_SEQUENCES, _climbing_id),
    ),
    Case(
        "flipped-bit",
        "full",
        "one bit in the middle of a colour image is flipped",
        ("CHECKSUM_DIFFERS",),
        change_bytes(_RGB, _flip),
    ),
    Case(
        "truncated-file",
        "full",
        "a correspondences.parquet loses its last 100 bytes",
        ("CHECKSUM_DIFFERS",),
        change_bytes(f"{ROPE_TRAIN}/correspondences.parquet", lambda data: data[:-100]),
    ),
    Case(
        "swapped-images",
        "full",
        "two colour images change places",
        ("CHECKSUM_DIFFERS",),
        _swap_images,
    ),
    Case(
        "unlisted-file",
        "full",
        "sequence.json does not list cameras.json",
        ("FILE_UNLISTED",),
        change_json(_SEQUENCE, _unlist),
    ),
    Case(
        "file-listed-twice",
        "full",
        "sequence.json lists its first file twice",
        ("FILE_UNLISTED",),
        change_json(_SEQUENCE, lambda document: document["files"].append(document["files"][0])),
    ),
    Case(
        "listed-file-not-there",
        "full",
        "sequence.json lists rgb/000002.png, which is not there",
        ("FILE_MISSING",),
        change_json(_SEQUENCE, _rename_path("rgb/000002.png")),
    ),
    Case(
        "unlisted-sequence",
        "full",
        "a sequence's row is dropped",
        ("ROW_MISSING",),
        change_rows(_SEQUENCES, _unlisted_sequence),
    ),
    Case(
        "sequence-without-folder",
        "full",
        "a row is added for a sequence that has no folder",
        ("FILE_MISSING",),
        change_rows(_SEQUENCES, _invented_sequence),
    ),
    Case(
        "sequence-listed-twice",
        "full",
        "a sequence's row is repeated",
        ("ROW_DUPLICATE",),
        change_rows(_SEQUENCES, _repeated_sequence),
    ),
    Case(
        "sequence-in-two-splits",
        "full",
        "a sequence's row is repeated with another split",
        ("SPLIT_SHARED",),
        change_rows(_SEQUENCES, _shared_sequence),
    ),
    Case(
        "test-images-in-train",
        "full",
        "a test sequence is copied to the training split under another id",
        ("SPLIT_SHARED",),
        listed(_copy_to_train, change_rows(_SEQUENCES, _list_copy)),
    ),
    Case(
        "png-truncated",
        "full",
        "a colour image loses its second half, and is listed so",
        ("FILE_UNREADABLE",),
        listed(change_bytes(_RGB, lambda data: data[: len(data) // 2])),
    ),
    Case(
        "png-is-text",
        "full",
        "a colour image is a text file, and listed so",
        ("FILE_UNREADABLE",),
        listed(write(_RGB, b"not an image")),
    ),
    Case(
        "png-grey",
        "full",
        "a colour image is an 8-bit grey PNG",
        ("IMAGE_FORMAT",),
        listed(write(_RGB, _png(Image.new("L", (64, 48))))),
    ),
    Case(
        "png-alpha",
        "full",
        "a colour image has an alpha channel",
        ("IMAGE_FORMAT",),
        listed(write(_RGB, _png(Image.new("RGBA", (64, 48))))),
    ),
    Case(
        "png-palette",
        "full",
        "a colour image has a palette",
        ("IMAGE_FORMAT",),
        listed(write(_RGB, _png(Image.new("P", (64, 48))))),
    ),
    Case(
        "png-other-size",
        "full",
        "a colour image is 48 x 64",
        ("IMAGE_SIZE_DIFFERS",),
        listed(write(_RGB, _png(Image.new("RGB", (48, 64))))),
    ),
    Case(
        "png-bomb",
        "full",
        "the header of a colour image claims 100,000 x 100,000 pixels",
        ("FILE_TOO_LARGE",),
        listed(change_bytes(_RGB, _bomb)),
    ),
    Case(
        "exr-truncated",
        "full",
        "a depth image loses its second half, and is listed so",
        ("FILE_UNREADABLE",),
        listed(change_bytes(_EXR, lambda data: data[: len(data) // 2])),
    ),
    Case(
        "exr-is-png",
        "full",
        "a depth image is a PNG",
        ("FILE_UNREADABLE",),
        listed(write(_EXR, _png(Image.new("RGB", (64, 48))))),
    ),
    Case(
        "exr-vast",
        "full",
        "the header of a depth image claims 100,000 x 100,000 pixels",
        ("FILE_TOO_LARGE",),
        listed(change_bytes(_EXR, _vast)),
    ),
    Case(
        "exr-channel-renamed",
        "full",
        "the channel Z is named depth",
        ("IMAGE_FORMAT",),
        listed(change_exr(_EXR, _rename_channel)),
    ),
    Case(
        "exr-half-floats",
        "full",
        "the channel surface.m0 is HALF",
        ("IMAGE_FORMAT",),
        listed(change_exr(_EXR, _half_floats)),
    ),
    Case(
        "exr-lossy",
        "full",
        "a depth image is compressed by DWAA",
        ("IMAGE_FORMAT",),
        listed(change_exr(_EXR, _nothing, "DWAA_COMPRESSION")),
    ),
    Case(
        "exr-piz",
        "full",
        "a depth image is compressed by PIZ",
        ("IMAGE_FORMAT",),
        listed(change_exr(_EXR, _nothing, "PIZ_COMPRESSION")),
    ),
    Case(
        "exr-rle",
        "full",
        "a depth image is compressed by RLE",
        ("IMAGE_FORMAT",),
        listed(change_exr(_EXR, _nothing, "RLE_COMPRESSION")),
    ),
    Case(
        "exr-other-size",
        "full",
        "a depth image lacks its last column",
        ("IMAGE_SIZE_DIFFERS",),
        listed(change_exr(_EXR, _crop)),
    ),
    Case(
        "parquet-is-csv",
        "full",
        "a correspondences.parquet is a CSV file",
        ("FILE_UNREADABLE",),
        listed(write(f"{ROPE_TRAIN}/correspondences.parquet", _CSV)),
    ),
    Case(
        "parquet-truncated",
        "full",
        "a points.parquet loses its last 100 bytes, and is listed so",
        ("FILE_UNREADABLE",),
        listed(change_bytes(f"{ROPE_TRAIN}/points.parquet", lambda data: data[:-100])),
    ),
    Case(
        "parquet-too-many-rows",
        "minimal",
        "a point table repeats one row 1,000,001 times",
        ("FILE_TOO_LARGE",),
        listed(_many_points),
    ),
]
"""Every mutation of this kind."""
