"""Whether the states of points agree with the surface image of their frame.

States are decided against the deformed surface itself, at a point's exact position; the
image samples that surface at pixel centres only. Between two centres there can be a fold,
an edge or a sharp tip that no pixel shows, so no rule on pixels can hold everywhere. The
rules here are strict where the image leaves no doubt, and count where it does.

*Smooth* is a point whose 5x5 pixels are in the image, have one object id and, unless that
is the background, change from pixel to neighbour by at most `SLOPE` pixel footprints in
depth and on the material. A continuous surface hides what is behind it there, but says
nothing of what is in front: a part thinner than a pixel can pass between the centres. Its
object must then be seen nearby, and a tube thinner than `THIN` footprints is not judged.

- A visible point is matched by a pixel of its 3x3: the same object, depth and material
  within `MATCH` footprints. Exempt is a point in front of what its pixels show, if a pixel
  of its object is within `NEARBY` pixels.
- A hidden point is not nearer than its 3x3 by more than `MATCH` footprints, unless a pixel
  of what hides it is within `NEARBY` pixels; behind one object, the state names it
  (`self_occluded` its own, `occluded` another); and on a cloth, whose material coordinates
  are those of one surface point, it is not a match.

Elsewhere a frame's visible points may miss, but not half of them. A point counts as matched
if it is no farther from its object's pixels than these are from each other, as on a grazing
surface; points of an object seen edge-on are not counted. And wherever it is, an `occluded`
point has a pixel of another object within `NEARBY` pixels.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.conventions import OCCLUDED, OUT_OF_FRAME, SELF_OCCLUDED, VISIBLE
from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.windows import ENOUGH, SoundFrame, Windows, edge_on, is_thin

MATCH = 3.0
"""How far a point may be from a pixel that shows it, in pixel footprints."""

SURE = 1.5
"""How near a hidden cloth point may come to the surface shown, in pixel footprints."""

BEND = 1.0
"""Second difference of depth, in pixel footprints: in a sharper fold what is hidden is near."""

LOOSE_SHARE = 0.5
"""The share of visible points that must be matched wherever they are."""

CENTRELINE_REACH = 1.25
"""How far below the surface, and along it, a visible centre-line point may be, in diameters."""

_CHUNK = 8192


def check_visibility(view: SoundFrame, problems: FileProblems) -> bool:
    """Check the states of a frame's points against its surface image.

    Args:
        view: The frame.
        problems: Gets `VISIBLE_DISAGREES`, `MATERIAL_DISAGREES`, `OCCLUDED_DISAGREES`.

    Returns:
        True if the frame's points are those that the image shows, as far as it can be said.
    """
    rows, image = view.rows, view.surface.image
    pixel = np.floor(rows.uv_px)  # of a point behind the camera this may be any number
    inner = np.all((pixel >= 2) & (pixel < np.array(view.size) - 2), axis=1)
    chosen = np.flatnonzero(view.good & inner & (rows.state != OUT_OF_FRAME))
    missed = [np.zeros((0, 2), np.int64)]
    for low in range(0, chosen.size, _CHUNK):
        part = chosen[low : low + _CHUNK]
        # Most visible points are matched by the pixel that contains them.
        u, v = pixel[part].astype(np.int64).T
        index = (v * view.size[0] + u)[:, None, None]
        shown, z = (each.ravel().take(index) for each in (image.object_id, image.depth_m))
        same, lower, away, reach, limit = _compare(view, part, shown, z, view.steps_m(part, index))
        matched = same & (lower >= -reach) & (np.maximum(lower, away) <= limit)
        part = part[(rows.state[part] != VISIBLE) | ~matched[:, 0, 0]]
        if part.size:
            windows = Windows.around(view, part, pixel[part].astype(np.int64))
            missed.append(_check_visible(windows, problems))
            _report_hidden(windows, problems)
    places = np.concatenate(missed)
    if not len(places):
        return True
    seen = chosen[rows.state[chosen] == VISIBLE]
    own = view.own(seen)
    strips = edge_on(own, rows.uv_px[seen])
    thin = is_thin(view.diameter_m(own), rows.depth_m[seen] / view.focal_px)
    count = int(np.count_nonzero(~thin & ~np.isin(own, strips)))
    places = places[~np.isin(places[:, 0], strips)]
    if count < ENOUGH or len(places) <= (1 - LOOSE_SHARE) * count:
        return True
    where = f"frame {rows.frame}"
    # Where depth fits, it is not the depth image's Z that is wrong.
    if 2 * int(places[:, 1].sum()) >= len(places):
        problems.add(
            "MATERIAL_DISAGREES",
            where,
            f"{len(places)} of {count} visible points fit in depth, but the surface layer shows "
            "other material there: m0 and m1 exchanged or mirrored, points renumbered, or a "
            "metres_per_unit that is wrong?",
        )
    else:
        problems.add(
            "VISIBLE_DISAGREES",
            where,
            f"{len(places)} of {count} visible points are on no surface that the depth image shows "
            "around them: the image of another frame, or depth in another unit?",
        )
    return False


def _compare(
    view: SoundFrame,
    chosen: npt.NDArray[np.int64],
    object_id: npt.NDArray[np.uint32],
    depth_m: npt.NDArray[np.float32],
    steps_m: FloatArray,
) -> tuple[npt.NDArray[np.bool_], FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compare points with pixels around them.

    Args:
        view: The frame.
        chosen: int64 (N,), rows.
        object_id: uint32 (N, H, W), what H x W pixels show.
        depth_m: float32 (N, H, W), likewise.
        steps_m: float64 (N, H, W, 2), on the material from the point to these pixels.

    Returns:
        bool (N, H, W), pixels of the point's object; float64 (N, H, W), how far the point is behind
        each pixel's surface, and its distance on the material; float64 (N, 1, 1), how far in front
        it may be, and how far behind and away. All in metres.
    """
    own, depth = view.own(chosen)[:, None, None], view.rows.depth_m[chosen, None, None]
    line = view.points.centreline[view.rows.point[chosen], None, None]
    reach = MATCH * depth / view.focal_px
    # A surface point is on the surface shown; a centre-line point up to a diameter below.
    limit = reach + np.where(line, CENTRELINE_REACH * view.diameter_m(own), 0.0)
    away = np.where(line, steps_m[..., 0], np.sqrt((steps_m**2).sum(axis=-1)))
    return object_id == own, depth - depth_m, away, reach, limit


