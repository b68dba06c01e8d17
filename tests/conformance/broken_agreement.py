"""Mutations that leave every file in order by itself: images and tables that do not agree."""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pliant.spec.arrays import FloatArray
from pliant.spec.io.png import read_rgb, write_rgb
from tests.conformance.edits import (
    CLOTH_TEST,
    CLOTH_TRAIN,
    ROPE_TEST,
    ROPE_TRAIN,
    Edit,
    both,
    change_bytes,
    change_exr,
    change_json,
    change_rows,
    listed,
    remove,
)

Channels = dict[str, Any]

_EXR = f"{CLOTH_TRAIN}/depth/000000.exr"
_PNG = f"{CLOTH_TRAIN}/rgb/000000.png"


def _moved(move: Callable[[FloatArray], FloatArray]) -> Edit:
    """Move the cloth's points parallel to the image plane; the tables follow."""

    def edit(root: Path) -> None:
        camera = json.loads((root / CLOTH_TRAIN / "cameras.json").read_text())["frames"][0]
        K, pose = np.array(camera["K"]), np.array(camera["world_to_camera"])

        def rows(table: list[dict[str, Any]]) -> None:
            uv = move(np.array([[row["u_px"], row["v_px"]] for row in table]))
            for row, (u, v) in zip(table, uv, strict=True):
                z = row["depth_m"]
                local = np.array([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z])
                xyz = pose[:3, :3].T @ (local - pose[:3, 3])
                row.update(u_px=float(u), v_px=float(v))
                row.update(zip(("x_m", "y_m", "z_m"), map(float, xyz), strict=True))

        change_rows(f"{CLOTH_TRAIN}/correspondences.parquet", rows)(root)

    return edit


def _opencv(root: Path) -> None:
    """Subtract half a pixel from the principal point and from every position."""

    def centre(document: dict[str, Any]) -> None:
        for axis in (0, 1):
            document["frames"][0]["K"][axis][2] -= 0.5

    def rows(table: list[dict[str, Any]]) -> None:
        for row in table:
            row["u_px"] -= 0.5
            row["v_px"] -= 0.5

    change_json(f"{CLOTH_TRAIN}/cameras.json", centre)(root)
    change_rows(f"{CLOTH_TRAIN}/correspondences.parquet", rows)(root)


def _jitter(uv: FloatArray) -> FloatArray:
    return uv + np.random.default_rng(0).normal(0, 0.4, uv.shape)


def _depth(change: Callable[[FloatArray], Any]) -> Callable[[Channels], None]:
    def edit(channels: Channels) -> None:
        seen = channels["surface.object"] > 0
        channels["Z"][seen] = change(channels["Z"][seen].astype(np.float64))

    return edit


def _eight_bits(values: FloatArray) -> FloatArray:
    low, high = values.min(), values.max()
    return low + np.rint((values - low) / (high - low) * 255) / 255 * (high - low)


def _material_8_bits(channels: Channels) -> None:
    for name in ("surface.m0", "surface.m1"):
        channels[name][:] = np.rint(channels[name].astype(np.float64) * 255) / 255


def _material_noise(channels: Channels) -> None:
    rng = np.random.default_rng(0)
    seen = channels["surface.object"] > 0
    for name in ("surface.m0", "surface.m1"):
        noisy = channels[name][seen] + rng.normal(0, 0.01, np.count_nonzero(seen))
        channels[name][seen] = np.clip(noisy, 0, 1)


def enlarged(rgb: Any) -> Any:
    height, width = rgb.shape[:2]
    small = Image.fromarray(rgb).resize((width // 2, height // 2), Image.Resampling.BOX)
    return np.asarray(small.resize((width, height), Image.Resampling.BILINEAR))


def jpeg(rgb: Any) -> Any:
    stream = io.BytesIO()
    Image.fromarray(rgb).save(stream, "JPEG", quality=25)
    return np.asarray(Image.open(stream))


def _with_chunk(kind: bytes, payload: bytes) -> Callable[[bytes], bytes]:
    """Put a chunk in front of the first IDAT."""
    chunk = len(payload).to_bytes(4, "big") + kind + payload
    chunk += zlib.crc32(kind + payload).to_bytes(4, "big")

    def edit(data: bytes) -> bytes:
        at = data.index(b"IDAT") - 4
        return data[:at] + chunk + data[at:]

    return edit


def _elsewhere(root: Path) -> None:
    """Call a rope an episode, and move object and camera of its second frame by 2 m."""

    def cameras(document: dict[str, Any]) -> None:
        pose = np.array(document["frames"][1]["world_to_camera"])
        pose[:3, 3] -= pose[:3, 0] * 2
        document["frames"][1]["world_to_camera"] = pose.tolist()

    def points(rows: list[dict[str, Any]]) -> None:
        for row in rows:
            row["x_m"] += 2 * (row["frame"] == 1)

    def listing(rows: list[dict[str, Any]]) -> None:
        for row in rows:
            row["temporal"] |= row["id"] == Path(ROPE_TRAIN).name

    change_json(f"{ROPE_TRAIN}/cameras.json", cameras)(root)
    change_json(f"{ROPE_TRAIN}/sequence.json", lambda d: d.update(temporal=True))(root)
    change_rows(f"{ROPE_TRAIN}/correspondences.parquet", points)(root)
    change_rows("sequences.parquet", listing)(root)


def _column(channels: Channels) -> Channels:
    return {name: np.ascontiguousarray(np.roll(part, 1, 1)) for name, part in channels.items()}


def _scale(factor: float) -> Callable[[dict[str, Any]], None]:
    def edit(document: dict[str, Any]) -> None:
        for coordinate in document["tiers"][0]["objects"][0]["material"]:
            coordinate["metres_per_unit"] *= factor

    return edit


def _pictures(folder: str, change: Callable[[list[Any]], list[Any]]) -> Edit:
    """Change the colour images of a sequence."""

    def edit(root: Path) -> None:
        paths = sorted((root / folder / "rgb").glob("*.png"))
        changed = change([read_rgb(path) for path in paths])
        for path, rgb in zip(paths, changed, strict=True):
            write_rgb(path, np.ascontiguousarray(rgb))

    return edit


def _random(pictures: list[Any]) -> list[Any]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, rgb.shape, np.uint8) for rgb in pictures]


