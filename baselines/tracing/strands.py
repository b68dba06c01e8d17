"""Paths that pass all strands of a mask, the straightest first.

The skeleton of a mask (Zhang and Suen 1984) is a graph: strands, which meet at crossings or end
loosely. A rope passes every strand once, or twice where it is on itself. All crossings are
decided together: of the walks from a loose end that pass every strand, those with the least sum of
squared turns at the crossings are returned.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from pliant.baselines.tracing.depth_in_mask import steps_along
from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import FloatArray, Mask

_EIGHT = np.ones((3, 3), np.bool_)
_CODE = np.array([[1, 2, 4], [128, 0, 8], [64, 32, 16]])  # clockwise from the upper left pixel


@dataclass(frozen=True)
class _Strand:
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


def straightest_paths(mask: Mask, half_px: float, start: FloatArray | None) -> list[FloatArray]:
    """Return paths that pass all strands of a mask.

    Args:
        mask: bool (H, W), one rope.
        half_px: About half of its width.
        start: (u, v) of a place near the loose end where they begin; None for any.

    Returns:
        float64 (N, 2) each, (u, v); empty where the mask has too many strands, or none.
    """
    strands, loose = _graph(thinned(mask), half_px)
    if not 0 < len(strands) <= TRACING.strands_most:
        return []
    begins = sorted(loose) or sorted({node for strand in strands for node in strand.nodes})
    if len(loose) == 2:
        begins = begins[:1]  # the others are the same walks backwards
    if start is not None and loose:
        begins = [min(loose, key=lambda node: float(np.linalg.norm(loose[node] - start)))]
    reach = max(2, round(TRACING.strands_reach * half_px))
    found = _Search(strands, frozenset(loose), reach).walks(begins)
    lines = (
        np.concatenate([strands[number].line[:: 1 - 2 * end] for number, end in walk])
        for walk in itertools.islice(found, TRACING.strands_paths)
    )
    return [ndimage.gaussian_filter1d(line, half_px, axis=0, mode="nearest") for line in lines]


def thinned(mask: Mask) -> Mask:
    """Return the skeleton of a mask: lines of one pixel, connected as the mask is."""
    skeleton = np.pad(mask, 1)
    while True:
        before = skeleton.sum()
        for table in _TABLES:
            skeleton = skeleton & ~table[_codes(skeleton)]
        if skeleton.sum() == before:
            return np.asarray(skeleton[1:-1, 1:-1])


def _codes(mask: Mask) -> npt.NDArray[np.int32]:
    """Return the eight neighbours of each pixel as a number below 256."""
    return np.asarray(ndimage.correlate(mask.astype(np.int32), _CODE, mode="constant"))


def _tables() -> Iterator[Mask]:
    """Yield for both passes which pixels go, by the code of their eight neighbours."""
    count, (up, right, down, left) = _RING.sum(axis=1), _RING[:, 1::2].T
    border = (count >= 2) & (count <= 6) & (_BEGUN == 1)
    yield border & ~(up & right & down) & ~(right & down & left)
    yield border & ~(up & right & left) & ~(up & down & left)


_RING = (np.arange(256)[:, None] >> np.arange(8)) & 1 > 0  # from the upper left, clockwise
_BEGUN = (~_RING & np.roll(_RING, -1, axis=1)).sum(axis=1)  # lines that meet in a pixel
_TABLES = tuple(_tables())


def _graph(skeleton: Mask, half_px: float) -> tuple[list[_Strand], dict[int, FloatArray]]:
    """Return the strands of a skeleton, and the places (u, v) of the nodes that are loose ends."""
    joints = skeleton & (_BEGUN[_codes(skeleton)] > 2)
    if joints.any():  # one crossing of two strands has several
        joints = ndimage.distance_transform_edt(~joints) <= half_px
    regions, nodes = ndimage.label(joints, _EIGHT)
    parts, count = ndimage.label(skeleton & ~joints, _EIGHT)
    strands: list[_Strand] = []
    loose: dict[int, FloatArray] = {}
    if count > 10 * TRACING.strands_most:  # most of them would have to be spurs
        return strands, loose
    for number, box in enumerate(ndimage.find_objects(parts), 1):
        pixels = _ordered(parts[box] == number) + [each.start for each in box]
        line = pixels[:, ::-1] + 0.5
        ends = [_node_at(regions, pixels[0]), _node_at(regions, pixels[-1])]
        if 0 in ends and max(ends) > 0 and len(pixels) < TRACING.strands_spur * half_px:
            continue
        for end in (0, 1):
            if ends[end] == 0:
                nodes += 1
                ends[end], loose[nodes] = nodes, line[-end]
        strands.append(_Strand(line, (ends[0], ends[1])))
    return strands, loose


def _ordered(part: Mask) -> npt.NDArray[np.int64]:
    """Return the pixels of a line, (row, column), from one end to the other: int64 (N, 2)."""
    pixels = np.argwhere(part)
    first = steps_along(part, tuple(pixels[0]))
    one_end = np.unravel_index(int(first.argmax()), part.shape)
    steps = steps_along(part, (int(one_end[0]), int(one_end[1])))
    return pixels[np.argsort(steps[tuple(pixels.T)], kind="stable")]


def _node_at(regions: npt.NDArray[np.int32], pixel: npt.NDArray[np.int64]) -> int:
    """Return the number of the node next to the end of a line, 0 for none."""
    row, column = pixel
    near = regions[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]
    return int(near.max())


@dataclass(frozen=True)
class _Search:
    """Looks for walks along strands, best first.

    Attributes:
        strands: The strands.
        loose: Nodes that are loose ends.
        reach: Pixels over which the direction of a strand at its end is measured.
    """

    strands: list[_Strand]
    loose: frozenset[int]
    reach: int

    def walks(self, begins: list[int]) -> Iterator[list[tuple[int, int]]]:
        """Yield walks that pass all strands: (strand, the end at which it is entered)."""
        onward: dict[int, list[tuple[int, int]]] = {}
        for number, strand in enumerate(self.strands):
            for end in (0, 1):
                onward.setdefault(strand.nodes[end], []).append((number, end))
        order = itertools.count()
        queue: list[tuple[float, int, int, list[tuple[int, int]]]]
        queue = [(0.0, next(order), node, []) for node in begins]
        for _ in range(TRACING.strands_looks):
            if not queue:
                return
            cost, _, node, walk = heapq.heappop(queue)
            passed = {number for number, _ in walk}
            if len(passed) == len(self.strands) and (node in self.loose or len(self.loose) < 2):
                yield walk
                continue
            for step in onward.get(node, []):
                times = sum(number == step[0] for number, _ in walk)
                if times < 2 and not (walk and walk[-1] == (step[0], 1 - step[1])):
                    more = self._turn(walk, step) + (TRACING.strands_twice if times else 0.0)
                    far = self.strands[step[0]].nodes[1 - step[1]]
                    heapq.heappush(queue, (cost + more, next(order), far, [*walk, step]))

    def _turn(self, walk: list[tuple[int, int]], step: tuple[int, int]) -> float:
        """Return the squared turn between the last strand of a walk and the next one, rad²."""
        if not walk:
            return 0.0
        number, entered = walk[-1]
        arriving = -self.strands[number].leaving(1 - entered, self.reach)
        leaving = self.strands[step[0]].leaving(step[1], self.reach)
        return float(np.arccos(np.clip(arriving @ leaving, -1, 1)) ** 2)
