"""All rules of one sequence, in the order that each needs of the others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pliant.spec.camera import Camera
from pliant.spec.conventions import SELF_OCCLUDED
from pliant.spec.io import limits
from pliant.spec.model import Tier
from pliant.spec.storage import layout
from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.cameras import check_cameras
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.correspondences import (
    FrameRows,
    check_keys,
    check_projection,
    frame_rows,
)
from pliant.spec.validation.rules.evidence import PRECISION_FRAMES, Evidence
from pliant.spec.validation.rules.files import (
    SequenceFiles,
    check_files,
    list_sequence,
    read_document,
)
from pliant.spec.validation.rules.points import PointSet, check_points
from pliant.spec.validation.rules.precision import check_precision
from pliant.spec.validation.rules.result import SequenceResult
from pliant.spec.validation.rules.surfaces import check_recorded, check_rgb, check_surface
from pliant.spec.validation.rules.tables import check_place, check_table
from pliant.spec.validation.rules.visibility import check_visibility
from pliant.spec.validation.rules.windows import SoundFrame

_SHARE = "self_occluded"
_FROM_ROW = ("id", "tier", "split", "shape", "frames", "temporal", "seed", "style")


def check_sequence(
    context: Context, tier_name: str, name: str, row: dict[str, Any] | None
) -> SequenceResult:
    """Check one sequence.

    Args:
        context: The dataset.
        tier_name: The folder of its tier.
        name: The folder of the sequence.
        row: Its row of sequences.parquet, None if it has none.

    Returns:
        Its problems and what the rules above it need.
    """
    result = SequenceResult(name, tier_name)
    findings = result.findings
    shown = f"{layout.SEQUENCES_DIR}/{tier_name}/{name}"
    folder = context.root / layout.sequence_name(tier_name, name)
    files = list_sequence(folder, shown, findings)
    info = _read_info(context, files, tier_name, name, row)
    if info is None:
        return result
    result.split, result.frames = info["split"], info["frames"]
    result.temporal = info["temporal"]
    result.boxes_px = np.full(result.frames, np.nan, np.float32)
    held_out = info["split"] in context.held_out
    check_files(files, info, held_out=held_out)
    tier = context.tiers.get(info["tier"])
    if tier is None:
        return result
    cameras = _cameras(context, files, info)
    if held_out:
        _check_held_out(info, files.at(layout.SEQUENCE_JSON))
        evidence = Evidence(info["frames"])
        for frame in range(info["frames"]):
            rgb = check_rgb(context, files, frame)
            if rgb is not None:
                evidence.add_picture(frame, rgb)
            check_recorded(context, tier, files, frame)
        evidence.conclude(tier, info, None, context.size, files)
        result.keys = evidence.keys
        return result
    points = None
    if files.contents(layout.POINTS_TABLE) is not None:
        points = check_points(folder / layout.POINTS_TABLE, tier, files.at(layout.POINTS_TABLE))
        result.points_digest = None if points is None else points.digest
    _check_frames(context, tier, files, info, cameras, points, row, result)
    broken = any(
        issue.path.endswith(layout.CORRESPONDENCES_TABLE) and not issue.code.endswith(_HARMLESS)
        for issue in findings.issues
    )
    result.tables_sound = (
        points is not None and layout.CORRESPONDENCES_TABLE in files.sound and not broken
    )
    return result


_HARMLESS = ("_DISAGREES", "_SCATTERS")
"""Codes of a correspondence table that end so leave its rows in place: queries can be compared
with them."""


def _read_info(
    context: Context,
    files: SequenceFiles,
    tier_name: str,
    name: str,
    row: dict[str, Any] | None,
) -> dict[str, Any] | None:
    problems = files.at(layout.SEQUENCE_JSON)
    if layout.SEQUENCE_JSON not in files.present:
        if not any(issue.path == problems.path for issue in files.findings.issues):
            text = "without it the folder is an unfinished sequence"
            problems.add("FILE_MISSING", "", text)
        return None
    path = files.folder / layout.SEQUENCE_JSON
    info: dict[str, Any] | None = read_document(path, "sequence", problems)
    if info is None:
        return None
    expected = {"id": name, "tier": tier_name}
    if row is not None:
        expected |= {key: row[key] for key in _FROM_ROW if key not in expected}
    for key, value in expected.items():
        if info[key] != value:
            source = "its folder" if key in ("id", "tier") else "sequences.parquet"
            text = f"found {info[key]!r:.80}; {source} has {value!r}"
            problems.add("IDENTITY_DIFFERS", key, text)
    if len(info["frame_info"]) != info["frames"]:
        problems.add(
            "SCHEMA_INVALID",
            "frame_info",
            f"found {len(info['frame_info'])} entries; required: one for each of the "
            f"{info['frames']} frames",
        )
    if row is None and info["split"] not in context.splits:
        text = f"{info['split']} is none of {list(context.splits)}"
        problems.add("SPLIT_UNKNOWN", "split", text)
    if info["tier"] not in context.tiers and tier_name not in context.tiers and row is None:
        text = f"{info['tier'][:80]!r} is none of {list(context.tiers)}"
        problems.add("TIER_UNKNOWN", "tier", text)
    return info


def _check_held_out(info: dict[str, Any], problems: FileProblems) -> None:
    """Check that a held-out sequence.json says nothing from which its truth could be made."""
    telling = {
        "parameters": info["parameters"] != {},
        "frame_info": any(info["frame_info"]),
        "seed": info["seed"] != 0,
    }
    for field_name in (name for name, tells in telling.items() if tells):
        problems.add(
            "HELD_OUT_LEAKS",
            field_name,
            f"the split {info['split']} is held out; required: seed 0, parameters {{}} and an "
            "empty object for each frame",
        )


def _cameras(context: Context, files: SequenceFiles, info: dict[str, Any]) -> list[Camera] | None:
    file, problems = files.contents(layout.CAMERAS_JSON), files.at(layout.CAMERAS_JSON)
    document = None if file is None else read_document(file, "cameras", problems)
    return None if document is None else check_cameras(context, document, info["frames"], problems)


def _check_frames(
    context: Context,
    tier: Tier,
    files: SequenceFiles,
    info: dict[str, Any],
    cameras: list[Camera] | None,
    points: PointSet | None,
    row: dict[str, Any] | None,
    result: SequenceResult,
) -> None:
    """Go through the frames once: images, rows, and how they agree."""
    frames, problems = info["frames"], files.at(layout.CORRESPONDENCES_TABLE)
    stream: Iterator[FrameRows] = iter(())
    if files.contents(layout.CORRESPONDENCES_TABLE) is not None:
        path = files.folder / layout.CORRESPONDENCES_TABLE
        most = limits.MAX_CORRESPONDENCE_ROWS
        table = check_table(path, "correspondences", problems, max_rows=most)
        if table is not None:
            check_place(table)
        if table is not None and table.whole and points is not None:
            grouped = check_keys(table, frames, len(points))
            if not context.quick:
                stream = frame_rows(table, frames, len(points), grouped)
    shares = np.full(frames, np.nan)
    count = 0
    evidence = Evidence(frames)
    result.keys = evidence.keys
    for frame in range(frames):
        name = layout.depth_name(frame)
        if name in files.hashes:
            evidence.keys.depths[frame] = int(files.hashes[name][0][:15], 16)
    rows = next(stream, None)
    for frame in range(frames):
        rgb = check_rgb(context, files, frame)
        if rgb is not None:
            evidence.add_picture(frame, rgb)
        surface = check_surface(context, tier, files, frame)
        if surface is not None:
            result.boxes_px[frame] = surface.box_px(tier.queried_object)
            evidence.add_shown(frame, surface)
            if frame < PRECISION_FRAMES:
                check_precision(surface, files.at(layout.depth_name(frame)))
        if rows is None or rows.frame != frame or points is None:
            continue
        count += len(rows.point)
        outer = ~points.centreline[rows.point]
        shares[frame] = np.mean((rows.state == SELF_OCCLUDED)[outer]) if outer.any() else np.nan
        if cameras is not None:
            good = check_projection(context, cameras[frame], rows, problems)
            evidence.add_rows(cameras[frame], rows)
            if surface is not None:
                view = SoundFrame(tier, cameras[frame], points, rows, good, surface)
                fits = check_visibility(view, problems)
                evidence.add_surface(view, rgb, fits)
        rows = next(stream, None)
    for _ in stream:  # so that broken values after the last frame are reported too
        pass
    evidence.conclude(tier, info, cameras, context.size, files)
    whole = points is not None and count == frames * len(points)
    if row is not None and whole and np.isfinite(shares).all() and np.isfinite(row[_SHARE]):
        share = float(np.mean(shares))
        if abs(row[_SHARE] - share) > 1e-5:
            text = f"found {row[_SHARE]:.6f}; its correspondences give {share:.6f}"
            where = f"{row['id']}, {_SHARE}"
            files.findings.add("SUMMARY_DISAGREES", layout.SEQUENCES_TABLE, where, text)
