"""Looks up answers in the surface images of the target frames, reading each image once."""

from __future__ import annotations

import functools
import math
import multiprocessing
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.surface_images import (
    ObjectSurface,
    farthest_material_m,
    nearest_object_pixel,
    silhouette_distance_px,
    typical_step_m,
)
from pliant.evaluator.submission.queries import Queries
from pliant.spec.arrays import BoolArray, FloatArray, IntArray
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.exr import read_surface
from pliant.spec.io.parquet_columns import stacked
from pliant.spec.model import MaterialObject
from pliant.spec.storage import layout

_CACHED_FRAMES: Final = 24


@dataclass(frozen=True)
class SurfaceFacts:
    """What the surfaces say about the queries of a block.

    Attributes:
        known: bool (N,), queries whose target frame has a surface image.
        on_object: bool (N,), answers that are on the queried object.
        geodesic_m: float64 (N,), distance on the material; NaN off the object.
        silhouette_px: float64 (N,), of the true position to the silhouette; NaN if not known or
            not wanted.
        steps_m: float64 (N, 2), from the right material point to the one under the answer or, off
            the object, nearest to it, along both coordinates; NaN where none is within
            `reach_px`.
        pixel_m: float64 (N,), what one pixel of the target frame typically spans on the material;
            NaN if not known or not wanted.
    """

    known: BoolArray
    on_object: BoolArray
    geodesic_m: FloatArray
    silhouette_px: FloatArray
    steps_m: FloatArray
    pixel_m: FloatArray


class Surfaces:
    """Reads surface images and point tables of a dataset, each as rarely as it can.

    Args:
        dataset: The dataset.
        search_px: Number of rows and columns around an answer's pixel that are searched for the
            object.
        reach_px: Answers on the object or so near it have `steps_m`, and their frames `pixel_m`;
            0 leaves both out.
        silhouettes: Whether `silhouette_px` is wanted.
    """

    def __init__(
        self,
        dataset: Dataset,
        search_px: int = 1,
        reach_px: float = 0,
        *,
        silhouettes: bool = False,
    ) -> None:
        self._dataset = dataset
        self._search_px = search_px
        self._reach_px = reach_px
        self._silhouettes = silhouettes
        self._points: dict[str, FloatArray] = {}
        self.frame = functools.lru_cache(_CACHED_FRAMES)(self._read)
        self._step_m = functools.cache(self._typical_step_m)
        self._kept: tuple[Block, SurfaceFacts] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy in another process has read nothing yet.
        make = functools.partial(Surfaces, silhouettes=self._silhouettes)
        return make, (self._dataset, self._search_px, self._reach_px)

    def facts(self, block: Block, queries: Queries) -> SurfaceFacts:
        """Return what the surfaces say about a block's queries; of the last block it is known."""
        if self._kept is None or self._kept[0] is not block:
            self._kept = block, self._look_up_block(block, queries)
        return self._kept[1]

    def keep(self, block: Block, facts: SurfaceFacts) -> None:
        """Take over what another process looked up for a block."""
        self._kept = block, facts

    def queried(self, tier: str) -> MaterialObject:
        """Return the object of a tier that queries are on."""
        return self._dataset.tiers[tier].queried

    def needed_frame(self, sequence: str, frame: int) -> ObjectSurface:
        """Return the queried object in a frame for which the dataset must have a surface image.

        Raises:
            SpecError: It has none.
        """
        surface = self.frame(sequence, frame)
        if surface is None:
            raise SpecError(
                "keypoint matches are scored through surface images, and one is missing",
                path=self._dataset.sequence(sequence).dir / layout.depth_name(frame),
                fix="Score with the complete dataset, or submit answers instead of matches.",
            )
        return surface

    def _read(self, name: str, frame: int) -> ObjectSurface | None:
        """Return the queried object in a frame, or None if the dataset has no surface of it."""
        sequence = self._dataset.sequence(name)
        if not sequence.has(layout.depth_name(frame)):
            return None
        path = sequence.file(layout.depth_name(frame))
        surface = read_surface(path, size=sequence.size, writable=False)
        queried = sequence.described.queried_object
        return ObjectSurface(surface.object_id == queried, surface.m0, surface.m1)

    def _typical_step_m(self, name: str, frame: int) -> float:
        surface = self.frame(name, frame)
        tier = self._dataset.sequence(name).tier
        return 0.0 if surface is None else typical_step_m(surface, self.queried(tier))

    def point_material(self, sequence: str) -> FloatArray | None:
        """Return the material coordinates of a tier's points, float64 (points, 2), or None."""
        found = self._dataset.sequence(sequence)
        if found.tier not in self._points:
            if not found.has(layout.POINTS_TABLE):
                return None  # asked again: another sequence of the tier may have the table
            self._points[found.tier] = stacked(found.points(), "m0", "m1").astype(np.float64)
        return self._points[found.tier]

    def _look_up_block(self, block: Block, queries: Queries) -> SurfaceFacts:
        """Look up a block's answers and true positions, once in each target frame."""
        count = len(block.state)
        facts = SurfaceFacts(
            np.zeros(count, bool), np.zeros(count, bool), np.full(count, np.nan),
            np.full(count, np.nan), np.full((count, 2), np.nan), np.full(count, np.nan),
        )  # fmt: skip
        if block.point is None:
            return facts
        pairs = np.arange(block.pairs.start, block.pairs.stop)
        places = (each[pairs].tolist() for each in (queries.sequence_b, queries.frame_b))
        of_frame: dict[tuple[int, int], list[int]] = {}
        for index, place in enumerate(zip(*places, strict=True)):
            of_frame.setdefault(place, []).append(index)
        for (sequence, frame), members in of_frame.items():
            name = queries.sequences[sequence]
            material = self.point_material(name)
            surface = None if material is None else self.frame(name, frame)
            if surface is None or material is None:
                continue
            rows = np.concatenate([np.arange(*block.starts[each : each + 2]) for each in members])
            rows = rows[block.counted[rows]]
            if len(rows):
                queried = self.queried(queries.tiers[queries.tier[pairs[members[0]]]])
                self._look_up(block, block.point, rows, surface, material, queried, facts)
                if self._reach_px:
                    facts.pixel_m[rows] = self._step_m(name, frame)
        return facts

    def _look_up(
        self,
        block: Block,
        point: IntArray,
        rows: IntArray,
        surface: ObjectSurface,
        material: FloatArray,
        queried: MaterialObject,
        facts: SurfaceFacts,
    ) -> None:
        """Fill in what one target frame says about rows of a block."""
        facts.known[rows] = True
        if self._silhouettes:
            true_px = block.true_px[rows]
            facts.silhouette_px[rows] = silhouette_distance_px(surface.on_object, true_px)
        lost = block.lost[rows]
        facts.geodesic_m[rows[lost]] = farthest_material_m(queried)
        answered = rows[~lost]
        points = point[answered]
        if len(points) and (points.min() < 0 or points.max() >= len(material)):
            raise SpecError(
                "the truth names a point that is not in the point table",
                path=self._dataset.root,
                found=int(points.max()),
                required=f"0 to {len(material) - 1}",
                fix="Run: pliant validate",
            )
        at = block.answer_px[answered].astype(np.float64)
        row, column, found = nearest_object_pixel(surface.on_object, at, self._search_px)
        facts.on_object[answered] = found
        under = surface.material(row[found], column[found])
        facts.geodesic_m[answered[found]] = queried.distance_m(under, material[points[found]])
        off = np.flatnonzero(~found)
        if not self._reach_px:
            return
        facts.steps_m[answered[found]] = queried.steps_m(under - material[points[found]])
        if not len(off):
            return
        around_px = math.ceil(self._reach_px)
        row, column, near = nearest_object_pixel(surface.on_object, at[off], around_px)
        centre_px = np.stack([column, row], axis=1) + 0.5
        near &= np.hypot(*(centre_px - at[off]).T) <= self._reach_px
        off = off[near]
        under = surface.material(row[near], column[near])
        facts.steps_m[answered[off]] = queried.steps_m(under - material[points[off]])


