"""Makes the queries of imported data, and their answers, from the points that are known."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.converters.alike import Alike
from pliant.converters.clip import Clip
from pliant.spec.arrays import FloatArray
from pliant.spec.errors import CallError
from pliant.spec.tables import QUERIES, TRUTH

Scheme = Literal["first", "strided", "pairs"]
"""`first`: each point is asked in the first frame that shows it, against every later one, as
TAP-Vid's mode of this name does. `strided`: every point that a fifth frame shows is asked there,
against all other frames, as TAP-Vid's other mode does. `pairs`: drawn pairs of frames, every point
the source shows."""

STRIDE: Final = 5
"""Frames between the source frames of scheme `strided`, as TAP-Vid samples them."""

_SEED: Final = 0

_FramePair = tuple[int, int, npt.NDArray[np.int64]]


def make_queries(
    clips: Sequence[Clip],
    ids: Sequence[str],
    tier: str,
    scheme: Scheme,
    pairs: int,
    alike: Sequence[Alike] = (),
) -> tuple[pa.Table, pa.Table]:
    """Return the queries and the truth of some clips.

    A target in which the point is hidden is asked about only where a position is in the
    source: that answer cannot be held against a method, but its visibility can. Where the source
    lists pairs of frames, these are asked about, whatever the scheme.

    Args:
        clips: The clips.
        ids: The sequences that they become.
        tier: Name of their tier.
        scheme: Which pairs of frames.
        pairs: Of scheme `pairs`, the most pairs of a clip.
        alike: Renamings under which the object looks the same: they give the alternatives.

    Returns:
        The tables `queries` and `truth`, row by row.
    """
    queries, truths = [QUERIES.empty_table()], [TRUTH.empty_table()]
    pair = 0
    for index, (clip, sequence) in enumerate(zip(clips, ids, strict=True)):
        rng = np.random.default_rng(np.random.SeedSequence([_SEED, index]))
        order = np.random.default_rng(_secret(clip))
        known, within = np.isfinite(clip.uv_px).all(axis=2), clip.within()
        partners = _partners(clip, alike)
        partners_px = np.where(known[..., None], clip.uv_px, -1.0)  # tables have no NaN
        asked: list[tuple[Any, ...]] = []
        true: list[tuple[Any, ...]] = []
        for a, b, points in _frame_pairs(clip, scheme, pairs, rng):
            chosen = points[known[points, b]]
            if not len(chosen):
                continue
            box_px = _box_px(clip.uv_px[clip.visible[:, b], b])
            # Annotations are often numbered along the material, which the row order must not show.
            for query, point in enumerate(order.permutation(chosen).tolist()):
                state = _state(clip, within, point, b)
                others = [
                    {"u": u, "v": v, "visibility": _state(clip, within, partner, b)}
                    for partner in partners[point]
                    for u, v in (partners_px[partner, b],)
                ]
                key = (pair, query, tier)
                asked.append((*key, sequence, a, sequence, b, *clip.uv_px[point, a]))
                true.append((*key, point, *clip.uv_px[point, b], state, box_px, others))
            pair += 1
        if asked:
            queries.append(pa.table(list(map(list, zip(*asked, strict=True))), schema=QUERIES))
            truths.append(pa.table(list(map(list, zip(*true, strict=True))), schema=TRUTH))
    return pa.concat_tables(queries), pa.concat_tables(truths)


def _secret(clip: Clip) -> int:
    """Return a random seed that only the answers give: with another, rows could be put in order."""
    return int.from_bytes(hashlib.sha256(clip.uv_px.tobytes()).digest(), "big")


def _partners(clip: Clip, alike: Sequence[Alike]) -> npt.NDArray[np.int64]:
    """Return the point that each renaming turns each point into, int64 (N, S).

    Raises:
        CallError: A group names a point that is not annotated.
    """
    names = clip.facts.get("points", ())
    row = {name: index for index, name in enumerate(names)}
    for each in alike:
        if missing := sorted(set(each.renamed) - set(row)):
            raise CallError(
                "a point that looks like others is not annotated",
                where="--alike",
                found=missing[0],
                required="one of " + ", ".join(names)[:200],
            )
    own = [[row[each.renamed.get(name, name)] for each in alike] for name in names]
    return np.array(own, np.int64).reshape(len(clip.uv_px), len(alike))


def _state(clip: Clip, within: npt.NDArray[np.bool_], point: int, frame: int) -> str:
    """Return the visibility state of a point; one without a position is taken for hidden."""
    if clip.visible[point, frame]:
        return "visible"
    return "occluded" if within[point, frame] else "out_of_frame"


def _frame_pairs(
    clip: Clip, scheme: Scheme, pairs: int, rng: np.random.Generator
) -> Iterator[_FramePair]:
    """Yield source frame, target frame, and the points asked."""
    if clip.pairs is not None:
        for a, b in clip.pairs:
            yield a, b, np.flatnonzero(clip.visible[:, a])
        return
    if scheme == "first":
        shown = clip.visible.any(axis=1)
        first = np.where(shown, clip.visible.argmax(axis=1), -1)
        for a in sorted(set(first[shown].tolist())):
            points = np.flatnonzero(first == a)
            for b in range(a + 1, clip.frames):
                yield a, b, points
        return
    if scheme == "strided":
        for a in range(0, clip.frames, STRIDE):
            points = np.flatnonzero(clip.visible[:, a])
            for b in (*range(a), *range(a + 1, clip.frames)):
                yield a, b, points
        return
    total = clip.frames * (clip.frames - 1)
    drawn = rng.permutation(total) if total <= 10**6 else _distinct(rng, total, pairs)
    # Sorted, so that neighbouring pairs read neighbouring frames.
    for number in sorted(drawn[:pairs].tolist()):
        a, b = divmod(number, clip.frames - 1)
        b += b >= a  # skip the pair of a frame with itself
        yield a, b, np.flatnonzero(clip.visible[:, a])


def _distinct(rng: np.random.Generator, total: int, count: int) -> npt.NDArray[np.int64]:
    found = np.unique(rng.integers(0, total, 2 * count))
    return rng.permutation(found)


def _box_px(uv_px: FloatArray) -> float:
    """Return the longer side, in whole pixels, of the box about the points; 1 for none."""
    if not len(uv_px):
        return 1.0
    cells = np.floor(uv_px)
    return float((cells.max(axis=0) - cells.min(axis=0)).max() + 1)