def _check_visible(windows: Windows, problems: FileProblems) -> npt.NDArray[np.int64]:
    """Check visible points; return (object, 1 where depth fits) of those that no pixel matches."""
    view, rows = windows.view, windows.view.rows
    own, depth, near = windows.own, windows.point_depth_m, windows.near_m
    same, lower, away, reach, limit = _compare(
        view, windows.chosen, windows.near_id, near, windows.steps_m
    )
    on_depth = same & (lower >= -reach) & (lower <= limit)
    matched = np.any(on_depth & (away <= limit), axis=(1, 2))
    visible = (rows.state[windows.chosen] == VISIBLE) & ~windows.thin(own)
    missed = visible & ~matched
    deep = on_depth.any(axis=(1, 2))
    doubted = missed & windows.smooth
    in_front = doubted & ~windows.behind(doubted)
    bad = doubted & ~windows.seen_nearby(in_front)
    problems.add_rows(
        "VISIBLE_DISAGREES",
        bad & ~deep,
        lambda i: (
            rows.where(windows.chosen[i]),
            f"visible at depth {depth[i]:.4f} m; around its pixel the surface of its object is "
            f"at {near[i].min():.4f} to {near[i].max():.4f} m, or not seen",
        ),
    )
    problems.add_rows(
        "MATERIAL_DISAGREES",
        bad & deep,
        lambda i: (
            rows.where(windows.chosen[i]),
            "visible, but the surface layer shows another part of the material there",
        ),
    )
    rest = np.flatnonzero(missed)
    missed[rest] = ~_on_slope(
        same[rest], lower[rest], away[rest], reach[rest, 0, 0], limit[rest, 0, 0]
    )
    return np.stack([own[missed], deep[missed]], axis=1).astype(np.int64)