def _copied(names: tuple[str, ...]) -> Edit:
    """Give the test rope files of the training rope, written again by another encoder."""

    def edit(root: Path) -> None:
        for name in names:
            (root / ROPE_TEST / name).write_bytes((root / ROPE_TRAIN / name).read_bytes())
        for frame in (0, 1):
            exr = f"{ROPE_TEST}/depth/{frame:06d}.exr"
            change_exr(exr, lambda channels: None, "NO_COMPRESSION")(root)
            path = root / f"{ROPE_TEST}/rgb/{frame:06d}.png"
            write_rgb(path, read_rgb(path), level=9)

    return edit


def _cameras_exchanged(document: dict[str, Any]) -> None:
    first, second = document["frames"]
    for key in ("K", "world_to_camera"):
        first[key], second[key] = second[key], first[key]


_NO_TRUTH = both(remove("truth"), remove("queries"))
_IMAGES = tuple(f"rgb/{frame:06d}.png" for frame in (0, 1))
_ALL = (
    *_IMAGES,
    *(f"depth/{frame:06d}.exr" for frame in (0, 1)),
    "cameras.json",
    "correspondences.parquet",
)


EDITS: dict[str, Edit] = {
    "opencv-tables": listed(_opencv),
    "surface-one-column-right": listed(change_exr(_EXR, _column)),
    "points-scattered": listed(_moved(_jitter)),
    "depth-image-float16": listed(change_exr(_EXR, _depth(lambda z: z.astype(np.float16)))),
    "depth-image-8-bits": listed(change_exr(_EXR, _depth(_eight_bits))),
    "depth-image-whole-millimetres": listed(change_exr(_EXR, _depth(lambda z: np.round(z, 3)))),
    "material-8-bits": listed(change_exr(_EXR, _material_8_bits)),
    "depth-image-noisy": listed(
        change_exr(_EXR, _depth(lambda z: z + np.random.default_rng(0).normal(0, 3e-3, z.shape)))
    ),
    "depth-image-1-centimetre-more": listed(change_exr(_EXR, _depth(lambda z: z + 0.01))),
    "depth-image-in-millimetres": listed(change_exr(_EXR, _depth(lambda z: z * 1000))),
    "metres-per-unit-ten-times": listed(change_json("dataset.json", _scale(10.0))),
    "metres-per-unit-a-tenth": listed(change_json("dataset.json", _scale(0.1))),
    "cameras-of-the-other-frame": listed(
        change_json(f"{ROPE_TRAIN}/cameras.json", _cameras_exchanged)
    ),
    "colour-mirrored": listed(
        _pictures(CLOTH_TRAIN, lambda pictures: [rgb[:, ::-1] for rgb in pictures])
    ),
    "colour-shifted": listed(
        _pictures(CLOTH_TRAIN, lambda pictures: [np.roll(rgb, 2, 1) for rgb in pictures])
    ),
    "colour-exchanged": listed(_pictures(CLOTH_TEST, lambda pictures: pictures[::-1])),
    "colour-repeated": listed(_pictures(CLOTH_TEST, lambda pictures: [pictures[0]] * 2)),
    "colour-black": listed(_pictures(CLOTH_TEST, lambda pictures: [0 * rgb for rgb in pictures])),
    "colour-random": listed(_pictures(CLOTH_TRAIN, _random)),
    "colour-grey": listed(
        _pictures(CLOTH_TRAIN, lambda pictures: [rgb[..., [1, 1, 1]] for rgb in pictures])
    ),
    "colour-enlarged": listed(
        _pictures(CLOTH_TRAIN, lambda pictures: [enlarged(rgb) for rgb in pictures])
    ),
    "colour-jpeg": listed(_pictures(CLOTH_TRAIN, lambda pictures: [jpeg(rgb) for rgb in pictures])),
    "png-without-end": listed(change_bytes(_PNG, lambda data: data[:-12])),
    "png-transparent-colour": listed(change_bytes(_PNG, _with_chunk(b"tRNS", bytes(6)))),
    "png-gamma": listed(change_bytes(_PNG, _with_chunk(b"gAMA", (100_000).to_bytes(4, "big")))),
    "material-noisy": listed(change_exr(_EXR, _material_noise)),
    "temporal-of-independent-frames": listed(_NO_TRUTH, _elsewhere),
    "split-shared-content": listed(
        _NO_TRUTH, _copied(_ALL), change_rows("sequences.parquet", lambda rows: _same_share(rows))
    ),
    "split-shared-pictures": listed(_NO_TRUTH, _copied(_IMAGES)),
}
"""Every mutation of this kind."""


def _same_share(rows: list[dict[str, Any]]) -> None:
    share = next(row for row in rows if row["id"] == "rope-train-000000")["self_occluded"]
    next(row for row in rows if row["id"] == "rope-test-000000")["self_occluded"] = share
