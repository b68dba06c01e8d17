"""Errors of methods on real pictures of an open rope with a ball at one end, without labels.

    python benchmarks/real_rope.py FOLDER [METHOD...] [--masks FOLDER] [--quick] [--json FILE]

The rope's mask and the geodesic distance inside it from the ball give every pixel's place along the
rope: 0 at the ball, 1 at the free end. Queries are at fixed places of every picture; the truth is
the same place of every other one. Ropes must not cross themselves.

`arc_error_median`: |place answered - place asked|, of the rope pixel nearest to the answer, as a
share of the rope's length. `share_within_20_px`, `share_within_3_percent`, `share_within_5_percent`
(of the length): over the five places between the ends. `share_on_rope`: answers within 2 px of the
rope. `ball_end_within_20_px`, `free_end_within_20_px`: of all pairs. With several methods each key
ends in `_METHOD`. `length_spread`: standard deviation over mean of the ropes' lengths in pixels,
which says how far the places can be trusted.

The mask is what differs from the border of the picture by more than `--threshold` grey levels, its
largest connected part, with holes of up to 200 px filled: next to one, the pixel deepest inside the
rope is not in its middle.
`spec/ball.py` tells the ball from the rope.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from record import Value, main
from scipy import ndimage
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from pliant.api import open_method
from pliant.baselines.matcher import Matcher
from pliant.spec.arrays import FloatArray, Mask, border
from pliant.spec.ball import separate_ball
from pliant.spec.errors import PliantError
from pliant.spec.frame import Frame, Pair
from pliant.spec.io.photo import SUFFIXES, read_mask, read_photo

BETWEEN = (1 / 6, 2 / 6, 3 / 6, 4 / 6, 5 / 6)
ENDS = (0.015, 0.985)  # the ball's side, the free end
_BAND_PX = 3.0
_NEAR_PX = 20.0
_ON_ROPE_PX = 2.0
_HOLE_PX2 = 200
METHODS = ("random", "sift", "rope-tracer", "don-rope")


@dataclass(frozen=True)
class Rope:
    """A picture and the places along its rope.

    Attributes:
        view: The picture with its mask.
        place: float64 (H, W), 0 to 1, NaN off the rope.
        length_px: Geodesic distance from the ball to the free end.
        at_px: float32 (places, 2), the middle of the rope at each place asked about.
    """

    view: Frame
    place: FloatArray
    length_px: float
    at_px: npt.NDArray[np.float32]


def read_rope(path: Path, mask: Path | None, threshold: int) -> Rope:
    """Read a picture and find its rope, its ball and the places along it.

    Raises:
        PliantError: No rope with a ball is found in the picture.
    """
    rgb = read_photo(path)
    size = (rgb.shape[1], rgb.shape[0])
    shown = _differs(rgb, threshold) if mask is None else read_mask(mask, size)
    whole = _without_holes(_largest(shown))
    strand, ball = separate_ball(whole)
    if ball is None:
        raise PliantError(
            "the rope has no ball",
            path=path,
            required="a round part that is thicker than the rope",
            fix="Give masks with --masks, or leave the picture out.",
        )
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    rope = _largest(strand & (cv2.dilate(ball.astype(np.uint8), disc) == 0))
    rows, columns = np.nonzero(rope)
    centre = np.argwhere(ball).mean(axis=0)
    start = int(((rows - centre[0]) ** 2 + (columns - centre[1]) ** 2).argmin())
    distance = geodesic(rope, start)
    length = float(distance.max())
    place = np.full(rope.shape, np.nan)
    place[rows, columns] = distance / length
    depth = cv2.distanceTransform(rope.astype(np.uint8), cv2.DIST_L2, 5)
    at_px = [_middle(place, depth, where, _BAND_PX / length) for where in (*BETWEEN, *ENDS)]
    view = Frame(rgb, rope, key=str(path), objects=rope | ball)
    return Rope(view, place, length, np.array(at_px, np.float32))


def geodesic(mask: Mask, start: int) -> FloatArray:
    """Return the length of the shortest way inside a mask from one of its pixels to each other.

    Args:
        mask: bool (H, W), connected.
        start: Number of a pixel among the mask's, row by row.

    Returns:
        float64 (N,), pixels, diagonal steps count as the square root of 2.
    """
    pixels = cKDTree(np.argwhere(mask))
    steps = pixels.sparse_distance_matrix(pixels, 1.5, output_type="coo_matrix")
    found: FloatArray = dijkstra(steps.tocsr(), indices=start)
    return np.where(np.isfinite(found), found, 0.0)


def _differs(rgb: npt.NDArray[np.uint8], threshold: int) -> Mask:
    background = np.median(border(rgb), axis=0)
    return np.asarray(np.abs(rgb - background).max(axis=2) > threshold)


def _largest(mask: Mask) -> Mask:
    parts, _ = ndimage.label(mask, np.ones((3, 3)))
    sizes = np.bincount(parts.ravel())
    return mask & (parts == 1 + sizes[1:].argmax()) if len(sizes) > 1 else mask


def _without_holes(mask: Mask) -> Mask:
    """Return a mask with its small holes filled."""
    parts, _ = ndimage.label(~mask)
    small = np.bincount(parts.ravel()) <= _HOLE_PX2
    small[0] = False  # label 0 is the mask itself
    return mask | small[parts]


def _middle(
    place: FloatArray, depth: npt.NDArray[np.float32], where: float, band: float
) -> tuple[float, float]:
    """Return the pixel deepest inside the rope of those nearer to a place along it than `band`."""
    rows, columns = np.nonzero(np.abs(place - where) < band)
    best = int(depth[rows, columns].argmax())
    return columns[best] + 0.5, rows[best] + 0.5


def score(
    ropes: Sequence[Rope], matcher: Matcher, pairs: Iterable[tuple[int, int]]
) -> dict[str, Value]:
    """Return the figures of a method over pairs of pictures."""
    asked = np.array([*BETWEEN, *ENDS])
    arc, px, on = [], [], []
    for a, b in pairs:
        source, target = ropes[a], ropes[b]
        found = matcher.answer(Pair(source.view, target.view, source.at_px)).uv_px.astype(float)
        rows, columns = np.nonzero(np.isfinite(target.place))
        pixels = np.stack([columns, rows], axis=1) + 0.5
        gaps = np.linalg.norm(found[:, None] - pixels[None], axis=2)
        nearest = gaps.argmin(axis=1)
        arc.append(np.abs(target.place[rows[nearest], columns[nearest]] - asked))
        px.append(np.linalg.norm(found - target.at_px, axis=1))
        on.append(gaps.min(axis=1) <= _ON_ROPE_PX)
    between = slice(0, len(BETWEEN))
    error, distance = np.array(arc)[:, between], np.array(px)
    return {
        "arc_error_median": float(np.median(error)),
        "share_within_20_px": float((distance[:, between] <= _NEAR_PX).mean()),
        "share_within_3_percent": float((error <= 0.03).mean()),
        "share_within_5_percent": float((error <= 0.05).mean()),
        "share_on_rope": float(np.mean(on)),
        "ball_end_within_20_px": float((distance[:, -2] <= _NEAR_PX).mean()),
        "free_end_within_20_px": float((distance[:, -1] <= _NEAR_PX).mean()),
    }


def measure(
    folder: Path, methods: Sequence[str], masks: Path | None, threshold: int, quick: bool
) -> dict[str, Value]:
    """Return the figures of methods on a folder of pictures."""
    if not folder.is_dir():
        raise PliantError("no such folder", path=folder)
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)
    ropes = []
    for file in files:
        try:
            mask = None if masks is None else next(masks.glob(f"{file.stem}.*"))
            ropes.append(read_rope(file, mask, threshold))
        except PliantError as error:
            print(f"left out: {error}")
    if len(ropes) < 2:
        raise PliantError("fewer than two pictures show a rope with a ball", path=folder)
    lengths = np.array([rope.length_px for rope in ropes])
    pairs = list(itertools.permutations(range(len(ropes)), 2))
    if quick:
        pairs = [(k, (k + 1) % len(ropes)) for k in range(len(ropes))]
    figures: dict[str, Value] = {
        "pictures": len(ropes),
        "pairs": len(pairs),
        "length_px": float(lengths.mean()),
        "length_spread": float(lengths.std() / lengths.mean()),
    }
    for name in methods:
        found = score(ropes, open_method(name), pairs)
        ending = "" if len(methods) == 1 else f"_{Path(name).name}"
        figures |= {key + ending: value for key, value in found.items()}
    return figures


if __name__ == "__main__":
    options = {
        "folder": {"type": Path},
        "methods": {"nargs": "*", "default": METHODS, "metavar": "METHOD"},
        "--masks": {"type": Path, "help": "masks of rope and ball, by the pictures' names"},
        "--threshold": {"type": int, "default": 12, "help": "grey levels (default: 12)"},
    }
    main("real_rope", measure, __doc__, options)