def _report_hidden(windows: Windows, problems: FileProblems) -> None:
    rows = windows.view.rows
    state, depth, own = rows.state[windows.chosen], windows.point_depth_m, windows.own
    near, centre = windows.near_m, windows.object_id[:, 2, 2]
    self_hidden, covered = state == SELF_OCCLUDED, state == OCCLUDED
    hidden = self_hidden | covered
    reach = MATCH * windows.footprint_m
    nearer = hidden & windows.smooth & (depth < near.min(axis=(1, 2)) - reach)
    itself = self_hidden & windows.thin(own)
    itself |= windows.seen_nearby(nearer & self_hidden)
    nearer &= ~itself
    misnamed = hidden & ~itself & (centre != 0)
    misnamed &= (self_hidden & (centre != own)) | (covered & (centre == own))
    misnamed &= windows.behind(misnamed)
    surely = np.zeros(len(own), np.bool_)
    if windows.view.tier.kind == "cloth":
        close = (SURE * windows.footprint_m)[:, None, None]
        away = np.sqrt((windows.steps_m**2).sum(axis=-1))
        deep = np.abs(near - depth[:, None, None])
        surely = hidden & windows.smooth & np.any((away <= close) & (deep <= close), axis=(1, 2))
        lines = np.concatenate([windows.depth_m[:, 2, :], windows.depth_m[:, :, 2]], axis=1)
        with np.errstate(invalid="ignore"):
            bends = np.abs(np.diff(lines.reshape(-1, 2, 5), n=2)).max(axis=(1, 2))
        surely &= bends <= BEND * windows.footprint_m
        surely &= windows.resolved(surely)
    others = (windows.object_id != own[:, None, None]) & (windows.object_id != 0)
    nobody = covered & ~others.any(axis=(1, 2))
    # What is thinner than a pixel may hide a point between pixels that do not show it.
    every = [each.id for each in windows.view.tier.objects]
    by_others = windows.others_nearby(nobody | ((nearer | surely) & covered), every)
    misnamed &= ~windows.others_nearby(misnamed & covered, windows.view.unknown)
    problems.add_rows(
        "OCCLUDED_DISAGREES",
        ((nearer | surely | nobody) & ~by_others) | misnamed,
        lambda i: (
            rows.where(windows.chosen[i]),
            f"hidden by {'its own' if state[i] == SELF_OCCLUDED else 'another'} object at depth "
            f"{depth[i]:.4f} m; around its pixel object {centre[i]} is seen at "
            f"{near[i].min():.4f} to {near[i].max():.4f} m",
        ),
    )


def _on_slope(
    same: npt.NDArray[np.bool_],
    lower: FloatArray,
    away: FloatArray,
    above_m: FloatArray,
    below_m: FloatArray,
) -> npt.NDArray[np.bool_]:
    """Return which points are no farther from their object's pixels than these from each other.

    On a surface seen at a grazing angle depth and material change by many footprints from one
    pixel to the next, and from the point to the nearest pixel.

    Args:
        same: bool (N, 3, 3), pixels of the point's object.
        lower: float64 (N, 3, 3), how far the point is behind each pixel's surface, metres.
        away: float64 (N, 3, 3), its distance on the material, metres.
        above_m: float64 (N,), how far in front it may be in any case.
        below_m: float64 (N,), how far behind, and away on the material.
    """
    lows = [np.where(same, value, np.inf).min(axis=(1, 2)) for value in (lower, away)]
    highs = [np.where(same, value, -np.inf).max(axis=(1, 2)) for value in (lower, away)]
    with np.errstate(invalid="ignore"):
        deep, wide = (high - low for high, low in zip(highs, lows, strict=True))
        found: npt.NDArray[np.bool_] = same.any(axis=(1, 2)) & (highs[0] >= -above_m - deep)
        found &= (lows[0] <= below_m + deep) & (lows[1] <= below_m + wide)
    return found