_process_surfaces: tuple[Surfaces, Queries] | None = None  # set once in each worker process


def _start_process(surfaces: Surfaces, queries: Queries) -> None:
    global _process_surfaces
    _process_surfaces = surfaces, queries


def _look_up_in_process(block: Block) -> SurfaceFacts:
    if _process_surfaces is None:
        raise RuntimeError("the worker process was not started")
    surfaces, queries = _process_surfaces
    return surfaces.facts(block, queries)


def prefetched(
    blocks: Iterator[Block], surfaces: Surfaces, queries: Queries, workers: int
) -> Iterator[Block]:
    """Yield blocks in order, each after the worker processes have looked up its surfaces.

    Args:
        blocks: The blocks, read a few ahead.
        surfaces: Receives the results of the worker processes.
        queries: The split's queries.
        workers: Number of worker processes.
    """
    executor = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_process,
        initargs=(surfaces, queries),
    )

    def taken(block: Block, found: Future[SurfaceFacts]) -> Block:
        surfaces.keep(block, found.result())
        return block

    waiting: deque[tuple[Block, Future[SurfaceFacts]]] = deque()
    try:
        for block in blocks:
            needed = replace(block, partners=None, uv_a_px=None, box_px=None)
            waiting.append((block, executor.submit(_look_up_in_process, needed)))
            if len(waiting) > 2 * workers:
                yield taken(*waiting.popleft())
        while waiting:
            yield taken(*waiting.popleft())
    finally:
        executor.shutdown(cancel_futures=True)
