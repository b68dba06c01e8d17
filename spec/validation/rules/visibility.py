"""Whether the states of points agree with the surface image of their frame.

States are decided against the deformed surface itself, at a point's exact position; the
image samples that surface at pixel centres only. Between two centres there can be a fold,
an edge or a sharp tip that no pixel shows, so no rule on pixels can hold everywhere. The
rules here are strict where the image leaves no doubt, and count where it does.

*Smooth* is a point whose 5x5 pixels lie in the image, have one object id and, unless that
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
  are those of one surface point, it is no match.

Elsewhere a frame's visible points may miss, but not half of them. A point counts as matched
if it is no farther from its object's pixels than these are from each other, as on a grazing
surface; points of an object seen edge-on are not counted. And wherever it is, an `occluded`
point has a pixel of another object within `NEARBY` pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.io.exr import Surface
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.cameras import Cameras
from pliant.spec.validation.rules.correspondences import (
    OCCLUDED,
    OUT_OF_FRAME,
    SELF_OCCLUDED,
    VISIBLE,
    FrameRows,
)
from pliant.spec.validation.rules.points import PointSet

SLOPE = 3.0
"""Largest step between neighbouring pixels of a smooth place, in pixel footprints."""

MATCH = 3.0
"""How far a point may be from a pixel that shows it, in pixel footprints."""

SURE = 1.5
"""How near a hidden cloth point may come to the surface shown, in pixel footprints."""

LOOSE_SHARE = 0.5
"""The share of visible points that must be matched wherever they are."""

CENTRELINE_REACH = 1.25
"""How far below the surface, and along it, a visible centre-line point may be, in diameters."""

THIN = 2.0
"""A tube or ball is judged if its diameter, and a sheet counted if the strip that its visible
points cover, is at least this wide, in pixels at its depth."""

NEARBY = 16
"""How far from a pixel of its object a part may reach that no pixel shows, in pixels."""

_CHUNK = 8192
_AROUND = np.arange(-2, 3)
_INNER = slice(1, 4)


@dataclass(frozen=True)
class _Window:
    """The 5x5 pixels around N points that are far enough from the border.

    Attributes:
        depth_m: float32 (N, 5, 5).
        object_id: uint32 (N, 5, 5).
        away_m: float64 (N, 3, 3), distance on the material from the point to the surface of
            the inner pixels; infinite where that is another object.
        along_m: float64 (N, 3, 3), the same along the first coordinate alone.
        footprint_m: float64 (N,), a pixel's width at the point's depth.
        smooth: bool (N,).
        uniform: bool (N,), one object id.
        inside: float64 (N, 2), place of the point in its pixel, 0 to 1.
        point_depth_m: float64 (N,), the point's own depth.
    """

    depth_m: npt.NDArray[np.float32]
    object_id: npt.NDArray[np.uint32]
    away_m: npt.NDArray[np.float64]
    along_m: npt.NDArray[np.float64]
    footprint_m: npt.NDArray[np.float64]
    smooth: npt.NDArray[np.bool_]
    uniform: npt.NDArray[np.bool_]
    inside: npt.NDArray[np.float64]
    point_depth_m: npt.NDArray[np.float64]

    def behind(self, which: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Return which of some points are not in front of the object that their pixels show."""
        behind = which & self.uniform & (self.object_id[:, 2, 2] != 0)
        rows = np.flatnonzero(behind)
        behind[rows] = _is_behind(
            self.depth_m[rows], self.inside[rows], self.point_depth_m[rows], self.smooth[rows]
        )
        return behind


