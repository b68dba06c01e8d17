"""Rules of a frame's two images: kind, size, depth, and what the surface layer may hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.io.exr import Surface, read_surface
from pliant.spec.io.png import read_rgb
from pliant.spec.storage import layout
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.files import SequenceFiles
from pliant.spec.validation.rules.points import MATERIAL_TOLERANCE


def check_rgb(
    context: Context, files: SequenceFiles, frame: int, findings: Findings
) -> npt.NDArray[np.uint8] | None:
    """Check a frame's colour image: its checksum, and (full run) that it decodes.

    Args:
        context: The dataset.
        files: The sequence's folder.
        frame: The frame.
        findings: Gets the problems.

    Returns:
        uint8 (H, W, 3) if it breaks no rule and this is a full run.
    """
    name = layout.rgb_name(frame)
    if files.verified(name, findings) and not context.quick:
        with findings.refusals(f"{files.shown}/{name}"):
            return read_rgb(files.folder / name, size=(context.width, context.height))
    return None


def check_surface(
    context: Context, tier: dict[str, Any], files: SequenceFiles, frame: int, findings: Findings
) -> Surface | None:
    """Check a frame's depth and surface image.

    Args:
        context: The dataset.
        tier: The sequence's tier.
        files: The sequence's folder.
        frame: The frame.
        findings: Gets the problems.

    Returns:
        The surface if it breaks no rule and this is a full run.
    """
    name = layout.depth_name(frame)
    if not files.verified(name, findings) or context.quick:
        return None
    shown = f"{files.shown}/{name}"
    with findings.refusals(shown):
        surface = read_surface(
            files.folder / name, size=(context.width, context.height), writable=False
        )
        before = findings.total
        _check_values(surface, tier, shown, findings)
        if findings.total == before:
            return surface
    return None


def _check_values(surface: Surface, tier: dict[str, Any], shown: str, findings: Findings) -> None:
    """Check every pixel; the usual case costs a few passes over the object's pixels."""
    depth, object_id = surface.depth_m.ravel(), surface.object_id.ravel()
    width = surface.depth_m.shape[1]
    seen = np.flatnonzero(object_id != 0)  # many times as fast as on the integers
    z = depth[seen]
    # Background: everything but the object's pixels is +inf, and nothing else is.
    infinite = int(np.count_nonzero(depth == np.inf))
    if not (
        infinite == depth.size - seen.size and bool(np.all(z > 0)) and bool(np.all(z < np.inf))
    ):
        background = object_id == 0
        with np.errstate(invalid="ignore"):
            bad = np.where(background, depth != np.inf, ~((depth > 0) & (depth < np.inf)))
        _report(
            findings,
            "DEPTH_INVALID",
            shown,
            bad,
            width,
            lambda i: (
                f"Z is {depth[i]} where the object id is {object_id[i]}; required: "
                "positive and finite on an object, +inf elsewhere"
            ),
        )
    bad = np.zeros(object_id.size, np.bool_)
    ids = object_id[seen]
    known = np.zeros(seen.size, np.bool_)
    for thing in tier["objects"]:
        mine = ids == thing["id"]
        known |= mine
        at = seen if mine.all() else seen[mine]
        for channel, coordinate in ((surface.m0, 0), (surface.m1, 1)):
            low, high = (thing["material"][coordinate][end] for end in ("min", "max"))
            slack = MATERIAL_TOLERANCE * (high - low)
            values = channel.ravel()[at]
            if values.size and not (values.min() >= low - slack and values.max() <= high + slack):
                bad[at[~((values >= low - slack) & (values <= high + slack))]] = True
    bad[seen[~known]] = True
    for channel in (surface.m0, surface.m1):
        flat = channel.ravel()
        bits = flat.view(np.uint32)  # counted faster than floats; -0.0 is sorted out below
        if np.count_nonzero(bits) != np.count_nonzero(bits[seen]):
            bad |= (object_id == 0) & (flat != 0)
    _report(
        findings,
        "SURFACE_INVALID",
        shown,
        bad,
        width,
        lambda i: (
            f"object id {object_id[i]}, material ({surface.m0.ravel()[i]}, "
            f"{surface.m1.ravel()[i]}); required: an object of {tier['name']} and a coordinate in "
            "its range, or all 0"
        ),
    )


def _report(
    findings: Findings,
    code: str,
    shown: str,
    bad: npt.NDArray[np.bool_],
    width: int,
    describe: Any,
) -> None:
    """Report one issue for an image: the first bad pixel, and how many there are."""
    count = int(np.count_nonzero(bad))
    if count:
        first = int(np.flatnonzero(bad)[0])
        findings.add(
            code,
            shown,
            f"row {first // width}, column {first % width}",
            f"{describe(first)} ({count} pixels)",
        )


def visible_box_px(surface: Surface, object_id: int) -> float:
    """Return the longer side of the box around an object's pixels, 0 if it is not seen.

    Args:
        surface: The frame's surface.
        object_id: The object.

    Returns:
        Pixels, from the outer edge of the first pixel to that of the last.
    """
    mask = surface.object_id == object_id
    rows = np.flatnonzero(mask.any(axis=1))
    if rows.size == 0:
        return 0.0
    columns = np.flatnonzero(mask[rows[0] : rows[-1] + 1].any(axis=0))
    return float(max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1)
