"""Looks up surface images for the next blocks in worker processes, while this one scores."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import replace

from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.surfaces import SurfaceFacts, Surfaces
from pliant.evaluator.submission.queries import Queries

_process_surfaces: tuple[Surfaces, Queries] | None = None  # set once in each worker process


def _start_process(surfaces: Surfaces, queries: Queries) -> None:
    global _process_surfaces
    _process_surfaces = surfaces, queries


def _look_up_in_process(block: Block) -> SurfaceFacts:
    if _process_surfaces is None:
        raise RuntimeError("the worker process was not started")
    surfaces, queries = _process_surfaces
    return surfaces.facts(block, queries)


def looked_up_ahead(
    blocks: Iterator[Block], surfaces: Surfaces, queries: Queries, workers: int
) -> Iterator[Block]:
    """Yield blocks in order, each when `surfaces` has what it says about the block.

    Args:
        blocks: The blocks, read a few ahead.
        surfaces: Receives what the worker processes look up.
        queries: The split's queries.
        workers: Number of worker processes.
    """
    executor = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_process,
        initargs=(surfaces, queries),
    )
    waiting: deque[tuple[Block, Future[SurfaceFacts]]] = deque()
    try:
        for block in blocks:
            needed = replace(block, partners=None, uv_a_px=None, box_px=None)
            waiting.append((block, executor.submit(_look_up_in_process, needed)))
            if len(waiting) > 2 * workers:
                yield _with_facts(surfaces, *waiting.popleft())
        while waiting:
            yield _with_facts(surfaces, *waiting.popleft())
    finally:
        executor.shutdown(cancel_futures=True)


def _with_facts(surfaces: Surfaces, block: Block, found: Future[SurfaceFacts]) -> Block:
    surfaces.keep(block, found.result())
    return block