def check_visibility(
    tier: dict[str, Any],
    cameras: Cameras,
    points: PointSet,
    rows: FrameRows,
    good: npt.NDArray[np.bool_],
    surface: Surface,
    shown: str,
    findings: Findings,
) -> bool:
    """Check the states of a frame's points against its surface image.

    Args:
        tier: The sequence's tier.
        cameras: The sequence's cameras.
        points: The sequence's points.
        rows: The frame's rows.
        good: bool (N,), rows that project to where they say; the others are left out.
        surface: The frame's surface image, valid.
        shown: The table's path in issues.
        findings: Gets `VISIBLE_DISAGREES`, `MATERIAL_DISAGREES`, `OCCLUDED_DISAGREES`.

    Returns:
        True if the frame's points are those that the image shows, as far as it can be said.
    """
    height, width = surface.depth_m.shape
    # A point behind the camera may carry any number: clipped, for the cast to be defined.
    pixel = np.floor(np.clip(rows.uv_px, -8.0, 2.0**20)).astype(np.int64)
    inner = np.all((pixel >= 2) & (pixel < np.array([width, height]) - 2), axis=1)
    chosen = np.flatnonzero(good & inner & (rows.state != OUT_OF_FRAME))
    seen = chosen[rows.state[chosen] == VISIBLE]
    edge_on = _edge_on(points.object_id[rows.point[seen]], rows.uv_px[seen])
    tally = np.zeros(3, np.int64)
    for low in range(0, chosen.size, _CHUNK):
        part = chosen[low : low + _CHUNK]
        tally += _check_points(
            tier, cameras, points, rows, part, pixel[part], surface, edge_on, shown, findings
        )
    count, missed, deep = (int(number) for number in tally)
    if count < 8 or missed <= (1 - LOOSE_SHARE) * count:
        return True
    where = f"frame {rows.frame}"
    if 2 * deep >= missed:  # depth fits: it is not the depth image's Z that is wrong
        findings.add(
            "MATERIAL_DISAGREES",
            shown,
            where,
            f"{missed} of {count} visible points fit in depth, but the surface layer shows other "
            "material there: m0 and m1 exchanged or mirrored, points renumbered, or a "
            "metres_per_unit that is wrong?",
        )
    else:
        findings.add(
            "VISIBLE_DISAGREES",
            shown,
            where,
            f"{missed} of {count} visible points are on no surface that the depth image shows "
            "around them: the image of another frame, or depth in another unit?",
        )
    return False


def _check_points(
    tier: dict[str, Any],
    cameras: Cameras,
    points: PointSet,
    rows: FrameRows,
    chosen: npt.NDArray[np.int64],
    pixel: npt.NDArray[np.int64],
    surface: Surface,
    edge_on: list[int],
    shown: str,
    findings: Findings,
) -> npt.NDArray[np.int64]:
    """Check some rows; return how many are visible, miss, and miss although depth fits."""
    K = cameras.K[rows.frame]
    window = _window(tier, points, rows, chosen, pixel, surface, float(min(K[0, 0], K[1, 1])))
    near_by = _Nearby(tier, surface.object_id, pixel, window.footprint_m)
    own = points.object_id[rows.point[chosen]]
    line = points.centreline[rows.point[chosen]]
    depth = rows.depth_m[chosen]
    reach = MATCH * window.footprint_m
    # A surface point lies on the surface shown; a centre-line point up to a diameter below.
    below = np.where(line, CENTRELINE_REACH * _diameter(tier, own), 0.0)

    near = window.depth_m[:, _INNER, _INNER]
    same = window.object_id[:, _INNER, _INNER] == own[:, None, None]
    lower = depth[:, None, None] - near
    on_depth = same & (lower >= -reach[:, None, None]) & (lower <= (reach + below)[:, None, None])
    away = np.where(
        line[:, None, None],
        window.along_m,
        window.away_m,
    )
    matched = np.any(on_depth & (away <= (reach + below)[:, None, None]), axis=(1, 2))
    visible = (rows.state[chosen] == VISIBLE) & ~near_by.thin(own)
    missed = visible & ~matched
    doubted = missed & window.smooth
    in_front = doubted & ~window.behind(doubted)
    _report_visible(
        rows,
        chosen,
        doubted & ~near_by.shown(own, in_front),
        on_depth.any(axis=(1, 2)),
        near,
        depth,
        shown,
        findings,
    )
    _report_hidden(tier, rows, chosen, window, own, near_by, shown, findings)
    visible &= ~np.isin(own, edge_on)
    missed &= visible
    rest = np.flatnonzero(missed)
    missed[rest] = ~_on_slope(
        same[rest], lower[rest], away[rest], reach[rest], (reach + below)[rest]
    )
    deep = missed & on_depth.any(axis=(1, 2))
    return np.array([np.count_nonzero(part) for part in (visible, missed, deep)])


