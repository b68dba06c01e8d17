"""The frozen benchmark: which pairs of frames are asked about, at which points, and the truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import pyarrow as pa

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.tiers import describe_tier
from pliant.generator.seeding import RandomStreams, SequenceTask, Stream
from pliant.generator.truth.query_sampling import (
    FrameTask,
    Tracks,
    draw_points,
    frame_pairs,
    point_classes,
    skip_pairs,
)
from pliant.spec.arrays import IntArray
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.io.parquet import read_table, write_table
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage.layout import CORRESPONDENCES_TABLE, POINTS_TABLE, SEQUENCE_JSON
from pliant.spec.tables import QUERIES, TRUTH

_SEQUENCES_IN_MEMORY = 64


def build_queries(
    config: GenerateConfig,
    tasks: Sequence[SequenceTask],
    root: Path,
    queries_dir: Path,
    truth_dir: Path,
) -> None:
    """Write `queries/SPLIT.parquet` and `truth/SPLIT.parquet` of a dataset's splits.

    A pair's target is a frame of one sequence. Its source is a frame of the same sequence where
    that has several frames, else of another sequence of the same tier and split. Sequences of
    several frames ask half of their pairs from frame 0, towards targets spread over the sequence,
    two neighbouring frames at a time, and half between any two frames; with the kind `track`, frame
    0 is the source of every later frame; with `skips`, sources are asked in the frames so much
    later. Query points are tabulated surface points of the queried object that frame A sees, so
    their positions are exact. A target that does not show the object at all, or a source that shows
    none of its points, makes no pair.

    The queries are public, so they must not contain information about the answers:

    - Every source frame draws its points once, with a generator of its own, and asks them in all of
      its pairs, each pair in a random order of its own. Which points a pair asks and how many
      depends on frame A alone. (The shared points also let an evaluator measure temporal jitter
      over neighbouring targets.)
    - The material is divided at random into classes. A frame asks points of one class, and no
      pair has a source and a target of the same class. The query pixels of frame B are therefore
      never answers to a pair whose target is B, nor symmetric to one. A track
      and skips need no classes: their targets are never sources.
    - With `moving_share`, being asked says that a point is more likely than others to move in the
      episode, and nothing about where to.

    Args:
        config: The dataset's config, with the seed.
        tasks: The finished sequences.
        root: The folder with them.
        queries_dir: The folder to write the queries in.
        truth_dir: The folder to write their truth in.
    """
    for split in config.queries.splits:
        queries, truth = _split_tables(config, tasks, root, split)
        if len(queries) == 0:
            continue
        path = queries_dir / f"{split}.parquet"
        footer = {"dataset": {"id": config.id, "version": config.version}, "split": split}
        write_table(path, queries, "queries", footer)
        footer["queries_sha256"] = sha256_file(path)
        write_table(truth_dir / path.name, truth, "truth", footer)


def _split_tables(
    config: GenerateConfig, tasks: Sequence[SequenceTask], root: Path, split: str
) -> tuple[pa.Table, pa.Table]:
    seed, settings = config.seed, config.queries
    tracks = lru_cache(_SEQUENCES_IN_MEMORY)(lambda task: _read_tracks(task.folder(root)))
    queries: list[pa.Table] = []
    truth: list[pa.Table] = []
    for tier in config.tiers:
        members = [task for task in tasks if (task.tier, task.split) == (tier, split)]
        if not members:
            continue
        points = read_table(members[0].folder(root) / POINTS_TABLE, "points")
        queried = points["object"].to_numpy() == describe_tier(config, tier).queried_object
        askable = np.flatnonzero(queried & (points["kind"].to_numpy() == "surface"))
        partners = np.array(points["partners"].to_pylist(), np.int64).reshape(len(points), -1)
        drawn: dict[FrameTask, IntArray] = {}
        for task in members:
            rng = RandomStreams(seed, task).generator(Stream.QUERY_PAIRS)
            frames, wanted = len(tracks(task).boxes_px), settings.pairs_per_sequence
            targets_only = settings.kind == "track" or bool(settings.skips)
            pairs: Iterator[tuple[FrameTask, FrameTask]]
            if settings.kind == "track":
                wanted = frames - 1
                first = FrameTask(task, 0)
                pairs = ((first, FrameTask(task, frame)) for frame in range(1, frames))
            elif settings.skips:
                pairs = skip_pairs(rng, task, frames, settings.skips)
            else:
                pairs = frame_pairs(rng, task, members, frames, wanted)
            made = 0
            for source, target in pairs:
                if made == wanted:
                    break
                if source not in drawn:
                    asked = askable
                    if not targets_only:
                        classes = point_classes(seed, source, frames, partners)
                        asked = askable[classes[askable] == source.point_class(frames)]
                    drawn[source] = draw_points(
                        RandomStreams(seed, source.task).generator(
                            Stream.QUERY_POINTS, source.frame
                        ),
                        tracks(source.task),
                        source.frame,
                        asked,
                        settings.queries_per_pair,
                        [source.frame + skip for skip in settings.skips] or range(frames),
                        settings.moving_share,
                    )
                rows = rng.permutation(drawn[source])
                seen = tracks(source.task), tracks(target.task)
                tables = pair_tables(len(queries), source, target, rows, seen, partners)
                if tables is not None:
                    queries.append(tables[0])
                    truth.append(tables[1])
                    made += 1
    if not queries:
        return QUERIES.empty_table(), TRUTH.empty_table()
    return pa.concat_tables(queries), pa.concat_tables(truth)


def pair_tables(
    pair_id: int,
    source: FrameTask,
    target: FrameTask,
    chosen: IntArray,
    tracks: tuple[Tracks, Tracks],
    partners: IntArray,
) -> tuple[pa.Table, pa.Table] | None:
    """Return the rows of queries and truth of a pair, None if it cannot be asked about.

    Args:
        pair_id: Its number in the file.
        source: The frame that the points are asked in.
        target: The frame where they are to be found.
        chosen: Ids of the points to ask, visible in the source, in the order of the rows.
        tracks: Tracks of the sequences of source and target.
        partners: int64 (P, S), per symmetry the point each is mapped to.
    """
    box = tracks[1].boxes_px[target.frame]
    if box is None or len(chosen) == 0:
        return None
    count = len(chosen)
    uv_a = tracks[0].uv_px[source.frame, chosen]
    uv_b, states = tracks[1].uv_px[target.frame], tracks[1].visibility[target.frame]
    shared = {
        "pair_id": np.full(count, pair_id, np.int32),
        "query_id": np.arange(count, dtype=np.int32),
        "tier": [source.task.tier] * count,
    }
    queries = {
        **shared,
        "sequence_a": [source.task.id] * count,
        "frame_a": np.full(count, source.frame, np.int32),
        "sequence_b": [target.task.id] * count,
        "frame_b": np.full(count, target.frame, np.int32),
        "u_a": np.ascontiguousarray(uv_a[:, 0]),
        "v_a": np.ascontiguousarray(uv_a[:, 1]),
    }
    alternatives = [
        [
            {"u": uv_b[partner, 0], "v": uv_b[partner, 1], "visibility": states[partner]}
            for partner in partners[point]
        ]
        for point in chosen
    ]
    truth = {
        **shared,
        "point": chosen.astype(np.int32),
        "u_b": np.ascontiguousarray(uv_b[chosen, 0]),
        "v_b": np.ascontiguousarray(uv_b[chosen, 1]),
        "visibility_b": states[chosen].tolist(),
        "box_px": np.full(count, max(box[2] - box[0], box[3] - box[1]), np.float32),
        "alternatives": pa.array(alternatives, TRUTH.field("alternatives").type),
    }
    return pa.table(queries, schema=QUERIES), pa.table(truth, schema=TRUTH)


def _read_tracks(folder: Path) -> Tracks:
    names = ["u_px", "v_px", "visibility"]
    table = read_table(folder / CORRESPONDENCES_TABLE, "correspondences", names)
    boxes = [info["box_px"] for info in read_json(folder / SEQUENCE_JSON)["frame_info"]]
    frames = len(boxes)
    uv_px = np.stack([table["u_px"].to_numpy(), table["v_px"].to_numpy()], axis=-1)
    states = table["visibility"].combine_chunks().dictionary_encode()
    visibility = np.array(states.dictionary.to_pylist(), object)[states.indices.to_numpy()]
    return Tracks(uv_px.reshape(frames, -1, 2), visibility.reshape(frames, -1), boxes)
