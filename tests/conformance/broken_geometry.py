"""Mutations of what geometry decides: projection, depth, visibility, the surface layer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.conformance.edits import (
    CLOTH_TRAIN,
    ROPE_TRAIN,
    Edit,
    change_exr,
    change_json,
    change_rows,
    listed,
)

_TRACKS = f"{ROPE_TRAIN}/correspondences.parquet"
_CLOTH_TRACKS = f"{CLOTH_TRAIN}/correspondences.parquet"
_EXR = f"{ROPE_TRAIN}/depth/000001.exr"
_CLOTH_EXR = f"{CLOTH_TRAIN}/depth/000000.exr"

Rows = list[dict[str, Any]]
Channels = dict[str, Any]


def _each(change: Callable[[dict[str, Any]], None]) -> Callable[[Rows], None]:
    def edit(rows: Rows) -> None:
        for row in rows:
            change(row)

    return edit


def _one(state: str, change: Callable[[dict[str, Any]], None], place: float = 0.5) -> Any:
    """Return a change of one row of a state: the one so far down the list of them."""

    def edit(rows: Rows) -> None:
        chosen = [row for row in rows if row["visibility"] == state and row["frame"] == 0]
        change(chosen[int(place * len(chosen))])

    return edit


def _half_pixel(row: dict[str, Any]) -> None:
    row["u_px"] -= 0.5
    row["v_px"] -= 0.5


def _whole_pixels(row: dict[str, Any]) -> None:
    row["u_px"], row["v_px"] = float(round(row["u_px"])), float(round(row["v_px"]))


def _flip_v(row: dict[str, Any]) -> None:
    row["v_px"] = 48 - row["v_px"]


def _state(name: str) -> Callable[[dict[str, Any]], None]:
    def change(row: dict[str, Any]) -> None:
        row["visibility"] = name

    return change


def _millimetres(row: dict[str, Any]) -> None:
    row["depth_m"] *= 1000


def _ray_length(row: dict[str, Any]) -> None:
    """Turn planar depth into the distance from the camera (f = 85 px, centre (32, 24))."""
    x, y = (row["u_px"] - 32) / 85, (row["v_px"] - 24) / 85
    row["depth_m"] *= float(np.sqrt(1 + x * x + y * y))


def _nudge_point(row: dict[str, Any]) -> None:
    row["u_px"] += 0.1


def _nudge_depth(row: dict[str, Any]) -> None:
    row["depth_m"] += 1e-3


def _swap_depth(root: Path) -> None:
    folder = root / ROPE_TRAIN / "depth"
    first, second = folder / "000000.exr", folder / "000001.exr"
    data = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(data)


def _one_depth(root: Path) -> None:
    """Give the second frame the depth image of the first."""
    folder = root / ROPE_TRAIN / "depth"
    (folder / "000001.exr").write_bytes((folder / "000000.exr").read_bytes())


def _pixel(name: str, value: Any, *, background: bool) -> Callable[[Channels], None]:
    """Return a change of one pixel: the middle one on an object, or the first off it."""

    def edit(channels: Channels) -> None:
        seen = channels["surface.object"] == 0 if background else channels["surface.object"] == 1
        rows, columns = np.nonzero(seen)
        place = 0 if background else len(rows) // 2
        channels[name][rows[place], columns[place]] = value

    return edit


def _background(value: float) -> Callable[[Channels], None]:
    def edit(channels: Channels) -> None:
        channels["Z"][channels["surface.object"] == 0] = value

    return edit


def _nearer(channels: Channels) -> None:
    """Bring the whole surface 0.2 m nearer: every point is behind it."""
    channels["Z"] -= np.float32(0.2)


def _farther(channels: Channels) -> None:
    channels["Z"] += np.float32(0.2)


def _mirrored_material(channels: Channels) -> None:
    seen = channels["surface.object"] > 0
    channels["surface.m1"][seen] = 1 - channels["surface.m1"][seen]


def _exchanged_material(channels: Channels) -> None:
    channels["surface.m0"], channels["surface.m1"] = (
        channels["surface.m1"],
        channels["surface.m0"],
    )


def _flipped_rows(channels: Channels) -> Channels:
    return {name: np.ascontiguousarray(part[::-1]) for name, part in channels.items()}


def _moved_camera(document: dict[str, Any]) -> None:
    document["frames"][0]["world_to_camera"][0][3] += 0.01


def _inverse_pose(document: dict[str, Any]) -> None:
    for frame in document["frames"]:
        frame["world_to_camera"] = np.linalg.inv(np.array(frame["world_to_camera"])).tolist()
        frame["world_to_camera"][3] = [0, 0, 0, 1]


def _zoomed(document: dict[str, Any]) -> None:
    for frame in document["frames"]:
        frame["K"][0][0] *= 1.02
        frame["K"][1][1] *= 1.02


def _moved_centre(document: dict[str, Any]) -> None:
    for frame in document["frames"]:
        frame["K"][0][2] -= 0.5
        frame["K"][1][2] -= 0.5


_CAMERAS = f"{ROPE_TRAIN}/cameras.json"

EDITS: dict[str, Edit] = {
    "half-pixel": listed(change_rows(_TRACKS, _each(_half_pixel))),
    "whole-pixels": listed(change_rows(_TRACKS, _each(_whole_pixels))),
    "v-upwards": listed(change_rows(_TRACKS, _each(_flip_v))),
    "one-point-moved": listed(change_rows(_TRACKS, _one("visible", _nudge_point))),
    "camera-moved": listed(change_json(_CAMERAS, _moved_camera)),
    "camera-zoomed": listed(change_json(_CAMERAS, _zoomed)),
    "principal-point-moved": listed(change_json(_CAMERAS, _moved_centre)),
    "pose-inverted": listed(change_json(_CAMERAS, _inverse_pose)),
    "depth-in-millimetres": listed(change_rows(_TRACKS, _each(_millimetres))),
    "depth-along-the-ray": listed(change_rows(_TRACKS, _each(_ray_length))),
    "one-depth-moved": listed(change_rows(_TRACKS, _one("visible", _nudge_depth))),
    "visible-called-out-of-frame": listed(
        change_rows(_TRACKS, _one("visible", _state("out_of_frame")))
    ),
    "out-of-frame-called-occluded": listed(
        change_rows(_TRACKS, _one("out_of_frame", _state("occluded")))
    ),
    "hidden-called-visible": listed(
        change_rows(_CLOTH_TRACKS, _one("self_occluded", _state("visible")))
    ),
    "visible-called-self-occluded": listed(
        change_rows(_CLOTH_TRACKS, _one("visible", _state("self_occluded")))
    ),
    "visible-called-occluded": listed(
        change_rows(_CLOTH_TRACKS, _one("visible", _state("occluded")))
    ),
    "self-occluded-called-occluded": listed(
        change_rows(_CLOTH_TRACKS, _one("self_occluded", _state("occluded")))
    ),
    "depth-image-nearer": listed(change_exr(_CLOTH_EXR, _nearer)),
    "depth-image-farther": listed(change_exr(_CLOTH_EXR, _farther)),
    "depth-images-swapped": listed(_swap_depth),
    "depth-image-repeated": listed(_one_depth),
    "depth-image-upside-down": listed(change_exr(_EXR, _flipped_rows)),
    "material-mirrored": listed(change_exr(_CLOTH_EXR, _mirrored_material)),
    "material-exchanged": listed(change_exr(_CLOTH_EXR, _exchanged_material)),
    "depth-nan": listed(change_exr(_EXR, _pixel("Z", np.nan, background=False))),
    "depth-negative": listed(change_exr(_EXR, _pixel("Z", -0.5, background=False))),
    "background-zero": listed(change_exr(_EXR, _background(0.0))),
    "background-far": listed(change_exr(_EXR, _background(1e4))),
    "hole-in-object": listed(change_exr(_EXR, _pixel("Z", np.inf, background=False))),
    "object-id-unknown": listed(change_exr(_EXR, _pixel("surface.object", 9, background=False))),
    "material-out-of-range": listed(change_exr(_EXR, _pixel("surface.m0", 1.5, background=False))),
    "material-nan": listed(change_exr(_EXR, _pixel("surface.m1", np.nan, background=False))),
    "material-on-background": listed(change_exr(_EXR, _pixel("surface.m0", 0.5, background=True))),
}
"""Every mutation of this kind."""