def _on_slope(
    same: npt.NDArray[np.bool_],
    lower: npt.NDArray[np.float64],
    away: npt.NDArray[np.float64],
    above_m: npt.NDArray[np.float64],
    below_m: npt.NDArray[np.float64],
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


def _edge_on(own: npt.NDArray[np.int32], uv_px: npt.NDArray[np.float64]) -> list[int]:
    """Return the objects whose points all project to a strip narrower than `THIN` pixels.

    Args:
        own: int32 (N,), the objects of visible points.
        uv_px: float64 (N, 2).
    """
    found = []
    for object_id in np.unique(own):
        uv = uv_px[own == object_id]
        # The width of an even strip is the square root of 12 times its variance.
        variance = np.linalg.eigvalsh(np.cov(uv.T, bias=True))[0]
        if 12 * variance < THIN**2:
            found.append(int(object_id))
    return found


@dataclass(frozen=True)
class _Nearby:
    """What is seen near N points of a frame, and what is too thin to be seen for certain.

    Attributes:
        tier: The sequence's tier.
        object_id: uint32 (H, W), the frame's object ids.
        pixel: int64 (N, 2), the pixels that contain the points.
        footprint_m: float64 (N,).
    """

    tier: dict[str, Any]
    object_id: npt.NDArray[np.uint32]
    pixel: npt.NDArray[np.int64]
    footprint_m: npt.NDArray[np.float64]

    def thin(self, own: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
        """Return which points are on a tube or ball thinner than `THIN` footprints."""
        diameter = _diameter(self.tier, own)
        thin: npt.NDArray[np.bool_] = (diameter > 0) & (diameter < THIN * self.footprint_m)
        return thin

    def shown(
        self, own: npt.NDArray[np.int32], which: npt.NDArray[np.bool_], *, others: bool = False
    ) -> npt.NDArray[np.bool_]:
        """Return which points have a pixel of an object within `NEARBY` pixels, or a thin one.

        Args:
            own: int32 (N,), the points' objects.
            which: bool (N,), the points to look at; False for all others.
            others: Look for any other object than the point's own.
        """
        found = np.zeros(len(own), np.bool_)
        if not which.any():
            return found
        if others:
            for thing in self.tier["objects"]:
                name = np.full(len(own), thing["id"], np.int32)
                found |= which & (own != thing["id"]) & self.thin(name)
        for index in np.flatnonzero(which & ~found):
            u, v = self.pixel[index]
            around = self.object_id[
                max(v - NEARBY, 0) : v + NEARBY + 1, max(u - NEARBY, 0) : u + NEARBY + 1
            ]
            mine = around == own[index]
            found[index] = np.any(~mine & (around != 0)) if others else mine.any()
        return found


def _window(
    tier: dict[str, Any],
    points: PointSet,
    rows: FrameRows,
    chosen: npt.NDArray[np.int64],
    pixel: npt.NDArray[np.int64],
    surface: Surface,
    focal: float,
) -> _Window:
    """Gather the 5x5 pixels around points and judge whether they are smooth."""
    width = surface.depth_m.shape[1]
    place = pixel[:, 1] * width + pixel[:, 0]
    around = (_AROUND[:, None] * width + _AROUND[None, :]).ravel()
    index = (place[:, None] + around).astype(np.intp)
    shape = (len(chosen), 5, 5)
    depth = surface.depth_m.ravel().take(index).reshape(shape)
    object_id = surface.object_id.ravel().take(index).reshape(shape)
    m0 = surface.m0.ravel().take(index).reshape(shape)
    m1 = surface.m1.ravel().take(index).reshape(shape)
    own = points.object_id[rows.point[chosen]]
    own_m = points.material[rows.point[chosen]]
    footprint = rows.depth_m[chosen] / focal
    centre_id = object_id[:, 2, 2]
    uniform = np.all(object_id == centre_id[:, None, None], axis=(1, 2))
    smooth = uniform.copy()
    inner_id, inner_m0, inner_m1 = (part[:, _INNER, _INNER] for part in (object_id, m0, m1))
    away = np.full((len(chosen), 3, 3), np.inf)
    along = np.full((len(chosen), 3, 3), np.inf)
    for thing in tier["objects"]:
        material = thing["material"]
        mine = np.flatnonzero(uniform & (centre_id == thing["id"]))
        if mine.size:
            # The footprint is that of the surface shown, which may not be the point's.
            z, a, b = depth[mine], m0[mine], m1[mine]
            step = SLOPE * (z[:, 2, 2] / focal)[:, None, None]
            rough = np.zeros(mine.size, np.bool_)
            for axis in (1, 2):
                rough |= np.any(np.abs(np.diff(z, axis=axis)) > step, axis=(1, 2))
                jump = _squared(np.diff(a, axis=axis), np.diff(b, axis=axis), material)
                rough |= np.any(jump > step * step, axis=(1, 2))
            smooth[mine] = ~rough
        belongs = np.nonzero((own == thing["id"])[:, None, None] & (inner_id == thing["id"]))
        if belongs[0].size:
            gap_0 = inner_m0[belongs] - own_m[belongs[0], 0]
            gap_1 = inner_m1[belongs] - own_m[belongs[0], 1]
            away[belongs] = np.sqrt(_squared(gap_0, gap_1, material))
            along[belongs] = np.abs(gap_0) * material[0]["metres_per_unit"]
    return _Window(
        depth,
        object_id,
        away,
        along,
        footprint,
        smooth,
        uniform,
        rows.uv_px[chosen] - pixel,
        rows.depth_m[chosen],
    )


def _is_behind(
    z: npt.NDArray[np.float32],
    inside: npt.NDArray[np.float64],
    depth: npt.NDArray[np.float64],
    smooth: npt.NDArray[np.bool_],
) -> npt.NDArray[np.bool_]:
    """Return which points are not in front of the surface that their 5x5 pixels show.

    At a smooth place the surface is interpolated between the four pixel centres around the
    point; the largest second difference of the 5x5 bounds the error. Elsewhere a point is
    behind if it is behind all of its 3x3.

    Args:
        z: float32 (N, 5, 5), metres.
        inside: float64 (N, 2), place of the point in its pixel, 0 to 1.
        depth: float64 (N,), the points' depth, metres.
        smooth: bool (N,).
    """
    with np.errstate(invalid="ignore"):
        bends = [np.abs(np.diff(z, 2, axis=axis)).max(axis=(1, 2)) for axis in (1, 2)]
        error = np.maximum(*bends) + 1e-6 * depth
        rows = np.arange(len(z))
        low = 2 + np.floor(inside - 0.5).astype(np.int64)
        a, b = (inside - 0.5 - np.floor(inside - 0.5)).T
        u, v = low.T
        upper = (1 - a) * z[rows, v, u] + a * z[rows, v, u + 1]
        lower = (1 - a) * z[rows, v + 1, u] + a * z[rows, v + 1, u + 1]
        limit = np.where(
            smooth, (1 - b) * upper + b * lower - error, z[:, _INNER, _INNER].max(axis=(1, 2))
        )
        behind: npt.NDArray[np.bool_] = depth >= limit
    return behind


def _squared(
    gap_0: npt.NDArray[Any], gap_1: npt.NDArray[Any], material: list[dict[str, Any]]
) -> npt.NDArray[Any]:
    """Return the squared distance on the material for differences of its two coordinates."""
    total: npt.NDArray[Any] | float = 0.0
    for delta, coordinate in zip((gap_0, gap_1), material, strict=True):
        if coordinate["period"] is not None:
            delta = delta - coordinate["period"] * np.round(delta / coordinate["period"])
        total = total + (coordinate["metres_per_unit"] * delta) ** 2
    return np.asarray(total)


def material_distance(
    gap: npt.NDArray[np.float64], material: list[dict[str, Any]]
) -> npt.NDArray[np.float64]:
    """Return the distance on the undeformed material for differences of its coordinates.

    Args:
        gap: float64 (..., 2).
        material: The object's two coordinates, as in dataset.json.

    Returns:
        float64 (...), metres: sqrt of the sum of (metres_per_unit * difference)², the
        difference wrapped to half a period where the coordinate has one.
    """
    return np.sqrt(_squared(gap[..., 0], gap[..., 1], material))


def _diameter(tier: dict[str, Any], own: npt.NDArray[np.int32]) -> npt.NDArray[np.float64]:
    """Return, for each point, the diameter of its object: a closed coordinate's length over pi."""
    found = np.zeros(len(own))
    for thing in tier["objects"]:
        second = thing["material"][1]
        if second["period"] is not None:
            length = second["period"] * second["metres_per_unit"]
            found[own == thing["id"]] = length / np.pi
    return found


def _report_visible(
    rows: FrameRows,
    chosen: npt.NDArray[np.int64],
    bad: npt.NDArray[np.bool_],
    on_depth: npt.NDArray[np.bool_],
    near: npt.NDArray[np.float32],
    depth: npt.NDArray[np.float64],
    shown: str,
    findings: Findings,
) -> None:
    findings.add_rows(
        "VISIBLE_DISAGREES",
        shown,
        bad & ~on_depth,
        lambda i: (
            rows.where(chosen[i]),
            f"visible at depth {depth[i]:.4f} m; around its pixel the surface of its object is "
            f"at {near[i].min():.4f} to {near[i].max():.4f} m, or not seen",
        ),
    )
    findings.add_rows(
        "MATERIAL_DISAGREES",
        shown,
        bad & on_depth,
        lambda i: (
            rows.where(chosen[i]),
            "visible, but the surface layer shows another part of the material there",
        ),
    )


def _report_hidden(
    tier: dict[str, Any],
    rows: FrameRows,
    chosen: npt.NDArray[np.int64],
    window: _Window,
    own: npt.NDArray[np.int32],
    near_by: _Nearby,
    shown: str,
    findings: Findings,
) -> None:
    state = rows.state[chosen]
    depth = rows.depth_m[chosen]
    hidden = (state == SELF_OCCLUDED) | (state == OCCLUDED)
    near = window.depth_m[:, _INNER, _INNER]
    reach = MATCH * window.footprint_m
    nearer = hidden & window.smooth & (depth < near.min(axis=(1, 2)) - reach)
    itself = (state == SELF_OCCLUDED) & near_by.thin(own)
    itself |= near_by.shown(own, nearer & (state == SELF_OCCLUDED))
    nearer &= ~itself
    shows_own = window.object_id[:, 2, 2] == own
    misnamed = (
        hidden
        & ~itself
        & (window.object_id[:, 2, 2] != 0)
        & (((state == SELF_OCCLUDED) & ~shows_own) | ((state == OCCLUDED) & shows_own))
    )
    others = (window.object_id != own[:, None, None]) & (window.object_id != 0)
    misnamed &= window.behind(misnamed)
    alone = (state == OCCLUDED) & ~others.any(axis=(1, 2))
    covered = near_by.shown(own, alone | (nearer & (state == OCCLUDED)), others=True)
    nobody = alone & ~covered
    nearer &= ~covered
    surely = np.zeros(len(chosen), np.bool_)
    if tier["kind"] == "cloth":
        close = (SURE * window.footprint_m)[:, None, None]
        surely = np.any(
            (window.away_m <= close) & (np.abs(near - depth[:, None, None]) <= close),
            axis=(1, 2),
        )
    bad = hidden & (nearer | (window.smooth & surely) | misnamed | nobody)
    findings.add_rows(
        "OCCLUDED_DISAGREES",
        shown,
        bad,
        lambda i: (
            rows.where(chosen[i]),
            f"hidden by {'its own' if state[i] == SELF_OCCLUDED else 'another'} object at depth "
            f"{depth[i]:.4f} m; around its pixel object {window.object_id[i, 2, 2]} is seen at "
            f"{near[i].min():.4f} to {near[i].max():.4f} m",
        ),
    )
