"""Paths along the strands of a mask, the straightest first.

The skeleton of a mask (Zhang and Suen 1984) is a graph: strands, which meet at crossings or end
loosely. A rope passes every strand once, or twice where it is on itself. All crossings are
decided together: those walks from end to end are returned that have the least sum of squared turns
at the crossings, with a cost for strands that are passed twice or not at all.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from PIL import Image
from scipy import ndimage, sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from pliant.baselines.tracing.mask_shape import pixel_links
from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import FloatArray, Mask
from pliant.spec.mask_box import mask_box


@dataclass(frozen=True)
class Strand:
    """A part of the skeleton between two nodes.

    Attributes:
        line: float64 (N, 2), (u, v), from the first node to the second one.
        nodes: The nodes.
    """

    line: FloatArray
    nodes: tuple[int, int]

    def leaving(self, end: int, reach: int) -> FloatArray:
        """Return the unit vector along the strand, away from one of its ends."""
        line = self.line if end == 0 else self.line[::-1]
        way = line[min(reach, len(line) - 1)] - line[0]
        return np.asarray(way / max(float(np.linalg.norm(way)), 1e-9))


@dataclass(frozen=True)
class Skeleton:
    """The skeleton of a mask as a graph.

    It is taken of an enlarged mask where strands are thin: the holes of a tight knot are a few
    pixels, and crossings less than a strand's width apart.

    Attributes:
        strands: The strands, in pixels of the enlarged mask.
        loose: The nodes that are loose ends.
        half_px: About half of a strand's width there.
        scale: How many times it is enlarged.
        corner_px: float64 (2,), the mask's pixel that is its corner.
    """

    strands: list[Strand]
    loose: frozenset[int]
    half_px: float
    scale: int
    corner_px: FloatArray

    @classmethod
    def of(cls, mask: Mask, half_px: float, most: int) -> Skeleton:
        """Return the skeleton of a mask.

        Args:
            mask: bool (H, W), not empty.
            half_px: About half of a strand's width.
            most: Strands looked for; of a mask with more, one more is returned.
        """
        box = mask_box(mask)
        corner = np.array([box[1].start, box[0].start], dtype=np.float64)
        scale = math.ceil(TRACING.strands_half_px / half_px)
        scale = max(1, min(scale, TRACING.strands_side_px // max(mask[box].shape)))
        fine = _enlarged(mask[box], scale)
        strands, loose = _graph(thinned(fine), half_px * scale, most)
        return cls(strands, frozenset(loose), half_px * scale, scale, corner)

    def in_mask(self, line: FloatArray) -> FloatArray:
        """Return places (N, 2) of the enlarged mask as places of the mask."""
        return np.asarray(line / self.scale + self.corner_px)


def straightest_paths(mask: Mask, half_px: float, start: FloatArray | None) -> list[FloatArray]:
    """Return paths that pass the strands of a mask.

    Args:
        mask: bool (H, W), one rope.
        half_px: About half of its width.
        start: (u, v) of a place near the end where they begin; None for any loose end.

    Returns:
        float64 (N, 2) each, (u, v); empty where the mask has too many strands, or none.
    """
    if not mask.any():
        return []
    found = Skeleton.of(mask, half_px, TRACING.strands_most)
    strands, loose = found.strands, found.loose
    if not 0 < len(strands) <= TRACING.strands_most:
        return []
    begins = sorted(loose) or sorted({node for strand in strands for node in strand.nodes})
    if len(loose) == 2:
        begins = begins[:1]  # the others are the same walks backwards
    if start is not None:
        place = (start - found.corner_px) * found.scale
        ends = [(each.line[-end], each.nodes[end]) for each in strands for end in (0, 1)]
        begins = [min(ends, key=lambda end: float(np.linalg.norm(end[0] - place)))[1]]
    walks = _Search(strands, loose, found.half_px).walks(begins)
    lines = (
        np.concatenate([strands[number].line[:: 1 - 2 * end] for number, end in walk])
        for walk in itertools.islice(walks, TRACING.strands_paths)
    )
    smooth = (ndimage.gaussian_filter1d(e, found.half_px, axis=0, mode="nearest") for e in lines)
    return [found.in_mask(line) for line in smooth]


def _enlarged(mask: Mask, scale: int) -> Mask:
    """Return a mask with finer pixels; those that touch at a corner stay connected."""
    if scale == 1:
        return mask
    picture = Image.fromarray(mask).convert("L")
    size = (mask.shape[1] * scale, mask.shape[0] * scale)
    return np.asarray(picture.resize(size, Image.Resampling.BILINEAR)) > 0.45 * 255


def thinned(mask: Mask) -> Mask:
    """Return the skeleton of a mask: lines of one pixel, connected as the mask is."""
    skeleton = np.pad(mask, 1)
    pixels = np.flatnonzero(skeleton)
    while True:
        before = len(pixels)
        for table in _TABLES:
            gone = table[_codes(skeleton, pixels)]
            skeleton.ravel()[pixels[gone]] = False
            pixels = pixels[~gone]
        if len(pixels) == before:
            return skeleton[1:-1, 1:-1]


def _codes(framed: Mask, pixels: npt.NDArray[np.int64]) -> npt.NDArray[np.uint8]:
    """Return the eight neighbours of some pixels, none of them at the border, as one number."""
    width = framed.shape[1]
    ring = np.array([-width - 1, -width, -width + 1, 1, width + 1, width, width - 1, -1])
    around = framed.ravel()[pixels[:, None] + ring]  # clockwise from the upper left
    return np.packbits(around, axis=1, bitorder="little")[:, 0]


def _tables() -> Iterator[Mask]:
    """Yield for both passes which pixels go, by the code of their eight neighbours."""
    count, (up, right, down, left) = _RING.sum(axis=1), _RING[:, 1::2].T
    border = (count >= 2) & (count <= 6) & (_BEGUN == 1)
    yield border & ~(up & right & down) & ~(right & down & left)
    yield border & ~(up & right & left) & ~(up & down & left)


_RING = (np.arange(256)[:, None] >> np.arange(8)) & 1 > 0  # from the upper left, clockwise
_BEGUN = (~_RING & np.roll(_RING, -1, axis=1)).sum(axis=1)  # lines that meet in a pixel
_SQUARE = np.stack([_RING[:, [k, k - 1, k - 2]].all(axis=1) for k in (1, 3, 5, 7)]).any(axis=0)
_JOINT = (_BEGUN > 2) | _SQUARE  # four lines may meet in a square of four pixels
_TABLES = tuple(_tables())


def _graph(skeleton: Mask, half_px: float, most: int) -> tuple[list[Strand], set[int]]:
    """Return the first strands of a skeleton, and the nodes that are loose ends."""
    framed = np.pad(skeleton, 1)
    places = np.argwhere(framed)[:, ::-1] - 0.5  # (u, v)
    joint = _JOINT[_codes(framed, np.flatnonzero(framed))]
    in_node = np.zeros(len(places), np.bool_)
    if joint.any():  # one crossing of two strands has several
        in_node = cKDTree(places[joint]).query(places)[0] <= half_px
        others = np.flatnonzero(~in_node)
        for part in _parts(places[others], most):  # and what is left between them
            in_node[others[part]] = len(part) < half_px
    nodes, node_of = csgraph.connected_components(pixel_links(places[in_node]), directed=False)
    free = places[~in_node]
    node_at = np.zeros(len(free), np.int64)
    if nodes:
        gap, nearest = cKDTree(places[in_node]).query(free)
        node_at = np.where(gap < 2.5, node_of[nearest] + 1, 0)
    strands: list[Strand] = []
    loose: set[int] = set()
    for part in _parts(free, most):
        if len(strands) > most:
            break
        line = free[part]
        ends = [int(node_at[each]) for each in (part[0], part[-1])]
        spur = max(ends) > 0 and (0 in ends or ends[0] == ends[1])
        if spur and len(part) < TRACING.strands_spur * half_px:
            continue
        for end in (0, 1):
            if ends[end] == 0:
                nodes += 1
                ends[end] = nodes
                loose.add(nodes)
        strands.append(Strand(line, (ends[0], ends[1])))
    return strands, loose


def _parts(places: FloatArray, most: int) -> Iterator[npt.NDArray[np.int64]]:
    """Yield the lines among pixels, the numbers of each in order; nothing for too many lines."""
    links = pixel_links(places)
    count, part_of = csgraph.connected_components(links, directed=False)
    if count > 10 * most:  # most of them would have to be spurs
        return
    for first in np.unique(part_of, return_index=True)[1]:
        end = _from(links, int(first))[-1]
        yield _from(links, int(end))


def _from(links: sparse.csr_array, first: int) -> npt.NDArray[np.int64]:
    """Return the pixels that are connected with one, the farthest last."""
    order = csgraph.breadth_first_order(links, first, directed=False, return_predecessors=False)
    return np.asarray(order, np.int64)


@dataclass(frozen=True)
class _Search:
    """Looks for walks along strands, best first.

    Attributes:
        strands: The strands.
        loose: Nodes that are loose ends.
        half_px: Half of a strand's width.
    """

    strands: list[Strand]
    loose: frozenset[int]
    half_px: float

    def walks(self, begins: list[int]) -> Iterator[list[tuple[int, int]]]:
        """Yield walks from end to end: (strand, the end at which it is entered).

        The cost is the sum of the squared turns, and of what is passed twice or not at all.
        """
        onward: dict[int, list[tuple[int, int]]] = {}
        for number, strand in enumerate(self.strands):
            for end in (0, 1):
                onward.setdefault(strand.nodes[end], []).append((number, end))
        order = itertools.count()
        queue: list[tuple[float, int, int | None, list[tuple[int, int]]]]
        queue = [(0.0, next(order), node, []) for node in begins]
        for _ in range(TRACING.strands_looks):
            if not queue:
                return
            cost, _, node, walk = heapq.heappop(queue)
            if node is None:
                yield walk
                continue
            if walk and (node in self.loose or len(self.loose) < 2):
                whole = cost + self._missed({number for number, _ in walk})
                heapq.heappush(queue, (whole, next(order), None, walk))
            for step in onward.get(node, []):
                times = sum(number == step[0] for number, _ in walk)
                if times < 2 and not (walk and walk[-1] == (step[0], 1 - step[1])):
                    more = self._turn(walk, step) + (TRACING.strands_twice if times else 0.0)
                    far = self.strands[step[0]].nodes[1 - step[1]]
                    heapq.heappush(queue, (cost + more, next(order), far, [*walk, step]))

    def _missed(self, passed: set[int]) -> float:
        left = (each.line for k, each in enumerate(self.strands) if k not in passed)
        return TRACING.strands_missed * sum(map(len, left)) / self.half_px

    def _turn(self, walk: list[tuple[int, int]], step: tuple[int, int]) -> float:
        """Return the squared turn between the last strand of a walk and the next one, rad²."""
        if not walk:
            return 0.0
        reach = max(2, round(TRACING.strands_reach * self.half_px))
        number, entered = walk[-1]
        arriving = -self.strands[number].leaving(1 - entered, reach)
        leaving = self.strands[step[0]].leaving(step[1], reach)
        return float(np.arccos(np.clip(arriving @ leaving, -1, 1)) ** 2)
